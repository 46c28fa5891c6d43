"""PD control with its damping in the joints (section 4.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws import energy
from taskspec.laws.gains import DAMPING, JOINT_DAMPING, STIFFNESS
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    import casadi as ca

    from taskspec.laws.case import Case
    from taskspec.laws.energy import Energy


@register
class PDJoint(ControlLaw):
    """PD with the damping in the joints, (4.31): u = J^T K_m e - D_q q' + g.

    It also stops what a redundant arm does in its null space.
    """

    kind = "pd-joint"
    title = "PD control with its damping in the joints"
    equations = "(4.31)"
    gains = (STIFFNESS, DAMPING)
    derived = (JOINT_DAMPING,)
    natural = True
    damps_joints = True
    undamped = "its damping is one of the joints"
    rest = "(4.26), (4.27)"
    storage = "1/2 q'^T H q' + 1/2 e^T K_m e, (4.22)"

    def command(self, case: Case) -> Command:
        """(4.31) with K_m (m, m) in the task frame, D_q (n,) in the joints."""
        return Command(wrench=case.times("stiffness", case.reference.error), joint=_damper(case))

    def energy(self, case: Case) -> Energy:
        """(4.22), of which its damper takes q'^T D_q q'."""
        return energy.of_the_arm(case, in_joints=_damper(case))


def _damper(case: Case) -> ca.SX:
    """-D_q q' (n,) [N m]."""
    return -case.of_joints("joint_damping") * case.joint_velocity
