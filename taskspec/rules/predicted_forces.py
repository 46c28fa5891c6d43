"""Expectations and guards that the predicted course of a stage misses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.force_course import ForceCourse, force_courses
from taskspec.foresight.approach import approach, rates_of, striking_mass
from taskspec.foresight.conditions import names, parts
from taskspec.foresight.force_profile import force_profiles
from taskspec.geometry.axis import Axis, as_axis
from taskspec.program.axes import MOSTLY
from taskspec.program.flow import leading_to
from taskspec.program.interval import ANY, IntervalAlgebra
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.signals import constant
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.spec import FILE
from taskspec.text.expression import Expression, evaluate
from taskspec.text.expression.series import Series, SeriesAlgebra
from taskspec.text.expression.tree import Compare, Held, Name, Node, Reduce, walk
from taskspec.text.units import FORCE, show

Vector = NDArray[np.float64]

_INTERVALS, _SERIES = IntervalAlgebra(), SeriesAlgebra()
#: What may follow the name of a signal.
_PARTS = ((), ("ref",))
#: An expectation that would be met if the force came so much nearer to its set point is not
#: accused: the loop is that of the start pose.
_DOUBT = 0.1
#: A tool that is so far from what it pressed on has left it [m].
_OFF = 1e-3
#: A loop that cannot be followed overshoots its set point by less than this share.
_BEYOND = 0.15
_LOOKS = 200
#: A course is followed if what it settles at and its blow would pass a limit so many times over.
_OVERSHOOT = 2.0


@rule("TS726", "an expectation that a force misses on its way", phase=Phase.STABILITY)
def slow_forces(task: TaskPlan) -> Iterator[Finding]:
    """Expectations of forces that their loops do not bring there in time, or bring beyond."""
    for _, looks in _looks(task):
        found = [look for look in looks if look is not None and look.misses]
        if found and len(found) == len(looks):
            yield found[0].finding()


def close_calls(task: TaskPlan) -> set[str]:
    """Stages whose forces miss or meet an expectation by too little to report it.

    So are those whose set point changes, and whose force has no course that can be predicted.
    """
    return {
        signal[0]
        for signal, looks in _looks(task)
        if any(look.is_close for look in looks if look is not None)
        or (None in looks and _changes(task, signal))
    }


def _changes(task: TaskPlan, signal: tuple[str, str, str]) -> bool:
    """Whether the set point of a force changes with time."""
    name, _, axis = signal
    return any(profile.axis is Axis(axis) for profile in force_profiles(task.stages[name]))


def _looks(task: TaskPlan) -> Iterator[tuple[tuple[str, str, str], list[_Look | None]]]:
    """Stage, kind and axis of the force of each condition, and the condition over its courses.

    None stands for a course that cannot be predicted.
    """
    ways = force_courses(task)
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        for condition in parts(expression.tree):
            signal = _force_of(task, condition)
            if signal is None:
                continue
            courses = [way.of(signal[0], Axis(signal[2])) for way in ways]
            yield (
                signal,
                [_Look(task, expression, condition, signal, c) if c else None for c in courses],
            )


@rule({}, also=("TS611",), phase=Phase.STABILITY)
def guards_beyond_forces(task: TaskPlan) -> Iterator[Finding]:
    """Guards that wait for more than their axis' force ever comes to."""
    ways = force_courses(task)
    for name, stage in task.framed.items():
        axis = _waits_for(stage)
        courses = [way.of(name, axis) for way in ways] if axis is not None else []
        if axis is None or stage.spec.until is None or _comes_off(stage, axis):
            continue
        tree = stage.spec.until.tree
        node = tree.x if isinstance(tree, Held) else tree
        applied = [c.applied for c in courses if c is not None]
        if len(applied) < len(courses):
            applied = _unfollowed(stage, axis)
            if not applied or not math.isfinite(stage.longest):
                continue
        if any(_ever(task, node, (1 + more) * f) for f in applied for more in (0.0, _DOUBT)):
            continue
        most = max(applied[0], key=abs)
        yield warning(
            "TS611",
            f"this never holds: until {show(stage.longest, 's', 3)} have passed, "
            f"{axis.effort}.{axis} is predicted to come to {show(float(most), axis.of(FORCE), 3)}",
            FILE.stages[name].until,
            "let it wait for less than the set point, or raise that",
            unless=("TS501", "TS612", "TS617"),
        )


