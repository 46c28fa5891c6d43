"""Forces and moments that a stage comes to rest with, as its law has them in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.explain.bearing import Bearing, bearing
from taskspec.explain.rest_pose import rest_pose
from taskspec.explain.returned_forces import returned_at_start
from taskspec.explain.springs import spring_contact
from taskspec.geometry.axis import Axis
from taskspec.laws.gains import on_axis
from taskspec.program.execution.stage_solver import ReturnedForces
from taskspec.program.plan import StagePlan
from taskspec.program.program import Program
from taskspec.program.signals import applied
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.walk.held_motion import coordinate_rate

#: A force at rest that differs from its set point by less than this share is the set point.
_DIFFERS = 1e-3
#: What is not returned is no more than this share of what is requested: rounding.
_ROUNDING = 1e-6
#: A flat tool that leans by less than this lies flush: it rests on the middle of its face [rad].
_FLUSH = 1e-5
#: A surface whose speed along its normal is below this stands [m/s].
_STANDS = 1e-9
#: Instants of the run at which a moving surface is looked at, and the last of them [s]; a prime,
#: so that they are not all at the turning points of a periodic motion.
_INSTANTS, _LAST = 41, 10.0


@dataclass(frozen=True, slots=True)
class RestValue:
    """A force or moment at rest, once ramps, blending and loops have settled.

    Attributes:
        value: what the robot applies [N, N m].
        source: what it follows from, with the equation's number.
    """

    value: float
    source: str


def rest_values(program: Program, stage: CompiledStage) -> dict[str, RestValue]:
    """By signal (`force.z`, `torque.rx`, `rim.force`, `crank.torque`), axes of the stage's frame.

    What moves while the stage lasts has none: a set point by time or signals, a surface that comes
    and goes below a frame that does not follow it. Nor has what a law leaves to friction or to
    the motion.
    """
    plan, returned = stage.plan, returned_at_start(program, stage)
    if plan.context.bushings:
        return _on_bushings(program, plan)
    found = _moments(plan)
    on = bearing(plan)
    if not any(_comes_and_goes(plan, name) for name in on.names):
        found |= _forces(plan, on) | _spring_force(plan)
    if returned is not None:
        for axis in (a for a in plan.plans if returned.left.get(a) and applied(a) in found):
            value = returned.forces[axis] - returned.left[axis]
            shares = plan.law.control_law.shares
            source = (
                _source(plan, axis, reached=False) if shares else "nearest that contacts return"
            )
            found[applied(axis)] = RestValue(value, source)
    return found | _equations(plan, returned) | _mechanism(plan)


def _on_bushings(program: Program, plan: StagePlan) -> dict[str, RestValue]:
    """All axes of a stage that rests on springs in six dimensions."""
    at = rest_pose(program.plan, plan)
    if at is None:
        return {}
    own = plan.law.control_law
    return {
        applied(axis): RestValue(
            float(at.applied[axis.row]),
            _source(plan, axis, reached=True) if plan.plans[axis].force else own.rest,
        )
        for axis in plan.axes
    }


def _set_points(plan: StagePlan) -> dict[Axis, float | None]:
    """Set points of axes with a force loop [N, N m]; None of one that is not constant."""
    found = {}
    for axis, one in plan.plans.items():
        if one.force and one.axis.set_point is not None:
            value = plan.known(one.axis.set_point.wanted)
            found[axis] = value if value is not None and math.isfinite(value) else None
    return found


def _moments(plan: StagePlan) -> dict[str, RestValue]:
    return {
        applied(axis): RestValue(wanted, _source(plan, axis, reached=True))
        for axis, wanted in _set_points(plan).items()
        if axis.is_rotation and wanted is not None
    }


def _forces(plan: StagePlan, on: Bearing) -> dict[str, RestValue]:
    """Translations with a force loop."""
    set_points = {a: v for a, v in _set_points(plan).items() if not a.is_rotation}
    wanted = {axis: value for axis, value in set_points.items() if value is not None}
    if len(wanted) < len(set_points) or _left_open(plan, on):
        return {}
    settled = _settled(plan, on, wanted)
    found = {}
    for axis, value in (settled or {}).items():
        reached = abs(value - wanted[axis]) <= _DIFFERS * abs(wanted[axis])
        found[applied(axis)] = RestValue(value, _source(plan, axis, reached=reached))
    return found


def _source(plan: StagePlan, axis: Axis, *, reached: bool) -> str:
    return plan.law.control_law.settles_at(moves=plan.plans[axis].mode.goes_on, reached=reached)


def _left_open(plan: StagePlan, on: Bearing) -> bool:
    """Whether force loops do not come to their set points.

    Without an integral, friction adds to the force; a law that leaves the arm its own inertia
    does not take off what accelerates it with a moving frame.
    """
    law = plan.law.control_law
    rubs = law.multipliers and "force.integral" not in plan.gains and on.friction > 0
    return rubs or (law.natural and plan.moving_base is not None)


def _settled(
    plan: StagePlan, on: Bearing, wanted: Mapping[Axis, float]
) -> dict[Axis, float] | None:
    """What is applied on force axes at rest [N]; None where the law leaves that open.

    Set points that contacts cannot return drift: then a f_E = a a^T f_d, (4.48), with each axis
    weighed by how fast its loop gives way. Friction holds what lies within its cone, and brakes
    with its limit beyond.

    Args:
        plan: of the stage.
        on: its contacts.
        wanted: set points of its force axes [N].
    """
    weights = plan.law.control_law.gives_way(plan.gains, [*wanted])
    if weights is None:
        return None
    requested = np.array([value + _pull(plan, axis) for axis, value in wanted.items()])
    if not on.names:
        return dict(zip(wanted, requested.tolist(), strict=True))
    N, root = on.normals[[axis.row for axis in wanted]], np.sqrt(weights)
    push = np.linalg.lstsq(-root[:, None] * N, root * requested, rcond=None)[0]
    returned = -N @ np.maximum(push, 0.0)
    rest = requested - returned
    size, most = float(np.linalg.norm(rest)), on.friction * float(np.maximum(push, 0.0).sum())
    if size > _ROUNDING * float(np.linalg.norm(requested)):
        returned = returned + rest * min(1.0, most / size)
    else:
        returned = requested
    return dict(zip(wanted, returned.tolist(), strict=True))


def _pull(plan: StagePlan, axis: Axis) -> float:
    """What a motion on a force axis adds to its set point [N]."""
    one = plan.plans[axis]
    if not one.motion or not one.mode.goes_on:
        return 0.0
    rate = one.mode.constant_rate(plan.known) or 0.0
    return plan.law.control_law.pulls(on_axis(plan.gains, axis), rate)


def _comes_and_goes(plan: StagePlan, name: str) -> bool:
    """Whether an object moves along its normal by itself, and the stage's frame not with it."""
    context, own = plan.context, plan.moving_base
    base = context.moving_bases.get(name)
    if base is None or (own is not None and own.name == name):
        return False
    normal = plan.contacts.normal(name)
    times = np.linspace(0.0, _LAST, _INSTANTS)
    rates = [normal @ base.twist(float(t), context.start_p)[:3] for t in times]
    return bool(np.max(np.abs(rates)) > _STANDS)


