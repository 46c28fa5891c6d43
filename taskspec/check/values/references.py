"""References over the whole of their stage: where they have no value, and where they jump."""

from __future__ import annotations

import math
from collections.abc import Iterator

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.foresight.ranges import longest
from taskspec.geometry.axis import Axis
from taskspec.program.algebra import CasadiAlgebra
from taskspec.program.context import Context
from taskspec.spec import Stage
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.expression import Expression
from taskspec.text.expression.tree import Name, walk
from taskspec.text.show import show

register({"TS423": "a position that jumps"})

Vector = NDArray[np.float64]

#: Ticks at which a reference is looked at; of a longer stage as many, evenly chosen.
_MOST = 20_000
#: A step of a planned position is a jump from this on [m, rad], and from so many times the steps
#: near it on: a motion that is resolved by its ticks changes little from one to the next. A jump
#: may take two ticks, as sign(t) is 0 in one, so those right beside it do not count.
_JUMP = {"linear": 2e-3, "angular": math.radians(1.0)}
_TIMES = 20.0
_NEAR = (2, 3)


def check_references(
    context: Context, name: str, axes: tuple[Axis, ...], found: Diagnostics
) -> None:
    """Reports references of stage `name` that depend on time alone and are not finite, or jump.

    A position is looked at with its rate and acceleration, which the laws use. What is not finite
    at the very beginning is told by `check_signals`.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        found: where findings go.
    """
    stage = context.loaded.task.stages[name]
    times = _times(context, stage)
    if times is None:
        return
    first = name == next(iter(context.loaded.task.stages))
    clocks = {"t", "clock"} if first else {"t"}
    for axis, expression, planned in _references(stage, axes):
        values = _values(context, expression, planned, clocks, times)
        if values is None or not np.isfinite(values[0, 0]):
            continue
        wrong = np.flatnonzero(~np.isfinite(values).all(axis=0))
        if len(wrong):
            surely = stage.until is None
            _report_undefined(expression, values, times, int(wrong[0]), found, surely=surely)
        elif planned:
            _report_jump(Axis(axis), expression, values[0], times, found)


def check_motions(context: Context, found: Diagnostics) -> None:
    """Reports objects that move by an expression of `clock` which has no value while a run lasts.

    The plant's guards would stop the run there.
    """
    task = context.loaded.task
    whole = sum(longest(context, stage) for stage in task.stages.values())
    if not math.isfinite(whole):
        return
    times = _ticks(context, whole)
    for shape in task.shapes.values():
        for expression in () if shape.motion is None else shape.motion.axes.values():
            values = _values(context, expression, True, {"clock"}, times)
            if values is None or not np.isfinite(values[0, 0]):
                continue
            wrong = np.flatnonzero(~np.isfinite(values).all(axis=0))
            if len(wrong):
                _report_undefined(expression, values, times, int(wrong[0]), found, surely=False)


def _times(context: Context, stage: Stage) -> Vector | None:
    """Seconds since the stage began at which it may tick; None where nothing tells how many."""
    end = longest(context, stage)
    return _ticks(context, end) if math.isfinite(end) else None


def _ticks(context: Context, end: float) -> Vector:
    ticks = round(end / context.period)
    return np.arange(0.0, ticks, max(1, ticks // _MOST)) * float(context.period)


def _references(stage: Stage, axes: tuple[Axis, ...]) -> Iterator[tuple[str, Expression, bool]]:
    """Axis, expression, and whether it is a position, which is differentiated."""
    for axis, entry in stage.axes.items():
        if axis not in axes:
            continue
        if entry.position is not None:
            yield axis, entry.position, True
        for expression in (entry.velocity, entry.force, entry.torque):
            if expression is not None:
                yield axis, expression, False
    for constraint in stage.constraints.values():
        yield "", constraint.wanted, False


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


def _report_undefined(
    expression: Expression,
    values: Vector,
    times: Vector,
    first: int,
    found: Diagnostics,
    *,
    surely: bool,
) -> None:
    row = int(np.flatnonzero(~np.isfinite(values[:, first]))[0])
    subject = ("this has", "the rate of this has", "the acceleration of this has")[row]
    found.add(
        Severity.ERROR if surely else Severity.WARNING,
        "TS117",
        f"{subject} no finite value at t = {show(float(times[first]), 's', 4)}"
        + ("" if surely else ", which may come"),
        expression.span,
        "end the stage before that, or keep its argument in range with max, min or clamp",
    )


def _report_jump(
    axis: Axis, expression: Expression, values: Vector, times: Vector, found: Diagnostics
) -> None:
    """Reports the first step of a position that is far from those beside it."""
    steps = np.abs(np.diff(values))
    near = np.zeros_like(steps)
    for k in _NEAR:
        near[k:] = np.maximum(near[k:], steps[:-k])
        near[:-k] = np.maximum(near[:-k], steps[k:])
    turns = axis.is_rotation
    least = _JUMP["angular" if turns else "linear"]
    jumps = np.flatnonzero((steps > least) & (steps > _TIMES * near))
    if len(jumps) == 0:
        return
    k = int(jumps[0])
    found.warning(
        "TS423",
        f"this jumps by {show(float(steps[k]), 'deg' if turns else 'mm', 3)} at "
        f"t = {show(float(times[k + 1]), 's', 4)}: the arm cannot follow, and the controller "
        "answers with all it has",
        expression.span,
        "pass over steadily, with smooth((t - t0)/(0.5 s)) between two values",
    )