def _comes_off(stage: StagePlan, axis: Axis) -> bool:
    """Whether the way of a stage leads off what an axis presses on, such as past a plate's end."""
    contact, start = stage.contact_of(axis), stage.nominal.start
    context, within = stage.context, stage.spec.within
    if contact is None or contact not in context.surfaces or start is None or within is None:
        return False
    rate = stage.rotation @ rates_of(stage)
    speed = float(np.linalg.norm(rate))
    travel = math.inf if within.travel is None else within.travel
    time = min(stage.longest, travel / speed) if speed > 0 else 0.0
    there = start + rate * time
    return context.obstacles.gap(contact, there, context.start_R) > _OFF


@rule({}, also=("TS618",), phase=Phase.STABILITY)
def failures_by_forces(task: TaskPlan) -> Iterator[Finding]:
    """Failures that the force of an axis brings about on its way, or where a spring ends."""
    ways = force_courses(task)
    for name, stage in task.framed.items():
        guard = stage.spec.fail_if
        axis = None if guard is None else _about(stage, guard)
        courses = [way.of(name, axis) for way in ways] if axis is not None else []
        if guard is None or axis is None or not courses or not all(courses):
            continue
        looks = [force for c in courses if c for force in (c.applied, _nearer(c))]
        since = [_holds_since(task, guard.tree, force) for force in looks]
        course, i = courses[0], since[0]
        if course is None or i is None or None in since:
            continue
        force, time = float(course.applied[i]), float(course.times[i])
        yield warning(
            "TS618",
            f"stage {name!r} fails: {axis.effort}.{axis} is predicted to be "
            f"{show(force, axis.of(FORCE), 3)} at t = {show(time, 's', 3)}, and this holds",
            guard.span,
            "let it begin beyond the predicted force, or press less",
            unless=("TS501", "TS612", "TS613", "TS618"),
        )


@rule({}, also=("TS616",), phase=Phase.STABILITY)
def forces_beyond_limits(task: TaskPlan) -> Iterator[Finding]:
    """Limits that a force passes on its way to where it settles, as a blow or by its overshoot."""
    for name, stage in task.framed.items():
        most = stage.limits.force
        if most is None or stage.law.solve == "qp":
            continue
        for axis in stage.spec.axes:
            if axis not in stage.translations or not _may_pass(task, stage, axis, most):
                continue
            courses = [way.of(name, axis) for way in force_courses(task)]
            peaks = [float(np.abs(c.applied).max()) for c in courses if c is not None]
            if len(peaks) < len(courses) or min(peaks) <= most:
                continue
            course = courses[0]
            assert course is not None
            when = float(course.times[np.argmax(np.abs(course.applied) > most)])
            yield warning(
                "TS616",
                f"force.{axis} of stage {name!r} is predicted to come to {show(peaks[0], 'N', 3)}: "
                f"at t = {show(when, 's', 2)} it is beyond the limit on force, "
                f"{show(most, 'N')}, and the run stops",
                FILE.stages[name].axes[axis],
                "approach more slowly, let the force rise, or raise the limit",
                unless=("TS420", "TS501", "TS610", "TS616"),
            )
            break


def _may_pass(task: TaskPlan, stage: StagePlan, axis: Axis, most: float) -> bool:
    """Whether a force may pass a limit: what it settles at and the blow before, twice, do.

    Following a course is dear, and the limits of most files are far away.
    """
    contact, facing = stage.contact_of(axis), abs(stage.facing(axis))
    if contact is None or facing < MOSTLY:
        return False
    stages = task.context.loaded.task.stages
    before = leading_to(stages, stage.name)
    ways = [approach(task.stages[n], task.stages[n].nominal.gap) for n in before]
    closing = max((way.closing for way in ways if way is not None), default=0.0)
    k, h = stage.context.compliances[contact].stiffness, striking_mass(stage, axis)
    if not math.isfinite(k):
        return False
    settles = abs(stage.set_point_of(axis) or 0.0)
    if settles > most:
        return False  # What cannot be had at rest is a finding of its own.
    passage = stage.nominal.passage
    if not stage.spec.axes[axis].has_force and passage is not None:
        own = stage.spring_of(axis, h)
        deepest = max(abs(i.moved[axis]) for i in passage.instants)
        start = (stage.nominal.coordinates or {}).get(axis, 0.0)
        settles = (deepest + abs(start)) * own * k / (own + k) if own > 0 else 0.0
    return _OVERSHOOT * (settles + closing * math.sqrt(h * k)) > most


