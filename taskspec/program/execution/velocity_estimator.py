"""Joint velocities that a machine estimates of the positions that it measures, tick by tick."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.velocity_estimate import VelocityEstimate
from taskspec.robot import RobotModel, model_terms

Vector = NDArray[np.float64]


class VelocityEstimator:
    """The estimate of a run, which goes on from stage to stage.

    A tick corrects it before anything else, and predicts when its command is known. Both write
    what they do not read, so that a tick that is made anew changes nothing.

    Attributes:
        correct: q, predicted -> corrected, v.
        predict: corrected, and of an observer the model terms, the wrench and the torque ->
            predicted.
        predicted: (2n,) positions and velocities of the tick that comes.
    """

    def __init__(
        self,
        estimate: VelocityEstimate,
        robot: RobotModel,
        state: tuple[Vector, Vector],
        terms: tuple[Vector, ...],
        wrench: Vector,
        torque: Vector,
    ) -> None:
        """Connects it with a machine.

        Args:
            estimate: its equations.
            robot: the arm.
            state: (n,) q, which is measured, and v, which it writes.
            terms: of the arm's model, as `ModelTerms.arrays`.
            wrench: (6,) measured.
            torque: (n,) that is commanded.
        """
        self._q, self._v = state
        n = len(self._q)
        self.predicted, corrected = np.zeros(2 * n), np.zeros(2 * n)
        before, q = ca.SX.sym("predicted", 2 * n), ca.SX.sym("q", n)
        now = estimate.correct(before, q)
        function = ca.Function("corrected", [before, q], [now, now[n:]], {"cse": True})
        self.correct = BoundFunction(function, [self.predicted, self._q], [corrected, self._v])
        known, u, f = ca.SX.sym("corrected", 2 * n), ca.SX.sym("u", n), ca.SX.sym("wrench", 6)
        given, arrays, acceleration = [known], [corrected], None
        if estimate.modelled:
            at = model_terms.symbols(robot, known[n:])
            acceleration = estimate.acceleration(at.H, at.bias, at.J, u, f)
            given += [*at.inputs, f, u]
            arrays += [*terms, wrench, torque]
        ahead = estimate.predict(known, acceleration)
        function = ca.Function("predicted", given, [ahead], {"cse": True})
        self.predict = BoundFunction(function, arrays, [self.predicted])

    def begin(self) -> None:
        """At rest where the joints are measured."""
        self.predicted[:] = np.concatenate([self._q, np.zeros_like(self._q)])
        self._v[:] = 0.0
