"""Hybrid force/velocity control resolved in joint velocities, under holonomic constraints."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from taskspec.control.command import Command
from taskspec.laws import design
from taskspec.laws.force_velocity import ForceVelocity
from taskspec.laws.gains import AxisDesign, Gain
from taskspec.laws.law import Solve, register

if TYPE_CHECKING:
    from taskspec.laws.case import Case


@register
class HybridVelocity(ForceVelocity):
    """The motion of all joints that is nearest to what the motion loops command.

    Motion axes, joints:      x' = x'_d + w e, w = 2 pi bandwidth.
    Force axes, equations:    J_phi q' + r_t = (p (l_d - l) + i int (l_d - l) dt) / d.

    The constraints decide as many coordinates as there are of them, and leave the others as the
    motion loops command them; force axes yield first. J_phi has unit normals, r_t is how fast a
    constraint moves by itself, and l is what the robot applies along it.
    """

    kind = "hybrid-velocity"
    title = "hybrid force/velocity control by joint velocities"
    equations = "J_phi q' + r_t = (p (l_d - l) + i int (l_d - l) dt) / d"
    solve: ClassVar[Solve] = "qp"
    dual = "hybrid-multipliers"
    multipliers = True

    def design_equation(self, axis: AxisDesign) -> dict[str, Gain]:
        """p, i and d along the unit gradient of an equation, whatever others hold the arm."""
        held = replace(axis.plant, h=axis.plant.held)
        return design.velocities(self, replace(axis, force=True, plant=held))

    def command(self, case: Case) -> Command:
        """The velocities of all joints."""
        motion, on = case.joint_rates(), case.constraints
        nothing = 0 * case.state.f
        if on is None:
            return Command(wrench=nothing, joint_velocity=motion, motion=motion)
        p, i, d = (on.diagonal(case.gains, f"force.{name}") for name in _FORCE_GAINS)
        missing = case.applied(p * (on.desired - on.measured) + i * on.integral)
        carried = on.closing - on.J @ case.joint_velocity
        kept = on.nearest(motion + on.held, carried - missing / d)
        return Command(wrench=nothing, joint_velocity=kept, motion=motion)


_FORCE_GAINS = ("proportional", "integral", "damping")