def _waits_for(stage: StagePlan) -> Axis | None:
    """The one axis whose force alone the guard of a stage waits for."""
    return None if stage.spec.until is None else _about(stage, stage.spec.until)


def _about(stage: StagePlan, guard: Expression) -> Axis | None:
    """The one axis whose force alone a guard is about, if that is predicted."""
    paths = {
        n.path
        for n in names(guard.tree)
        if constant(stage.context, n) is None or n.frame is not None
    }
    if len(paths) != 1:
        return None
    (path,) = paths
    axis = as_axis(path[-1])
    if len(path) != 2 or axis is None or path[0] != axis.effort or not _is_predicted(stage, axis):
        return None
    return axis


def _unfollowed(stage: StagePlan, axis: Axis) -> list[Vector]:
    """What a loop that cannot be followed brings the force of an axis to, from nothing on."""
    value, law = stage.set_point_of(axis), stage.law.control_law
    if value is None or not law.force_loop or stage.spec.axes[axis].mode.moves:
        return []
    return [np.linspace(0.0, (1 + _BEYOND) * value, _LOOKS)]


def _ever(task: TaskPlan, node: Node, applied: Vector) -> bool:
    """Whether a condition on one force ever holds while that goes its way."""
    worth = _over(task, node, applied, applied)
    return not worth.known or bool((worth.inside() == 1).any())


def _holds_since(task: TaskPlan, guard: Node, applied: Vector) -> int | None:
    """The tick from which on a condition on one force holds for as long as it is to."""
    node = guard.x if isinstance(guard, Held) else guard
    lasts = guard.amount.value_si if isinstance(guard, Held) else 0.0
    ticks = max(round(lasts / task.context.period), 1)
    worth = _over(task, node, applied, applied)
    if not worth.known:
        return None
    holds = worth.inside() == 1
    run = 0
    for i in range(len(holds)):
        run = run + 1 if holds[i] else 0
        if run == ticks:
            return i
    return None


def _over(task: TaskPlan, node: Node, applied: Vector, reference: Vector) -> Series:
    """What an expression of one force, and of its `ref`, is worth over the force's course."""
    window = np.ones(len(applied), dtype=bool)

    def find(name: Name) -> Series:
        known = constant(task.context, name)
        if known is not None:
            return Series.one(known.low)
        return Series(reference if name.path[-1] == "ref" else applied, window)

    return evaluate(node, _SERIES, find)


@rule("TS727", "an expectation that a guard ends short of", phase=Phase.RUN)
def short_ends(task: TaskPlan) -> Iterator[Finding]:
    """Last values beyond those at which the stage's own guard ends it."""
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        for condition in parts(expression.tree):
            finding = _short_of(task, expression, condition)
            if finding is not None:
                yield finding


def _force_of(task: TaskPlan, condition: Node) -> tuple[str, str, str] | None:
    """Stage, kind and axis of the one set point that a condition is about; None of any other."""
    signals = {n for n in names(condition) if constant(task.context, n) is None}
    paths = {n.path[:3] for n in signals}
    if len(paths) != 1 or any(n.frame is not None or n.path[3:] not in _PARTS for n in signals):
        return None
    (path,) = paths
    if len(path) != 3 or path[1] not in ("force", "torque"):
        return None
    name, effort, last = path
    stage, axis = task.framed.get(name), as_axis(last)
    if stage is None or axis is None or axis.effort != effort:
        return None
    if _is_sprung(stage, axis):
        return path
    if stage.spec.until is not None or not _is_predicted(stage, axis):
        return None
    if any(n.path[3:] for n in signals) and not stage.plans[axis].set_point:
        return None
    return path


def _is_sprung(stage: StagePlan, axis: Axis) -> bool:
    """Whether a force of an axis displaces a spring, and a held mechanism what that is on."""
    plan = stage.plans.get(axis)
    return bool(stage.held) and plan is not None and plan.open_loop


