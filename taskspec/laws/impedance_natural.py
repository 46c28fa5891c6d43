"""Impedance control at the robot's natural inertia (section 4.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws import energy
from taskspec.laws.gains import DAMPING, STIFFNESS
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    from taskspec.laws.case import Case
    from taskspec.laws.energy import Energy


@register
class ImpedanceNatural(ControlLaw):
    """Impedance at the robot's natural inertia, H_m = H_x(q), (4.18)-(4.20): no force sensor.

    u = H J^-1 (x''_d - J' q') + C q' + g + J^T (D_m e' + K_m e)
    """

    kind = "impedance-natural"
    title = "impedance control at the arm's own inertia"
    equations = "(4.18)-(4.20)"
    gains = (STIFFNESS, DAMPING)
    natural = True
    feeds_forward = True
    rest = "(4.18), (4.24)"
    storage = "1/2 q'^T H q' + 1/2 e^T K_m e, (4.22)"

    def command(self, case: Case) -> Command:
        """(4.18)-(4.20) with K_m, D_m in the task frame."""
        state, reference = case.state, case.reference
        velocity_error = reference.velocity - state.velocity
        return Command(
            acceleration=reference.acceleration,
            wrench=case.times("damping", velocity_error) + case.times("stiffness", reference.error),
        )

    def energy(self, case: Case) -> Energy:
        """(4.22), of which its damper takes e'^T D_m e'."""
        return energy.of_the_arm(case, damped=case.reference.velocity - case.state.velocity)
