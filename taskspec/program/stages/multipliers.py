"""A stage's constraints with their set points, integrals and the choice of coordinates."""

from __future__ import annotations

import casadi as ca

from taskspec.control.reference import opposite
from taskspec.deferred_methods import dataclass
from taskspec.laws.case import JointReference
from taskspec.laws.multipliers import Multipliers
from taskspec.motion import blend
from taskspec.program.algebra import length
from taskspec.program.clock import Clock
from taskspec.program.plan import StagePlan
from taskspec.program.reference.constraints import ConstraintSet, spread
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
        gaps: distance of the joints' references from each equation, phi(q_d) [m, rad]; empty
            where no path of joints is followed.
        residuals: length of what is left of the joint torques that set points are given as,
            u_phi,d - J_phi^T lambda_d [N m].
    """

    desired: dict[str, ca.SX]
    integrals: dict[str, ca.SX]
    updates: dict[str, ca.SX]
    gaps: dict[str, ca.SX]
    residuals: dict[str, ca.SX]


def equation_forces(
    plan: StagePlan, measurement: Measurement, joints: JointReference | None
) -> EquationForces:
    """References of the active equations; one without a set point is to bear no force.

    One that is given as joint torques is lambda_d = (J_phi J_phi^T)^-1 J_phi u_phi,d (4.103), with
    J_phi at the references of the joints, or where they are measured in a stage that has none.

    Args:
        plan: of the stage.
        measurement: of it.
        joints: references of its path of joints, if it has one.
    """
    context = plan.context
    found, gains = EquationForces({}, {}, {}, {}, {}), plan.gains
    now, models = measurement.clock.clock, context.equations
    rows = {name: model.on_joints(context.robot) for name, model in models.items()}
    if joints is not None:
        found.gaps.update((name, row(joints.position, now)[0]) for name, row in rows.items())
    for name in plan.active:
        slot = f"equation.{name}"
        point = plan.spec.constraints.get(name)
        if point is None:
            wanted = ca.SX(0)
        elif point.wanted is not None:
            wanted = measurement.translate(point.wanted)
        else:
            q = measurement.inputs.q if joints is None else joints.position
            J = rows[name](q, now)[1]
            u = ca.vertcat(*(measurement.translate(each) for each in point.expressions))
            wanted = spread(J, u)
            found.residuals[name] = length(u - J.T @ wanted)
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
