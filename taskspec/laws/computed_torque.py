"""Inverse dynamics in joint space: what a path of joints is followed with."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws.gains import Gain
from taskspec.laws.law import ControlLaw

if TYPE_CHECKING:
    from taskspec.laws.case import Case

#: Of every joint [Hz], as of the motion axes of a law that selects.
BANDWIDTH = 5.0


class ComputedTorque(ControlLaw):
    """u = H (q''_d + K_D (q'_d - q') + K_P (q_d - q)) + C q' + g.

    With the arm's own model the error of each joint goes by e'' + K_D e' + K_P e = 0, in any
    configuration, singular ones included: no inverse of a Jacobian is in it.

    No file names it: it is the law of a stage with a path of joints.
    """

    kind = "computed torque"
    title = "inverse dynamics in joint space"
    equations = "H (q''_d + K_D (q'_d - q') + K_P (q_d - q)) + C q' + g"
    gains = ()
    axis_springs = False

    @property
    def holds_null_space(self) -> bool:
        """It decides about all joints."""
        return False

    def command(self, case: Case) -> Command:
        """Accelerations of all joints."""
        return Command(wrench=0 * case.state.f, joint_acceleration=case.joint_motion())

    def design(self, axis: object) -> dict[str, Gain]:  # noqa: ARG002
        """Nothing: no axis of the tool is controlled."""
        return {}

    @staticmethod
    def joint_gains(joints: int) -> dict[str, dict[str, Gain]]:
        """K_P = w^2 and K_D = 2 w of every joint, w = 2 pi 5 Hz: critically damped."""
        w = 2 * math.pi * BANDWIDTH
        gains = {
            "K_P": Gain(w**2, f"designed: (2 pi {BANDWIDTH:g} Hz)^2"),
            "K_D": Gain(2 * w, f"designed: 2 (2 pi {BANDWIDTH:g} Hz)"),
        }
        return {
            name: {f"joint.{i + 1}": gain for i in range(joints)} for name, gain in gains.items()
        }


COMPUTED_TORQUE = ComputedTorque()
