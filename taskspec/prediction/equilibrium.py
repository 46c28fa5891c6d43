"""Forces and depths of a stage at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from taskspec.foresight.held_motion import coordinate_rate
from taskspec.geometry.axis import AXES, Axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.reach import Bearing, bearing
from taskspec.prediction.set_points import drift, settled, span_of
from taskspec.prediction.springs import behind, push, yield_of
from taskspec.prediction.types import Depth, Equilibrium
from taskspec.prediction.worlds import World, extreme
from taskspec.program.execution.stage_solver import ReturnedForces
from taskspec.program.signals import applied

Vector = NDArray[np.float64]

#: What a force axis reaches differs from its set point by more than this share: it is told.
_DIFFERS = 1e-3


@dataclass(slots=True)
class Rest:
    """A stage at rest: forces by signal, depths by contact, `StagePrediction.drift`."""

    forces: dict[str, Equilibrium] = field(default_factory=dict)
    depths: dict[str, Depth] = field(default_factory=dict)
    drift: float = 0.0


def at_rest(here: StageAtStart, lasts: float | None, returned: ReturnedForces | None) -> Rest:
    """Forces that a stage comes to and how deep its contacts are then.

    Args:
        here: the stage.
        lasts: how long [s], where that is known.
        returned: under a program, what contacts return of its set points.
    """
    rest = Rest()
    on = bearing(here)
    _set_points(here, on, lasts, returned, rest)
    _springs(here, on, rest)
    _equations(here, lasts, returned, rest)
    _mechanism(here, rest)
    return rest


def _set_points(
    here: StageAtStart,
    on: Bearing,
    lasts: float | None,
    returned: ReturnedForces | None,
    rest: Rest,
) -> None:
    """Axes with a force loop, and the depths of the contacts that bear them."""
    spans = {}
    for axis, plan in here.stage.plan.plans.items():
        force = plan.axis.set_point
        if plan.force and force is not None:
            spans[axis] = span_of(here.context, force.wanted, lasts)
    known = {axis: span for axis, span in spans.items() if span is not None}
    linear = [axis for axis in known if not axis.is_rotation]
    if len(known) < len(spans):
        known = {a: s for a, s in known.items() if a not in linear} if linear else known
        linear = []
    ends = [settled(here, on, {a: known[a][i] for a in linear}) for i in range(3)]
    for axis, span in known.items():
        values = [end[axis] for end in ends if end is not None] if axis in linear else list(span)
        if len(values) < 3:
            continue
        first, low, high = values
        if returned is not None and returned.left.get(axis):
            first = low = high = returned.forces[axis] - returned.left[axis]
        reached = abs(first - span[0]) <= _DIFFERS * abs(span[0])
        source = _loop(here, axis, reached=reached)
        rest.forces[applied(axis)] = Equilibrium(applied(axis), first, low, high, source)
    linear = [axis for axis in linear if applied(axis) in rest.forces]
    if linear and returned is None:
        rest.drift = drift(here, {a: known[a][0] - rest.forces[applied(a)].value for a in linear})
    if linear:
        _depths(here, on, {a: rest.forces[applied(a)] for a in linear}, rest)


def _loop(here: StageAtStart, axis: Axis, *, reached: bool) -> str:
    stage = here.stage
    law, moves = stage.plan.law.control_law, stage.plan.plans[axis].mode.goes_on
    if not law.shares and stage.resolution is not None and not reached:
        return "nearest that contacts return"
    return law.settles_at(moves=moves, reached=reached)


def _depths(here: StageAtStart, on: Bearing, forces: Mapping[str, Equilibrium], rest: Rest) -> None:
    """f = -N push over the force axes: what each contact bears, and f/k."""
    if not on.names:
        return
    rows = [AXES.index(a) for a in forces]
    N = on.normals[rows]
    pushes = [
        np.linalg.lstsq(-N, np.array([getattr(f, end) for f in forces.values()]), rcond=None)[0]
        for end in ("value", "low", "high")
    ]
    for i, name in enumerate(on.names):
        if not np.any(np.abs(N[:, i]) > 0):
            continue
        deepest = max((float(p[i]) for p in pushes), key=abs)
        if deepest > 0:
            rest.depths[name] = _depth(here, name, deepest)


def _depth(here: StageAtStart, name: str, bears: float, angular: bool = False) -> Depth:
    depth = bears / here.context.compliances[name].stiffness
    worst = extreme(here.context, name, lambda world: bears / world.stiffness, abs)
    return Depth(name, bears, depth, angular, worst)


def _springs(here: StageAtStart, on: Bearing, rest: Rest) -> None:
    """The axis along a contact's normal that a spring of the law holds."""
    context, stage = here.context, here.stage
    if (
        stage.plan.contact is None
        or stage.plan.contact not in on.names
        or stage.plan.frame.at_origin
    ):
        return
    name = stage.plan.contact
    normal = on.normals[:, on.names.index(name)]
    found, own = behind(here, normal[:, None]), yield_of(here, normal)
    if found is None or own is None or found[1] <= 0:
        return
    axis, depth = found
    k = context.compliances[name].stiffness
    bears = push(depth, own, World({}, k))
    share = -float(normal[AXES.index(axis)])
    value = share * bears

    def applies(world: World) -> float:
        return share * push(depth, own, world)

    worst = extreme(context, name, applies, lambda force: abs(force - value))
    signal = applied(axis)
    source = stage.plan.law.control_law.rest
    rest.forces[signal] = Equilibrium(signal, value, value, value, source, worst)
    deepest = extreme(context, name, lambda w: push(depth, own, w) / w.stiffness, abs)
    rest.depths[name] = Depth(name, bears, bears / k, worst=deepest)


def _equations(
    here: StageAtStart, lasts: float | None, returned: ReturnedForces | None, rest: Rest
) -> None:
    """Constraints of a law with multipliers: the set point along the unit gradient."""
    context, stage = here.context, here.stage
    if not stage.plan.law.control_law.multipliers:
        return
    for name in stage.plan.active:
        joints = context.equations[name].joints
        point = stage.plan.spec.constraints.get(name)
        span = (0.0, 0.0, 0.0) if point is None else span_of(context, point.wanted, lasts)
        if span is None:
            continue
        if returned is not None and returned.left.get(name):
            span = (returned.forces[name] - returned.left[name],) * 3
        signal = f"{name}.{'torque' if joints else 'force'}"
        rest.forces[signal] = Equilibrium(signal, *span, "set point")
        deepest = max(span, key=abs)
        if deepest:
            rest.depths[name] = _depth(here, name, deepest, joints)


def _mechanism(here: StageAtStart, rest: Rest) -> None:
    """What the held mechanism takes to go on at its rate: friction and damping."""
    context, stage = here.context, here.stage
    name = stage.plan.held
    rate = coordinate_rate(stage.plan) if name else None
    if not rate:
        return
    held = context.loaded.task.mechanisms[name]
    value = float(np.sign(rate)) * held.friction + held.damping * rate
    signal = f"{name}.{'torque' if held.angular else 'force'}"
    rest.forces[signal] = Equilibrium(signal, value, value, value, "friction and damping")
