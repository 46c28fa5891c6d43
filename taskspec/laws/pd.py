"""PD control with gravity compensation (section 4.1)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws import energy
from taskspec.laws.gains import DAMPING, STIFFNESS
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    from taskspec.laws.case import Case
    from taskspec.laws.energy import Energy


@register
class PD(ControlLaw):
    """PD with gravity compensation, (4.21): u = J^T (K_m e - D_m x') + g.

    It is one for set points: a reference that moves is dragged against.
    """

    kind = "pd"
    title = "PD control with gravity compensation"
    equations = "(4.21)"
    gains = (STIFFNESS, DAMPING)
    natural = True
    rest = "(4.26), (4.27)"
    storage = "1/2 q'^T H q' + 1/2 e^T K_m e, (4.22)"

    def command(self, case: Case) -> Command:
        """(4.21) with K_m, D_m in the task frame."""
        error, velocity = case.reference.error, case.state.velocity
        return Command(wrench=case.times("stiffness", error) - case.times("damping", velocity))

    def energy(self, case: Case) -> Energy:
        """(4.22), of which its damper takes x'^T D_m x', (4.23)."""
        return energy.of_the_arm(case, damped=-case.state.velocity)

    def drag(self, gains: Mapping[str, float]) -> float | None:
        """D_m: it damps the velocity itself."""
        return gains["damping"]