def _is_predicted(stage: StagePlan, axis: Axis) -> bool:
    """Whether an axis has a set point, or a spring whose force its reference gives."""
    plan = stage.plans.get(axis)
    loop = stage.law.control_law.force_loop
    if plan is None or (stage.held and not loop):
        return False
    return plan.set_point or not (axis.is_rotation or loop)


def _nearer(course: ForceCourse) -> Vector:
    """(k,) what is applied, nearer to the set point by `_DOUBT`."""
    return np.asarray(course.wanted + (1 - _DOUBT) * (course.applied - course.wanted))


class _Look:
    """A condition on a force, over the course that is predicted of it."""

    def __init__(
        self,
        task: TaskPlan,
        expression: Expression,
        condition: Node,
        signal: tuple[str, str, str],
        course: ForceCourse,
    ) -> None:
        self._task, self._expression, self._condition = task, expression, condition
        self._signal, self._course = signal, course

    @property
    def stage(self) -> str:
        """Its name."""
        return self._signal[0]

    @property
    def is_close(self) -> bool:
        """Whether it is broken and would not be by a force a little nearer, or met by so little.

        A set point that changes is followed a little better or worse than the loop of the start
        pose does.
        """
        course = self._course
        if not self._holds(course.applied):
            return self._holds(_nearer(course))
        swing = _DOUBT * float(np.ptp(course.wanted))
        return swing > 0 and not all(self._holds(course.applied + s) for s in (-swing, swing))

    @property
    def misses(self) -> bool:
        """Whether it is broken, even if the force came nearer to its set point by `_DOUBT`."""
        return not (self._holds(self._course.applied) or self._holds(_nearer(self._course)))

    def finding(self) -> Finding:
        """What is predicted instead."""
        name, _, axis = self._signal
        if self._course.sprung:
            held, law = self._task.context.held, self._task.stages[name].law.kind
            why = f"under {law!r} {axis!r} stays a spring, and {held!r} takes the tool off its rest"
            hint = (
                "lay the frame on the mechanism, soften that axis, or take a law with a force loop"
            )
        elif self._holds(self._course.wanted):
            loop = "spring" if self._is_spring else "loop"
            why = f"the {loop} of {axis!r} in stage {name!r} settles too slowly, or overshoots"
            gains = "damping" if self._is_spring else "force gains"
            hint = f"let the stage last longer, raise its {gains}, or widen this"
        else:
            why = f"the set point of {axis!r} in stage {name!r} itself goes there"
            hint = "widen this by what the set point changes, or expect its mean"
        if not any(isinstance(node, Held | Reduce) for node in walk(self._condition)):
            hint = "say in how much of the stage it has to hold, as in 'for 90 %'"
        return warning(
            "TS726",
            f"{self._predicted()}: {why}",
            self._expression.where(self._condition),
            hint,
            unless=("TS501", "TS723", "TS308"),
        )

    @property
    def _is_spring(self) -> bool:
        """Whether the law has no loop that brings the force to its set point."""
        return not self._task.stages[self._signal[0]].law.control_law.force_loop

    def _predicted(self) -> str:
        condition, times = self._condition, self._course.times
        unit = FORCE.on(rotation=self._signal[1] == "torque")
        if isinstance(condition, Held):
            held = self._value(condition.x, self._course.applied).inside() == 1
            share = f"this is predicted to hold in {100 * float(np.mean(held)):.0f} % of its ticks"
            first = int(np.argmax(held))
            return share + (f", first at t = {show(float(times[first]), 's', 3)}" if first else "")
        for node in (getattr(condition, "left", None), getattr(condition, "x", None)):
            if isinstance(node, Reduce):
                value = self._value(node, self._course.applied).number
                written = self._expression.text[node.start : node.end]
                return f"{written} is predicted to come to {show(value, unit, 3)}"
        held = self._value(condition, self._course.applied).inside() == 1
        broken = int(np.argmin(held))
        force = show(float(self._course.applied[broken]), unit, 3)
        return f"{force} is predicted at t = {show(float(times[broken]), 's', 3)}"

    def _holds(self, applied: Vector) -> bool:
        worth = self._value(self._condition, applied)
        return not worth.known or bool((worth.inside() == 1).all())

    def _value(self, node: Node, applied: Vector) -> Series:
        return _over(self._task, node, applied, self._course.reference)


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
