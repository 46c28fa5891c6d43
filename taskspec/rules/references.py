"""References over the whole of their stage: where they have no value, jump, or last too long."""

from __future__ import annotations

import math
from collections.abc import Iterator

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.expression import Expression
from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import AXES
from taskspec.program.algebra import CasadiAlgebra
from taskspec.program.context import Context
from taskspec.program.known_value import known_value
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.reference.joint_motion import JointMotion
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import FILE, KeyPath
from taskspec.spec.params import slots_of
from taskspec.text.diagnostic import Severity
from taskspec.text.units import ANGLE, LENGTH, TIME, Dimension, fitting, show

Vector = NDArray[np.float64]

#: Ticks at which a reference is looked at; of a longer stage as many, evenly chosen.
_MOST = 20_000
#: A step of a planned position is a jump from this on [m, rad], and from so many times the steps
#: near it on: a motion that is resolved by its ticks changes little from one to the next. A jump
#: may take two ticks, as sign(t) is 0 in one, so those right beside it do not count.
_JUMP = {"linear": 2e-3, "angular": math.radians(1.0)}
_TIMES = 20.0
_NEAR = (2, 3)
#: A hundred days, and a share of any tick [s]: numbers of jerk-limited moves fail far beyond both.
_LONGEST, _SHORTEST = 1e7, 1e-9
#: What is shorter is no motion [m, rad].
_NOWHERE = 1e-12


@rule({}, also=("TS117",), phase=Phase.AXES)
def references_without_start(stage: StagePlan) -> Iterator[Finding]:
    """References that have no finite value when their stage begins."""
    expressions = [each for axis in stage.spec.axes.values() for each, _ in axis.expressions()]
    if stage.spec.path is not None:
        expressions += stage.spec.path.joint_motion
    for expression in expressions:
        value = known_value(stage.context, expression, {"t": 0.0, "clock": 0.0})
        if value is not None and not math.isfinite(value):
            yield error(
                "TS117",
                "this has no finite value at t = 0 s",
                expression.span,
                "mind what divides, and what stands under a root or in a logarithm",
            )


@rule("TS423", "a position that jumps", also=("TS117",), phase=Phase.AXES)
def references_over_time(stage: StagePlan) -> Iterator[Finding]:
    """References that depend on time alone and are not finite, or jump.

    A position is looked at with its rate and acceleration, which the laws use. What is not finite
    as the stage begins is reported as such.
    """
    context = stage.context
    motion = stage.joint_path if isinstance(stage.joint_path, JointMotion) else None
    end = stage.longest if motion is None else min(stage.longest, motion.time)
    if not math.isfinite(end):
        return
    times = _ticks(context, end)
    first = stage.name == next(iter(context.loaded.task.stages))
    clocks = {"t", "clock"} if first else {"t"}
    for place, expression, planned in _references(stage):
        values = _values(context, expression, planned, clocks, times)
        if values is None or not np.isfinite(values[0, 0]):
            continue
        wrong = np.flatnonzero(~np.isfinite(values).all(axis=0))
        if len(wrong):
            surely = stage.spec.until is None
            yield _undefined(expression, values, times, int(wrong[0]), surely=surely)
        elif place is not None and planned:
            yield from _jumps(place, expression, values[0], times)


@rule({}, also=("TS117",), phase=Phase.TASK)
def object_motions(task: TaskPlan) -> Iterator[Finding]:
    """Objects that move by an expression of `clock` which has no value while a run lasts.

    The plant's guards would stop the run there.
    """
    context, spec = task.context, task.context.loaded.task
    whole = sum(stage.longest for stage in task.stages.values())
    if not math.isfinite(whole):
        return
    times = _ticks(context, whole)
    for shape in spec.shapes.values():
        for expression in () if shape.motion is None else shape.motion.axes.values():
            values = _values(context, expression, True, {"clock"}, times)
            if values is None or not np.isfinite(values[0, 0]):
                continue
            wrong = np.flatnonzero(~np.isfinite(values).all(axis=0))
            if len(wrong):
                yield _undefined(expression, values, times, int(wrong[0]), surely=False)


@rule({}, also=("TS222",), phase=Phase.PATH)
def arcs_without_radius(stage: StagePlan) -> Iterator[Finding]:
    """An arc about the very point where its stage begins."""
    path = stage.path
    if path is None or not (path.form.unknown_length and path.form.relative) or stage.frame.still:
        return
    if path.length(dict.fromkeys(AXES, 0.0)) <= _NOWHERE:
        yield warning(
            "TS222",
            "this arc has no radius: in this frame x and y count from where the stage begins",
            FILE.stages[stage.name].path.arc,
            "put the center beside the tool, such as center: [20 mm, 0]",
        )


@rule("TS135", "a position that jumps where a live parameter is set", phase=Phase.AXES)
def jumping_params(stage: StagePlan) -> Iterator[Finding]:
    """Positions that follow from live params without a rate: their reference jumps with these."""
    task = stage.context.loaded.task
    jumps = {name for name, param in task.live.items() if not param.rate}
    for _, expression, planned in _references(stage):
        found = sorted(jumps & slots_of(task.params, expression.tree)) if planned else ()
        for name in found[:1]:
            unit = next(iter(fitting(task.live[name].dimension)), "1")
            yield warning(
                "TS135",
                f"this position jumps where '{name}' is set, which has no rate",
                expression.span,
                f"give it one in 'params', such as rate: 20 {unit}/s",
            )


