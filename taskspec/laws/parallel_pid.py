"""The parallel PID regulator (section 4.2): parallel control without a model but gravity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws import energy
from taskspec.laws.conditions import AxisContact, StabilityCondition, rigid_loop
from taskspec.laws.gains import DAMPING, FORCE_INTEGRAL, FORCE_PROPORTIONAL, STIFFNESS
from taskspec.laws.law import register
from taskspec.laws.parallel import Parallel

if TYPE_CHECKING:
    import casadi as ca

    from taskspec.laws.case import Case
    from taskspec.laws.energy import Energy


@register
class ParallelPID(Parallel):
    """The parallel PID regulator, (4.50): position PD, gravity, force feedforward and force PI.

    u = J^T [k_m e - d_m x' - (f_d + k_F (f_d - f) + k_I int (f_d - f) dt)] + g

    Needs no dynamic model but gravity; for set points. On a motion axis f_d is what the last stage
    held, as it is released, and k_F and k_I are zero.
    """

    kind = "parallel-pid"
    title = "the parallel PID regulator"
    equations = "(4.50)"
    gains = (STIFFNESS, DAMPING, FORCE_PROPORTIONAL, FORCE_INTEGRAL)
    natural = True
    rest = "(4.26), (4.27)"
    storage = "1/2 q'^T H q' + 1/2 e^T K_m e, (4.22)"

    def command(self, case: Case) -> Command:
        """(4.50)."""
        state, reference = case.state, case.reference
        force = _proportional(case) + case.times("force.integral", reference.force_integral)
        springs = case.times("stiffness", reference.error)
        return Command(wrench=springs - case.times("damping", state.velocity) - force)

    def energy(self, case: Case) -> Energy:
        """(4.22) of its springs; the terms of its force loop put in and take."""
        wound = case.times("force.integral", case.reference.force_integral)
        return energy.of_the_arm(case, -case.state.velocity, force=_proportional(case),
                                 integral=wound)  # fmt: skip

    def drag(self, gains: Mapping[str, float]) -> float | None:
        """d_m: it damps the velocity itself."""
        return gains["damping"]

    def conditions(self, at: AxisContact) -> Iterator[StabilityCondition]:
        """(4.70), (4.71) with the region shrunk to the equilibrium, the scalar twin of (4.61)."""
        if not at.force:
            return
        k_e = at.stiffness
        d, k, k_F, k_I = (
            at.gains[name]
            for name in ("damping", "stiffness", "force.proportional", "force.integral")
        )
        yield StabilityCondition(
            "(4.70), (4.71)", at.axis, "rho (1 + k_F) > k_I, d_m > rho lambda_max(H_x)",
            "force.integral", k_I, (1 + k_F) * d / at.largest_mass(),
        )  # fmt: skip
        yield StabilityCondition(
            "(4.61), one axis", at.axis, "d_m (k_m + (1 + k_F) k_e) > Lambda_n k_I k_e",
            "force.integral", k_I, d * (k + (1 + k_F) * k_e) / (at.mass * k_e),
        )  # fmt: skip
        if at.rigid:
            yield from rigid_loop(at, self.last_equation)


def _proportional(case: Case) -> ca.SX:
    """f_d + k_F (f_d - f) (m,)."""
    desired = case.reference.force + case.reference.released
    return desired + case.times("force.proportional", desired - case.state.f)
