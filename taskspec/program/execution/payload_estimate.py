"""The estimate of a payload in a run, and the model terms of the arm that carries it."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.laws.adaptation import PARAMETERS, Adaptation
from taskspec.program.bound import Wiring
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import ModelTerms, loaded, symbols
from taskspec.robot.rebuild import GRAVITY
from taskspec.spec import Task

Vector = NDArray[np.float64]

#: The first of the numbers after the estimate tells whether the others are known.
KEPT = len(PARAMETERS)


class PayloadEstimate:
    """What a run knows of the arm's payload: one for all stages, which begins with the run.

    Stages whose law adapts change it. In others it stays what it is, and counts as much. What a
    stage that adapts has filtered, the next one that does begins anew.

    Attributes:
        memory: (4 + 1 + n + 5 k,) base parameters; whether the rest is known; joint velocities of
            the tick before; y (k,) and A (k, 4), filtered. `kept` is that after the tick.
        loaded: H, C q' + g and g of the arm with the payload, as `ModelTerms.arrays` has them.
        function: measurement and memory -> these, and the payload that ticks know.
    """

    def __init__(
        self,
        adaptation: Adaptation,
        robot: RobotModel,
        terms: ModelTerms,
        measured: tuple[Vector, Vector, Vector],
        known: Vector,
        *,
        touches: bool,
    ) -> None:
        """Binds it to a machine.

        Args:
            adaptation: its equations.
            robot: the arm.
            terms: of the arm without the payload; `carry` puts it on.
            measured: (n,) joint velocities, (6,) wrench and (n,) command of the tick before, until
                this one's is there.
            known: (4,) for the mass [kg] and the centre [m] that ticks know.
            touches: whether the wrench is that of the contact. That of a wrist has the payload in
                it; stages that adapt touch nothing then.
        """
        self.adaptation, self.known = adaptation, known
        self._terms = terms.arrays[:3]
        n, rows = robot.n, [AXES.index(axis) for axis in robot.axes]
        size = KEPT + 1 + n + (1 + len(PARAMETERS)) * len(rows)
        self.memory, self.kept = np.zeros(size), np.zeros(size)
        self.loaded = tuple(np.zeros_like(array) for array in self._terms)
        wiring = Wiring()
        v, wrench, torque = (
            wiring.reads(name, array)
            for name, array in zip(("v", "wrench", "torque"), measured, strict=True)
        )
        nominal = symbols(robot, v)
        given = [wiring.reads(f"terms_{i}", array) for i, array in enumerate(terms.arrays)]
        memory = wiring.reads("memory", self.memory)
        theta, fresh = memory[:KEPT], memory[KEPT]
        load = adaptation.model(theta)
        carried = loaded(nominal, load.mass, load.centre, moves=adaptation.inertia).vectors()
        acceleration = fresh * (v - memory[KEPT + 1 : KEPT + 1 + n]) / adaptation.period
        contact = wrench if touches else ca.SX.zeros(6)
        y, A = adaptation.regression(nominal, rows, acceleration, torque, contact)
        before = memory[KEPT + 1 + n :]
        after = before + fresh * adaptation.passed * (ca.vertcat(y, ca.vec(A)) - before)
        filtered = ca.reshape(after[len(rows) :], len(rows), len(PARAMETERS))
        stepped = adaptation.step(theta, after[: len(rows)], filtered, rows)
        made = [
            *zip(carried[:3], self.loaded, strict=True),
            (ca.vertcat(load.mass, load.centre), known),
            (ca.vertcat(stepped, 1, v, after), self.kept),
        ]
        values = ca.substitute([value for value, _ in made], list(nominal.inputs), given)
        for value, (_, array) in zip(values, made, strict=True):
            wiring.writes(value, array)
        self.function = wiring.bound("payload")
        self.renew()

    def renew(self) -> None:
        """Makes it as it was before a run."""
        self.memory[:] = 0.0
        self.memory[:KEPT] = self.adaptation.start

    def carry(self) -> None:
        """Puts the payload on the model terms, as they were last evaluated without it."""
        self.function.evaluate()
        for array, carried in zip(self._terms, self.loaded, strict=True):
            array[:] = carried

    def commit(self, *, adapts: bool) -> None:
        """Makes the tick one that happened, in a stage that adapts or does not."""
        if adapts:
            self.memory[:] = self.kept
        else:
            self.forget()

    def forget(self) -> None:
        """Begins to measure anew, with the estimate as it is."""
        self.memory[KEPT:] = 0.0


def adaptation(task: Task, period: float) -> Adaptation | None:
    """The adaptation of a task at a control period [s]; None without any."""
    if task.adapt is None:
        return None
    to = task.adapt.to
    return Adaptation(
        low=to.mass[0],
        high=to.mass[1],
        reach=to.reach,
        w=2 * np.pi * to.bandwidth,
        dead_zone=to.dead_zone,
        inertia=task.adapt.moves,
        gravity=GRAVITY,
        period=period,
    )
