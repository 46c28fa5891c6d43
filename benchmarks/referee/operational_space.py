"""Operational space control, in the form that robosuite's OSC_POSE documents.

O. Khatib, "A unified approach for motion and force control of robot manipulators", IEEE Journal of
Robotics and Automation 3 (1987). robosuite's has position and orientation uncoupled, a posture in
the null space that is weighted by the inertia, k_p = 150 and a damping ratio of 1:

    f = L_p (k_p e + k_d e'),  m = L_r (k_p e_r + k_d e_r'),  L = (J M^-1 J^T)^-1
    tau = J_p^T f + J_r^T m + C q' + g + N^T M (k_0 (q_0 - q) - k_d0 q')

With the two coupled, its other choice, one L of all six axes stands for both: Khatib's law.
robosuite's controller has no set points of force. Where the task has one, Khatib's selection takes
the motion off that axis, and the force is fed forward and damped.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from referee.arm import Arm
from referee.session import Sample

Vector = NDArray[np.float64]

NAME = "operational space"
#: robosuite's own, of the tool and of the posture [1/s^2].
DEFAULT, POSTURE = 150.0, 10.0


class OperationalSpace:
    """The law.

    Attributes:
        given: what it was given, in words.
    """

    def __init__(self, arm: Arm, gain: float = DEFAULT, *, coupled: bool = False) -> None:
        """The law of an arm.

        Args:
            arm: its model.
            gain: k_p [1/s^2]; the damping ratio is 1.
            coupled: whether one L of all six axes stands for L_p and L_r.
        """
        self._parts = (slice(0, 6),) if coupled else (slice(0, 3), slice(3, 6))
        self._arm, self._gain, self._damp = arm, gain, 2.0 * np.sqrt(gain)
        self._rest: Vector | None = None
        parts = "coupled" if coupled else "uncoupled"
        self.given = (
            f"k_p = {gain:.3g} 1/s² ({np.sqrt(gain) / 2 / np.pi:.2g} Hz), damping ratio 1, "
            f"position and orientation {parts}; inertia, Coriolis terms and gravity of the arm's "
            "model; the set point of force fed forward; no feedback of force"
        )

    def command(self, sample: Sample) -> Vector:
        """(n,) joint torques [N m]."""
        if not sample.visit:
            return sample.extras["gravity"]
        J, T, M = sample.jacobian, sample.frame, self._arm.inertia(sample.q)
        self._rest = sample.q.copy() if self._rest is None else self._rest
        moved = T.T @ J
        free = ~sample.on_force
        wanted = free * self._gain * sample.off + self._damp * sample.off_rate
        wrench = np.zeros(6)
        for part in self._parts:
            rows = moved[part]
            wrench[part] = np.linalg.solve(rows @ np.linalg.solve(M, rows.T), wanted[part])
        wrench = wrench + sample.on_force * sample.feed
        mass = np.linalg.inv(moved @ np.linalg.solve(M, moved.T))
        null = np.eye(len(sample.q)) - moved.T @ mass @ moved @ np.linalg.inv(M)
        rest = M @ (POSTURE * (self._rest - sample.q) - 2 * np.sqrt(POSTURE) * sample.v)
        return np.asarray(moved.T @ wrench + self._arm.bias(sample.q, sample.v) + null @ rest)
