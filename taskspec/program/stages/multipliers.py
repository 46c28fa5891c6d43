"""A stage's constraints with their set points, integrals and the choice of coordinates."""

from __future__ import annotations

import casadi as ca

from taskspec.control.reference import opposite
from taskspec.deferred_methods import dataclass
from taskspec.laws.multipliers import Multipliers
from taskspec.motion import blend
from taskspec.program.clock import Clock
from taskspec.program.plan import StagePlan
from taskspec.program.reference.constraints import ConstraintSet
from taskspec.program.reference.force_references import risen, wound
from taskspec.program.reference.measurement import Measurement
from taskspec.program.reference.reference_set import ReferenceSet
from taskspec.program.slots import Slots


@dataclass(frozen=True, slots=True)
class EquationForces:
    """Set points and integrals of the equations that constrain a stage, as the robot applies them.

    Attributes:
        desired: by equation [N, N m].
        integrals: of desired - measured.
        updates: of the memory.
    """

    desired: dict[str, ca.SX]
    integrals: dict[str, ca.SX]
    updates: dict[str, ca.SX]


def equation_forces(plan: StagePlan, measurement: Measurement) -> EquationForces:
    """References of the active equations; one without a set point is to bear no force."""
    context = plan.context
    found, gains = EquationForces({}, {}, {}), plan.gains
    for name in plan.active:
        slot = f"equation.{name}"
        point = plan.spec.constraints.get(name)
        wanted = ca.SX(0) if point is None else measurement.translate(point.wanted)
        ramp = None if point is None else point.ramp
        rising = risen(slot, wanted, ramp, measurement.clock, measurement.parameters)
        force = found.desired[name] = measurement.infeasible.reachable(name, rising)
        if "force.integral" not in gains:
            continue
        memorised = f"integral.{slot}"
        found.integrals[name] = found.updates[memorised] = wound(
            measurement.memory.add(memorised),
            force,
            measurement.infeasible.step(
                name, context.period * (force - measurement.reactions[name])
            ),
            gains["force.integral"][name].value,
            measurement.table["touching"],
            ca.SX(0),
        )
    return found


def constrain(
    chosen: ConstraintSet,
    forces: EquationForces,
    references: ReferenceSet,
    clock: Clock,
    parameters: Slots,
) -> Multipliers:
    """The constraints of a stage as its law sees them."""
    desired: dict[str, ca.SX] = dict(references.force_ref.items())
    desired |= forces.desired
    integrals: dict[str, ca.SX] = dict(references.integrals.items())
    integrals |= forces.integrals
    zero = ca.SX(0)
    n = chosen.J.shape[1]
    held, since = parameters.add("held", n), parameters.add("chosen_at")
    return Multipliers(
        names=chosen.names,
        J=chosen.J,
        gamma=chosen.gamma,
        directions=chosen.directions,
        closing=chosen.closing,
        desired=opposite(ca.vertcat(*(desired[name] for name in chosen.names))),
        measured=opposite(chosen.measured),
        integral=opposite(ca.vertcat(*(integrals.get(name, zero) for name in chosen.names))),
        held=held * blend.offset_shape((clock.t - since) / blend.BLEND_TIME),
    )
