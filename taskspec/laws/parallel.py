"""Parallel force/position control (section 4.2): a force loop that wins over the position loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from taskspec.control.command import Command
from taskspec.laws import energy
from taskspec.laws.conditions import AxisContact, StabilityCondition, rigid_loop, rigid_mass
from taskspec.laws.gains import (
    DAMPING,
    FORCE_INTEGRAL,
    FORCE_PROPORTIONAL,
    MASS,
    STIFFNESS,
    Gains,
    LawGain,
)
from taskspec.laws.law import ControlLaw, give_way, register

if TYPE_CHECKING:
    import casadi as ca

    from taskspec.laws.case import Case
    from taskspec.laws.energy import Energy


@register
class Parallel(ControlLaw):
    """Parallel control by inverse dynamics, (4.36)-(4.38).

    u_0 = x''_d + H_m^-1 (D_m e' + K_m e) - H_m^-1 (K_F (f_d - f) + K_I int (f_d - f) dt)

    With K_F = 1, K_I = 0 and f_d = 0 this is the impedance law (4.16). That is what it is on a
    motion axis along a contact's normal, which so yields to the surface that it meets; f_d is there
    what the last stage held, as it is released.
    """

    kind = "parallel"
    title = "parallel force/position control"
    equations = "(4.36)-(4.39)"
    gains: ClassVar[tuple[LawGain, ...]] = (
        MASS,
        STIFFNESS,
        DAMPING,
        FORCE_PROPORTIONAL,
        FORCE_INTEGRAL,
    )
    mechanism_form = True
    force_loop = True
    follows = ("damping", "force.integral")
    shares = True
    rest = "(4.15), (4.24)"
    storage = "1/2 e'^T H_m e' + 1/2 e^T K_m e"

    def command(self, case: Case) -> Command:
        """(4.36)-(4.38); K_F, K_I are zero on other axes without a force."""
        if case.free is not None:
            return _on_mechanism(case)
        state, reference = case.state, case.reference
        velocity_error = reference.velocity - state.velocity
        motion = case.times("damping", velocity_error) + case.times("stiffness", reference.error)
        force = _proportional(case) + case.times("force.integral", reference.force_integral)
        acceleration = reference.acceleration + case.by_mass(motion - force)
        return Command(acceleration=acceleration, wrench=-state.f)

    def energy(self, case: Case) -> Energy | None:
        """That of (4.36) without its force loop, whose terms put in and take."""
        if case.free is not None:
            return None
        added = _proportional(case) + case.state.f
        wound = case.times("force.integral", case.reference.force_integral)
        return energy.of_a_mass(case, case.state.axes, added, wound)

    def settles_at(self, *, moves: bool, reached: bool) -> str:
        """(4.39) with a velocity on the axis, (4.41), or (4.48) where no contact returns it."""
        return "(4.39)" if moves else "(4.41)" if reached else "(4.48)"

    def gives_way(self, gains: Gains, axes: Sequence[str]) -> list[float] | None:
        """k_I / k_m; without an integral the motion decides too, and that is open."""
        if any(gains["force.integral"][a].value <= 0 for a in axes):
            return None
        return give_way(gains, axes, "stiffness")

    def pulls(self, gains: Mapping[str, float], rate: float) -> float:
        """a.(f - f_d) = -(k_m / k_I) a.x'_d, from (4.39)."""
        return gains["stiffness"] / gains["force.integral"] * rate

    def conditions(self, at: AxisContact) -> Iterator[StabilityCondition]:
        """(4.46), and (4.17), (4.39) on a rigid contact."""
        g, k_e = at.gains, at.stiffness
        if at.force:
            bound = g["damping"] * (g["stiffness"] + g["force.proportional"] * k_e)
            yield StabilityCondition(
                "(4.46)", at.axis, "d_m (k_m + k_F k_e) > h_m k_I k_e",
                "force.integral", g["force.integral"], bound / (g["mass"] * k_e),
            )  # fmt: skip
        if at.rigid and at.normal:
            yield rigid_mass(at)
        elif at.rigid and at.force:
            yield from rigid_loop(at, self.last_equation, at.mass / g["mass"], uncancelled=1.0)


def _proportional(case: Case) -> ca.SX:
    """K_F (f_d - f) (m,); K_F is 1 along a contact's normal, which so yields."""
    reference = case.reference
    missing = reference.force + reference.released - case.state.f
    return case.times("force.proportional", missing, case.normal)


def _on_mechanism(case: Case) -> Command:
    """The form for a held mechanism: (4.36) with H_m = Lambda, and no measured force taken off.

    A motion axis has K_P = k_m / h_m and K_D = d_m / h_m; on a force axis the robot applies
    k_m e + f_d + (K_F - 1)(f_d - f) + K_I int (f_d - f) dt, since f itself acts, K_F = 1.
    """
    assert case.free is not None
    state, reference = case.state, case.reference
    mass, stiffness, damping = case.diagonals("mass", "stiffness", "damping")
    drives = {}
    for axis in case.force:
        i = state.axes.index(axis)
        error = reference.force[i] - state.f[i]
        force = reference.force[i] + (case.gain("force.proportional", axis) - 1) * error
        force += case.gain("force.integral", axis) * reference.force_integral[i]
        drives[axis] = stiffness[i] * reference.error[i] + case.applied(force)
        if case.gains["damping"][axis].origin == "file":
            drives[axis] += damping[i] * (reference.velocity[i] - state.velocity[i])
    K_P, K_D = stiffness / mass, damping / mass
    # Loaded here: it needs CasADi, which a file that is only read does not.
    from taskspec.laws import mechanism_form

    return mechanism_form.command(case, case.free, drives, K_P, K_D)