@rule({}, also=("TS118",), phase=Phase.PATH)
def endless_motions(stage: StagePlan) -> Iterator[Finding]:
    """Moves and paths that take longer than any run, or no time at all."""
    own, path = FILE.stages[stage.name], stage.path
    for axis, entry in stage.spec.axes.items():
        mode = entry.mode
        if mode.distance is not None:
            yield from _endless(*mode.distance, own.axes[axis][mode.pace])
    if path is not None and path.speed is not None:
        length = path.length(dict.fromkeys(AXES, 0.0))
        yield from _endless(length, path.speed, own.path.speed)


@rule("TS609", "a path that signals slow, without a bound", phase=Phase.PATH)
def unbounded_paths(stage: StagePlan) -> Iterator[Finding]:
    """Paths that may stand still, in stages that nothing else ends."""
    within = stage.spec.within
    bounded = within is not None and within.time is not None
    if stage.path is None or stage.path.slowed is None or bounded or stage.least_share > 0:
        return
    yield error(
        "TS609",
        "signals slow this path, and nothing ends the stage if it stands still",
        FILE.stages[stage.name].path.speed,
        "add a bound, such as within: {time: 20 s}, or a least speed: clamp(.., 0.1, 1)",
    )


@rule("TS237", "a path that stands still at nominal signals", phase=Phase.PATH)
def standing_paths(stage: StagePlan) -> Iterator[Finding]:
    """Paths whose speed is 0 where set points are felt and nothing else is."""
    if stage.path is None or stage.path.slowed is None or stage.path_share > 0:
        return
    yield warning(
        "TS237",
        "this speed is 0 where the stage's set points are measured and every other signal is 0",
        FILE.stages[stage.name].path.speed,
        "a force is what the robot applies: force.z < 0 presses down; abs(force.z) has no sign",
    )


def _endless(length: float, speed: float, place: KeyPath) -> Iterator[Finding]:
    lasts = length / speed
    if not (length <= _NOWHERE or _SHORTEST <= lasts <= _LONGEST):
        yield error(
            "TS118",
            f"at this speed the motion takes {show(lasts, TIME, 2)}",
            place,
            "mind the units of the way and of the speed",
            stops=True,
        )


def _ticks(context: Context, end: float) -> Vector:
    """Seconds [s] at which a stage or a run of a length may tick."""
    ticks = round(end / context.period)
    return np.arange(0.0, ticks, max(1, ticks // _MOST)) * float(context.period)


def _references(stage: StagePlan) -> Iterator[tuple[Dimension | None, Expression, bool]]:
    """What a place measures there, expression, and whether it is a position, which has rates."""
    for axis, entry in stage.spec.axes.items():
        if axis not in stage.axes:
            continue
        for expression, planned in entry.expressions():
            yield axis.of(LENGTH), expression, planned
    if isinstance(stage.joint_path, JointMotion):
        for expression, turns in zip(
            stage.joint_path.positions, stage.joint_path.turns, strict=True
        ):
            yield LENGTH.on(rotation=turns), expression, True
    for constraint in stage.spec.constraints.values():
        for expression in constraint.expressions:
            yield None, expression, False


def _values(
    context: Context, expression: Expression, planned: bool, clocks: set[str], times: Vector
) -> Vector | None:
    """(3, k) or (1, k) the reference, of a position also its rates; None where signals decide.

    `clocks` are the names that mean `times` (k,) here; those since the run began do in its first
    stage.
    """
    used = {str(n) for n in walk(expression.tree) if isinstance(n, Name)}
    params = context.loaded.task.params
    if not used & clocks or not used <= {*clocks, "pi", *params}:
        return None
    t = ca.SX.sym("t")
    known = {"pi": ca.SX(math.pi)} | {n: ca.SX(q.value) for n, q in params.items()}
    known |= dict.fromkeys(clocks, t)
    value = CasadiAlgebra(None, context.period).translate(expression, lambda n: known[str(n)])
    rows = [value]
    if planned:
        rows.append(ca.jacobian(value, t))
        rows.append(ca.jacobian(rows[1], t))
    rows = [ca.densify(row) for row in rows]
    function = ca.Function("reference", [t], [ca.vertcat(*rows)])
    return np.array(function(times[None, :]))


def _undefined(
    expression: Expression, values: Vector, times: Vector, first: int, *, surely: bool
) -> Finding:
    """The finding of a reference whose value or rate is not finite from a tick on."""
    row = int(np.flatnonzero(~np.isfinite(values[:, first]))[0])
    subject = ("this has", "the rate of this has", "the acceleration of this has")[row]
    return Finding(
        "TS117",
        f"{subject} no finite value at t = {show(float(times[first]), TIME, 4)}"
        + ("" if surely else ", which may come"),
        expression.span,
        "end the stage before that, or keep its argument in range with max, min or clamp",
        severity=Severity.ERROR if surely else Severity.WARNING,
    )


def _jumps(
    place: Dimension, expression: Expression, values: Vector, times: Vector
) -> Iterator[Finding]:
    """The first step of a position that is far from those beside it."""
    steps = np.abs(np.diff(values))
    near = np.zeros_like(steps)
    for k in _NEAR:
        near[k:] = np.maximum(near[k:], steps[:-k])
        near[:-k] = np.maximum(near[:-k], steps[k:])
    least = _JUMP["angular" if place == ANGLE else "linear"]
    jumps = np.flatnonzero((steps > least) & (steps > _TIMES * near))
    if len(jumps) == 0:
        return
    k = int(jumps[0])
    yield warning(
        "TS423",
        f"this jumps by {show(float(steps[k]), place, 3)} at "
        f"t = {show(float(times[k + 1]), TIME, 4)}: the arm cannot follow, and the controller "
        "answers with all it has",
        expression.span,
        "pass over steadily, with smooth((t - t0)/(0.5 s)) between two values",
    )
