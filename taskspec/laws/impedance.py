"""Impedance control (section 4.1): the robot as a mass, a spring and a damper."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws import design, energy
from taskspec.laws.conditions import rigid_mass
from taskspec.laws.gains import DAMPING, MASS, STIFFNESS, AxisDesign, Gain
from taskspec.laws.law import LAWS, ControlLaw, register

if TYPE_CHECKING:
    import casadi as ca

    from taskspec.laws.case import Case
    from taskspec.laws.conditions import AxisContact, StabilityCondition
    from taskspec.laws.energy import Energy


@register
class Impedance(ControlLaw):
    """Impedance with force feedback, (4.16) and (4.17).

    u_0 = x''_d + H_m^-1 (D_m e' + K_m e + f), sent through the core that cancels f.
    """

    kind = "impedance"
    title = "impedance control with force feedback"
    equations = "(4.16), (4.17)"
    gains = (MASS, STIFFNESS, DAMPING)
    mechanism_form = True
    feeds_forward = True
    rest = "(4.15), (4.24)"
    storage = "1/2 e'^T H_m e' + 1/2 e^T K_m e"

    def design(self, axis: AxisDesign) -> dict[str, Gain]:
        """On a mechanism perhaps for the arm's own inertia, held by the springs of all axes."""
        law = self if axis.plant.damper is None else LAWS["impedance-natural"]
        return design.springs(law, axis)

    def command(self, case: Case) -> Command:
        """(4.16), (4.17) with H_m, K_m, D_m in the task frame.

        In the form for a held mechanism H_m is Lambda, and no measured force is taken off.
        """
        if case.free is not None:
            return _on_mechanism(case)
        state, reference = case.state, case.reference
        pull = _springs(case) + state.f
        return Command(acceleration=reference.acceleration + case.by_mass(pull), wrench=-state.f)

    def energy(self, case: Case) -> Energy:
        """That of the mass, spring and damper of (4.15); on a mechanism the arm's own mass."""
        if case.free is not None:
            return energy.of_the_arm(case, damped=case.reference.velocity - case.state.velocity)
        return energy.of_a_mass(case, case.state.axes)

    def strikes_with(self, gains: Mapping[str, Gain], arm_mass: float) -> float:  # noqa: ARG002
        """The apparent mass h_m."""
        return gains["mass"].value

    def conditions(self, at: AxisContact) -> Iterator[StabilityCondition]:
        """On a rigid contact, h_m > Lambda_n / 2."""
        if at.rigid:
            yield rigid_mass(at)


def _on_mechanism(case: Case) -> Command:
    """(4.16) with H_m = Lambda: D_m e' + K_m e is sent as a wrench, and f acts by itself."""
    return Command(acceleration=case.reference.acceleration, wrench=_springs(case))


def _springs(case: Case) -> ca.SX:
    """D_m e' + K_m e (m,)."""
    velocity_error = case.reference.velocity - case.state.velocity
    return case.times("damping", velocity_error) + case.times("stiffness", case.reference.error)
