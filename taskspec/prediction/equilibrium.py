"""Forces and depths of a stage at rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.face import Face, face, springs_and_loads
from taskspec.prediction.moving_surface import change
from taskspec.prediction.reach import Bearing, along, bearing
from taskspec.prediction.set_points import drift, settled, span_of
from taskspec.prediction.springs import behind, push, yield_of
from taskspec.prediction.types import Depth, Equilibrium
from taskspec.prediction.worlds import ContactWorld, extreme
from taskspec.program.execution.stage_solver import ReturnedForces
from taskspec.program.signals import applied
from taskspec.program.walk.held_motion import coordinate_rate
from taskspec.stability.sampled_stage import SampledStage

Vector = NDArray[np.float64]

#: What a force axis reaches differs from its set point by more than this share: it is told.
_DIFFERS = 1e-3


@dataclass(slots=True)
class Rest:
    """A stage at rest: forces by signal, depths by contact, `StagePrediction.drift`.

    What is left out is so by signal, with the reason.
    """

    forces: dict[str, Equilibrium] = field(default_factory=dict)
    depths: dict[str, Depth] = field(default_factory=dict)
    drift: float = 0.0
    left_out: dict[str, str] = field(default_factory=dict)


def at_rest(
    here: StageAtStart,
    lasts: float | None,
    returned: ReturnedForces | None,
    sampled: SampledStage | None,
    begins: float,
) -> Rest:
    """Forces that a stage comes to and how deep its contacts are then.

    Args:
        here: the stage.
        lasts: how long [s], where that is known.
        returned: under a program, what contacts return of its set points.
        sampled: its loop, where there is one.
        begins: on the run's clock, as far as that is known [s].
    """
    rest = Rest()
    on = bearing(here)
    _set_points(here, on, lasts, returned, rest)
    _springs(here, on, rest)
    _moving(here, on, (sampled, begins, lasts), rest)
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
    rest.left_out |= {
        applied(axis): "its set point is not one of params and time"
        for axis in spans
        if axis not in known
    }
    why = _unsettled(here, on)
    if why:
        rest.left_out |= {applied(axis): why for axis in known if not axis.is_rotation}
        known = {axis: span for axis, span in known.items() if axis.is_rotation}
    linear = [axis for axis in known if not axis.is_rotation]
    if len(known) < len(spans):
        known = {a: s for a, s in known.items() if a not in linear} if linear else known
        linear = []
    ends = [settled(here, on, {a: known[a][i] for a in linear}) for i in range(3)]
    for axis, span in known.items():
        values = [end[axis] for end in ends if end is not None] if axis in linear else list(span)
        if len(values) < 3:
            rest.left_out[applied(axis)] = "without an integral the motion decides too"
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


def _unsettled(here: StageAtStart, on: Bearing) -> str:
    """Why loops do not come to their set points; empty if they do, or if that is for others."""
    plan = here.stage.plan
    law, integral = plan.law.control_law, "force.integral" in plan.gains
    if law.multipliers and not integral and on.friction > 0:
        rough = next(o for o in on.names if here.context.loaded.task.shapes[o].friction > 0)
        return f"the law has no integral, and friction of {rough!r} acts on it"
    if law.natural and plan.moving_base is not None:
        return "the frame moves, and the law leaves the arm its own inertia"
    return ""


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
        if deepest <= 0:
            continue
        rest.depths[name] = _depth(here, name, deepest)


def _depth(here: StageAtStart, name: str, bears: float, angular: bool = False) -> Depth:
    depth = bears / here.context.compliances[name].stiffness
    worst = extreme(here.context, name, lambda world: bears / world.stiffness, abs)
    return Depth(name, bears, depth, angular, worst)


def _springs(here: StageAtStart, on: Bearing, rest: Rest) -> None:
    """The axis along a contact's normal that a spring of the law holds."""
    context, stage = here.context, here.stage
    if (
        stage.plan.contacts.main is None
        or stage.plan.contacts.main not in on.names
        or stage.plan.frame.at_origin
    ):
        return
    name = stage.plan.contacts.main
    normal = on.normals[:, on.names.index(name)]
    if stage.plan.falls:
        plans = stage.plan.plans
        pressing = [a for a in plans if along(normal[:, None], a) is not None]
        why = "nothing bears the weight of the arm, and it falls"
        rest.left_out |= {applied(a): why for a in pressing}
        return
    found, own = behind(here, normal[:, None]), yield_of(here, normal)
    if found is None or own is None or found[1] <= 0:
        _why_open(here, on.normals, found is not None and found[1] <= 0, own, rest)
        return
    axis, depth = found
    rim = face(here, name)
    if rim is not None:
        _rim(here, name, rim, (axis, depth), rest)
        return
    k = context.compliances[name].stiffness
    bears = push(depth, own, ContactWorld({}, k))
    share = -float(normal[AXES.index(axis)])
    value = share * bears

    def applies(world: ContactWorld) -> float:
        return share * push(depth, own, world)

    worst = extreme(context, name, applies, lambda force: abs(force - value))
    signal = applied(axis)
    source = stage.plan.law.control_law.rest
    rest.forces[signal] = Equilibrium(signal, value, value, value, source, worst)
    deepest = extreme(context, name, lambda w: push(depth, own, w) / w.stiffness, abs)
    rest.depths[name] = Depth(name, bears, bears / k, worst=deepest)


