"""Expectations that the foreseen course of a stage misses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.force_course import ForceCourse, ForceCourses
from taskspec.foresight.conditions import names, parts
from taskspec.foresight.interval import ANY, IntervalAlgebra
from taskspec.foresight.ranges import constant
from taskspec.geometry.axis import Axis, as_axis
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.text.expression import Expression, evaluate
from taskspec.text.expression.series import Series, SeriesAlgebra
from taskspec.text.expression.tree import Compare, Held, Name, Node, Reduce
from taskspec.text.units import FORCE, show

Vector = NDArray[np.float64]

_INTERVALS, _SERIES = IntervalAlgebra(), SeriesAlgebra()
_EFFORTS = ("force", "torque")
#: An expectation that would be met if the force came so much nearer to its set point is not
#: accused: the loop is that of the start pose.
_DOUBT = 0.1


@rule("TS726", "an expectation that a force misses on its way", phase=Phase.STABILITY)
def slow_forces(task: TaskPlan) -> Iterator[Finding]:
    """Expectations of forces that their loops do not bring there in time, or bring beyond."""
    courses = ForceCourses(task)
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        for condition in parts(expression.tree):
            finding = _slow(task, expression, condition, courses)
            if finding is not None:
                yield finding


@rule("TS727", "an expectation that a guard ends short of", phase=Phase.RUN)
def short_ends(task: TaskPlan) -> Iterator[Finding]:
    """Last values beyond those at which the stage's own guard ends it."""
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        for condition in parts(expression.tree):
            finding = _short_of(task, expression, condition)
            if finding is not None:
                yield finding


def _slow(
    task: TaskPlan,
    expression: Expression,
    condition: Node,
    courses: ForceCourses,
) -> Finding | None:
    """A force that is not where it is expected to be for long enough, or soon enough."""
    context = task.context
    signals = {n for n in names(condition) if constant(context, n) is None}
    if len(signals) != 1:
        return None
    (signal,) = signals
    if len(signal.path) != 3 or signal.frame is not None or signal.path[1] not in _EFFORTS:
        return None
    name, effort, last = signal.path
    stage, axis = task.framed.get(name), as_axis(last)
    if stage is None or axis is None or axis.effort != effort or not _is_set(stage, axis):
        return None
    course = courses.of(name, axis)
    if course is None:
        return None

    def lookup(applied: Callable[[ForceCourse], Vector]) -> Callable[[Name], Series]:
        values = applied(course)
        window = np.ones(len(values), dtype=bool)

        def find(n: Name) -> Series:
            known = constant(context, n)
            return Series(values, window) if known is None else Series.one(known.low)

        return find

    mild = lookup(lambda c: c.wanted + (1 - _DOUBT) * (c.applied - c.wanted))
    likely = lookup(lambda c: c.applied)
    if _holds(condition, mild) or _holds(condition, likely):
        return None
    foreseen = _foreseen(condition, likely, course, signal, expression)
    if _holds(condition, lookup(lambda c: c.wanted)):
        why = f"the loop of stage {name!r} comes to its set point so slowly, or so far beyond it"
        hint = "let the stage last longer, raise its force gains, or widen this"
    else:
        why = f"the set point of stage {name!r} itself goes there"
        hint = "widen this by what the set point changes, or expect its mean"
    return warning(
        "TS726",
        f"{foreseen}: {why}",
        expression.where(condition),
        hint,
        unless=("TS501", "TS723", "TS308"),
    )


def _is_set(stage: StagePlan, axis: Axis) -> bool:
    plan = stage.plans.get(axis)
    return plan is not None and plan.force and stage.law.control_law.force_loop


def _holds(condition: Node, lookup: Callable[[Name], Series]) -> bool:
    worth = evaluate(condition, _SERIES, lookup)
    return not worth.known or bool((worth.inside() == 1).all())


def _foreseen(
    condition: Node,
    lookup: Callable[[Name], Series],
    course: ForceCourse,
    signal: Name,
    expression: Expression,
) -> str:
    """What is foreseen instead, in words."""
    unit = FORCE.on(rotation=signal.path[1] == "torque")
    if isinstance(condition, Held):
        held = evaluate(condition.x, _SERIES, lookup).inside()
        first = int(np.argmax(held == 1)) if (held == 1).any() else None
        share = f"holds in {100 * float(np.mean(held == 1)):.0f} % of its ticks"
        since = "" if not first else f", first at t = {show(float(course.times[first]), 's', 3)}"
        return f"this {share}{since}"
    for node in (getattr(condition, "left", None), getattr(condition, "x", None)):
        if isinstance(node, Reduce):
            value = evaluate(node, _SERIES, lookup).number
            written = expression.text[node.start : node.end]
            return f"{written} comes to {show(value, unit, 3)}"
    held = evaluate(condition, _SERIES, lookup).inside()
    broken = int(np.argmax(held != 1))
    return (
        f"{signal} is {show(float(course.applied[broken]), unit, 3)} at "
        f"t = {show(float(course.times[broken]), 's', 3)}"
    )


def _short_of(task: TaskPlan, expression: Expression, condition: Node) -> Finding | None:
    """A last value beyond that at which the stage's own guard ends it.

    The tick in which a guard holds is the first of the next stage, so that the last one of its
    own stage has not come to it.
    """
    if not isinstance(condition, Compare) or not isinstance(condition.left, Reduce):
        return None
    name = condition.left.arg
    if condition.left.reducer != "last" or not isinstance(name, Name) or name.frame is not None:
        return None
    stage = task.framed.get(name.path[0])
    guard = None if stage is None or stage.spec.until is None else stage.spec.until.tree
    if stage is None or not isinstance(guard, Compare) or not _is(guard.left, name.path[1:]):
        return None
    passage = stage.nominal.passage
    if passage is None or len(passage.instants) == 1:
        return None  # Nothing says that it comes there by going on.
    up = condition.op.startswith(">")
    if guard.op.startswith(">") != up:
        return None
    least, ends = _number(task, condition.right), _number(task, guard.right)
    if least is None or ends is None or (least < ends if up else least > ends):
        return None
    return warning(
        "TS727",
        f"the guard of stage {name.path[0]!r} ends it in the tick in which this would hold, "
        "and that tick is no longer one of its own",
        expression.where(condition),
        "expect a little less than the guard waits for, or let the guard wait for a little more",
    )


def _is(node: Node, path: tuple[str, ...]) -> bool:
    return isinstance(node, Name) and node.path == path and node.frame is None


def _number(task: TaskPlan, node: Node) -> float | None:
    worth = evaluate(node, _INTERVALS, lambda name: constant(task.context, name) or ANY)
    return worth.low if worth.low == worth.high and math.isfinite(worth.low) else None
