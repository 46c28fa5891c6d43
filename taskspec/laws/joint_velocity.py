"""Velocities of the joints: what follows a path of joints of an arm that takes no torques."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws import design
from taskspec.laws.gains import Gain
from taskspec.laws.law import ControlLaw

if TYPE_CHECKING:
    from taskspec.laws.case import Case


class JointVelocity(ControlLaw):
    """q' = q'_d + w (q_d - q), joint by joint, in any configuration, singular ones included.

    No file names it: it is the law of a stage with a path of joints, as computed torque is that of
    an arm that takes torques.
    """

    kind = "joint velocities"
    title = "joint velocities along a path of joints"
    equations = "q' = q'_d + w (q_d - q)"
    gains = ()
    commands = "velocity"
    axis_springs = False

    @property
    def holds_null_space(self) -> bool:
        """It decides about all joints."""
        return False

    def command(self, case: Case) -> Command:
        """Velocities of all joints."""
        return Command(wrench=0 * case.state.f, joint_velocity=case.joint_rates())

    def design(self, axis: object) -> dict[str, Gain]:  # noqa: ARG002
        """Nothing: no axis of the tool is controlled."""
        return {}

    @staticmethod
    def joint_gains(joints: int) -> dict[str, dict[str, Gain]]:
        """w of every joint, as of the motion axes of laws that command velocities."""
        bandwidth = design.VELOCITY_BANDWIDTH
        gain = Gain(2 * math.pi * bandwidth, f"designed: 2 pi {bandwidth:g} Hz")
        return {"K_V": {f"joint.{i + 1}": gain for i in range(joints)}}


JOINT_VELOCITY = JointVelocity()
