"""Stiffness control (section 4.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws import energy
from taskspec.laws.gains import STIFFNESS
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    from taskspec.laws.case import Case
    from taskspec.laws.energy import Energy


@register
class StiffnessControl(ControlLaw):
    """Stiffness control, (4.32) and (4.33): u = J^T K_m J (q_d - q).

    For the small deflections that it is made for, J (q_d - q) is e (4.32). Gravity is left to a
    counterweight and damping to the joints: by itself it does not settle.
    """

    kind = "stiffness"
    title = "stiffness control"
    equations = "(4.32), (4.33)"
    gains = (STIFFNESS,)
    natural = True
    bare = True
    undamped = "damping comes from 'robot.joint_damping'; or take the law pd"
    rest = "(4.33)"
    storage = "1/2 q'^T H q' + 1/2 e^T K_m e"

    def command(self, case: Case) -> Command:
        """(4.33) with K_m in the task frame."""
        return Command(wrench=case.times("stiffness", case.reference.error), bare=True)

    def energy(self, case: Case) -> Energy:
        """(4.22) without a damper: nothing takes of it."""
        return energy.of_the_arm(case)