def _why_open(
    here: StageAtStart, normals: Vector, away: bool, own: float | None, rest: Rest
) -> None:
    """Why an open-loop force along a normal is left out."""
    for axis, plan in here.stage.plan.plans.items():
        if plan.open_loop and along(normals, axis) is not None and not away:
            why = "its set point is not one of params alone"
            rest.left_out[applied(axis)] = "the law has no spring there" if own is None else why


def _moving(
    here: StageAtStart,
    on: Bearing,
    when: tuple[SampledStage | None, float, float | None],
    rest: Rest,
) -> None:
    """What surfaces change that move while the stage's frame does not go with them."""
    base, moving = here.stage.plan.moving_base, here.context.moving_bases
    for i, name in enumerate(on.names):
        if name not in moving or (base is not None and base.name == name):
            continue
        by = change(here, name, *when)
        if by == (0.0, 0.0):
            continue
        depth = rest.depths.pop(name, None)
        shares = {a: -float(on.normals[a.row, i]) for a in AXES[:3] if applied(a) in rest.forces}
        for axis, share in shares.items():
            if abs(share) < _DIFFERS:
                continue
            signal = applied(axis)
            force = rest.forces.pop(signal)
            if here.stage.plan.plans[axis].open_loop:
                rest.left_out[signal] = f"{name!r} moves, and the reference below it too"
                depth = None
                continue
            if by is None or depth is None:
                rest.left_out[signal] = f"{name!r} moves"
                continue
            if depth.push + by[0] <= 0:
                rest.left_out[signal] = f"{name!r} moves, and leaves the tool"
                continue
            ends = sorted(share * change for change in by)
            low, high = force.low + ends[0], force.high + ends[1]
            source = f"{force.source}; {name} moves"
            rest.forces[signal] = Equilibrium(signal, force.value, low, high, source)
        if by is not None and depth is not None and depth.push + by[0] > 0:
            stiffness = here.context.compliances[name].stiffness
            push = depth.push + by[1]
            deep = depth.depth + by[1] / stiffness
            rest.depths[name] = Depth(name, push, deep, source="f / k at most")


def _rim(here: StageAtStart, name: str, rim: Face, pressed: tuple[Axis, float], rest: Rest) -> None:
    """What springs press with through a flat tool that does not lie flush.

    The reference of a set point without a loop goes with the gap: it is a force, whatever leans.
    """
    context = here.context
    axis, depth = pressed
    springs, loads = springs_and_loads(here, {})
    row, open_loop = AXES.index(axis), here.stage.plan.plans[axis].open_loop
    if open_loop:
        own, springs[row] = 1.0 / float(springs[row]), 0.0
        normal = here.rotation.T @ here.stage.plan.contacts.normal(name)
    if context.loaded.task.shapes[name].friction > 0:
        why = f"the tool does not lie flush, and friction of {name!r} holds its edge"
        rest.left_out[applied(axis)] = why
        return

    def bears(world: ContactWorld) -> tuple[Vector, float]:
        behind = depth - world.farther
        if open_loop:
            loads[row] = -float(normal[row]) * push(depth, own, world)
            behind = abs(loads[row]) / world.stiffness
        found = rim.bears(springs, loads, behind, world.stiffness)
        return (np.full(6, math.nan), math.nan) if found is None else found

    now = ContactWorld({}, context.compliances[name].stiffness)
    forces, deepest = bears(now)
    if not np.isfinite(forces).all():
        rest.left_out[applied(axis)] = "the tool does not lie flush"
        return
    source = f"{here.stage.plan.law.control_law.rest}, not flush"
    for a in here.stage.plan.axes:
        along = AXES.index(a)
        if a is not axis and abs(forces[along]) < _DIFFERS * float(np.abs(forces).max()):
            continue
        value = float(forces[along])

        def there(world: ContactWorld, along: int = along) -> float:
            return float(bears(world)[0][along])

        def off(force: float, value: float = value) -> float:
            return abs(force - value)

        worst = extreme(context, name, there, off)
        rest.forces[applied(a)] = Equilibrium(applied(a), value, value, value, source, worst)
    worst = extreme(context, name, lambda world: bears(world)[1], abs)
    bearing = float(np.linalg.norm(forces[:3]))
    rest.depths[name] = Depth(name, bearing, deepest, worst=worst)


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
    name = stage.plan.contacts.held
    rate = coordinate_rate(stage.plan) if name else None
    if not rate:
        return
    held = context.loaded.task.mechanisms[name]
    value = float(np.sign(rate)) * held.friction + held.damping * rate
    signal = f"{name}.{'torque' if held.angular else 'force'}"
    rest.forces[signal] = Equilibrium(signal, value, value, value, "friction and damping")