def _spring_force(plan: StagePlan) -> dict[str, RestValue]:
    """The axis along a contact's normal that a spring of the law holds."""
    found, context = spring_contact(plan), plan.context
    if found is None:
        return {}
    leans = np.linalg.norm(np.cross(context.start_R[:, 2], plan.rotation @ found.normal))
    if context.robot.tool.flat and leans > _FLUSH:
        return {}
    force = found.force(context.compliances[found.name].stiffness)
    return {applied(found.axis): RestValue(force, plan.law.control_law.rest)}


def _equations(plan: StagePlan, returned: ReturnedForces | None) -> dict[str, RestValue]:
    """Constraints of a law with multipliers: the set point along the unit gradient."""
    if not plan.law.control_law.multipliers:
        return {}
    found = {}
    for name in plan.active:
        point = plan.spec.constraints.get(name)
        value: float | None = 0.0
        if point is not None:
            value = None if point.wanted is None else plan.known(point.wanted)
        if returned is not None and returned.left.get(name):
            value = returned.forces[name] - returned.left[name]
        if value is not None:
            angular = plan.context.equations[name].angular
            found[f"{name}.{'torque' if angular else 'force'}"] = RestValue(value, "set point")
    return found


def _mechanism(plan: StagePlan) -> dict[str, RestValue]:
    """What the held mechanism takes to go on at its rate: friction and damping."""
    rate = coordinate_rate(plan) if plan.contacts.held else None
    if not rate:
        return {}
    held = plan.context.loaded.task.mechanisms[plan.contacts.held]
    value = float(np.sign(rate)) * held.friction + held.damping * rate
    signal = f"{plan.contacts.held}.{'torque' if held.angular else 'force'}"
    return {signal: RestValue(value, "friction and damping")}
