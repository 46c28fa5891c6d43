"""A plain Cartesian impedance: a spring and a damper between the tool and its reference.

N. Hogan, "Impedance control: an approach to manipulation", ASME Journal of Dynamic Systems,
Measurement and Control 107 (1985), without feedback of force and without shaping of inertia:

    tau = J^T (K (x_d - x) + D (x_d' - x')) + g + N tau_0

On an axis with a set point of force the spring is left out and the force is fed forward. K and D
are constant, K = m w^2 and D = 2 m w, so that the mass m that the tool has along each axis as the
run starts gets the bandwidth w, critically damped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from referee.arm import Arm
from referee.session import Sample

Vector = NDArray[np.float64]

NAME = "impedance"
#: Of the posture, in the null space of J^T: spring [N m/rad] and damper [N m s/rad].
POSTURE, DAMPER = 10.0, 2.0


class Impedance:
    """The law.

    Attributes:
        given: what it was given, in words.
    """

    def __init__(self, arm: Arm, bandwidth: float) -> None:
        """Takes the bandwidth [Hz] of its springs on the mass that moves with the tool."""
        self._arm, self._rate = arm, 2 * np.pi * bandwidth
        self._mass: Vector | None = None
        self._rest: Vector | None = None
        self.given = (
            f"springs and dampers of {bandwidth:g} Hz, critically damped, on the tool's mass at "
            "the start; the set point of force fed forward; no feedback of force; gravity"
        )

    def command(self, sample: Sample) -> Vector:
        """(n,) joint torques [N m]."""
        if not sample.visit:
            return sample.extras["gravity"]
        J, T = sample.jacobian, sample.frame
        if self._mass is None or self._rest is None:
            moved = T.T @ J
            mobility = moved @ np.linalg.solve(self._arm.inertia(sample.q), moved.T)
            self._mass, self._rest = 1.0 / np.diag(mobility), sample.q.copy()
        spring = np.where(sample.on_force, 0.0, self._mass * self._rate**2)
        wrench = spring * sample.off + 2 * self._mass * self._rate * sample.off_rate + sample.feed
        null = np.eye(len(sample.q)) - np.linalg.pinv(J) @ J
        rest = null @ (POSTURE * (self._rest - sample.q) - DAMPER * sample.v)
        return np.asarray(J.T @ (T @ wrench) + sample.extras["gravity"] + rest)
