"""Expectations that no good run can meet, or that cannot be judged."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from taskspec.expression import Expression, evaluate
from taskspec.expression.tree import Call, Compare, Held, Name, Node, Reduce, WithinNode, walk
from taskspec.geometry.axis import as_axis
from taskspec.program.axes import MOSTLY
from taskspec.program.conditions import bounds_of, names, parts, value_of
from taskspec.program.context import Context
from taskspec.program.flow import good_end, reached
from taskspec.program.interval import ANY, Interval, IntervalAlgebra, point
from taskspec.program.known_value import known_value
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.signals import constant, entry_of, natural
from taskspec.program.walk.nominal import AT_SURFACE
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.rules.signals import given_by, no_such_signal
from taskspec.signals import CLOCKS
from taskspec.spec import Expectation
from taskspec.text.units import FORCE, fitting, show

_ALGEBRA = IntervalAlgebra()
#: Reducers whose value is that of a steady signal although the signal was another before.
_LATE = ("last",)


@rule("TS720", "an expectation of a stage that is not entered", phase=Phase.RUN)
def unvisited_stages(task: TaskPlan) -> Iterator[Finding]:
    """Expectations of stages that no run enters, or only one with a failure."""
    stages, way = task.context.loaded.task.stages, _well(task.context)
    entered = reached(task.context.loaded.task, {next(iter(stages))})
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        places: dict[str, Name] = {}
        for name in names(expression.tree):
            stage = _stage_of(task.context, name)
            if stage is not None and stage not in way:
                places.setdefault(stage, name)
        for stage, name in places.items():
            if stage in entered:
                yield warning(
                    "TS720",
                    f"stage {stage!r} is entered only after a failure: in a run without one this "
                    "fails",
                    expression.where(name),
                    "expect something of a stage that every good run enters",
                )
            else:
                yield error(
                    "TS720",
                    f"stage {stage!r} is never entered, so this always fails",
                    expression.where(name),
                    "lead to the stage with 'next' or 'on_fail', or leave the expectation out",
                )


@rule("TS721", "an expectation of a signal that a stage does not have", phase=Phase.RUN)
def signals_without_value(task: TaskPlan) -> Iterator[Finding]:
    """Signals of the whole run that some stage of every good run does not have."""
    way = [task.framed[name] for name in _well(task.context) if name in task.framed]
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        inside = {
            name
            for call in walk(expression.tree)
            if isinstance(call, Call) and call.function == "norm"
            for name in names(call)
        }
        for name in names(expression.tree):
            if name in inside or name.path[0] == "path_done" or name.frame is not None:
                continue
            if _stage_of(task.context, name) is not None:
                continue
            for stage in way:
                reason = no_such_signal(stage, name, inside_norm=False)
                if reason is None:
                    continue
                nowhere = all(no_such_signal(each, name, inside_norm=False) for each in way)
                yield error(
                    "TS721",
                    f"{name} is judged in the whole run, and has no value in stage "
                    f"{stage.name!r}: {reason}",
                    expression.where(name),
                    (nowhere and given_by(stage, name))
                    or f"ask for it in the stages that have it, as in STAGE.{name}",
                )
                break


@rule("TS724", "an expectation of a time finer than a tick", phase=Phase.RUN)
def times_between_ticks(task: TaskPlan) -> Iterator[Finding]:
    """Times that are to be met more finely than ticks come."""
    context = task.context
    for expectation in context.loaded.task.expect:
        expression = expectation.expression
        for part in parts(expression.tree):
            if not isinstance(part, WithinNode):
                continue
            inner = part.x.arg if isinstance(part.x, Reduce) else part.x
            low, high = (_known(task, end) for end in (part.low, part.high))
            if not isinstance(inner, Name) or inner.path[-1] not in ("t", "clock"):
                continue
            if low is not None and high is not None and 0 <= high - low < context.period:
                yield warning(
                    "TS724",
                    f"this asks for a time within {show(high - low, 'ms', 3)}, and the controller "
                    f"ticks every {show(context.period, 'ms', 3)}",
                    expression.where(part),
                    "widen it to one tick at least",
                )


@rule(
    {
        "TS722": "an expectation that can never hold",
        "TS723": "an expectation that a set point contradicts",
    },
    phase=Phase.RUN,
)
def impossible_expectations(task: TaskPlan) -> Iterator[Finding]:
    """Expectations that fail whatever happens, or in every run that ends well."""
    expectations = task.context.loaded.task.expect
    for number, expectation in enumerate(expectations):
        never = _never(task, expectation, expectations[:number])
        if never is not None:
            yield never
        else:
            yield from _beside_a_set_point(task, expectation)


@rule("TS725", "a peak of force where a touch only begins", phase=Phase.RUN)
def peaks_of_touches(task: TaskPlan) -> Iterator[Finding]:
    """Bounds on the peak of a force in a stage that a touch ends: it comes in the next one."""
    context = task.context
    expectations = context.loaded.task.expect
    bounded = {
        (_stage_of(context, name), _effort(name))
        for expectation in expectations
        for _, name in _peaks(task, expectation)
    }
    for expectation in expectations:
        expression = expectation.expression
        for part, name in _peaks(task, expectation):
            stage = _stage_of(context, name)
            after = None if stage is None else good_end(context.loaded.task.stages, stage)
            if stage is None or after is None or not _ends_by_touch(task.framed[stage]):
                continue
            # The whole run, or the stage that gets the blow, may be bounded by another line.
            if {(None, _effort(name)), (after, _effort(name))} & bounded:
                continue
            written = " ".join(expression.text[part.start : part.end].split())
            other = written.replace(f"{stage}.", f"{after}.")
            yield error(
                "TS725",
                f"stage {stage!r} ends as soon as it touches: the peak of the blow comes after it, "
                f"in {after!r}, and this would hold whatever that is",
                expression.where(part),
                f"write it over both stages: '{written} and {other}'",
            )
            break


def _peaks(task: TaskPlan, expectation: Expectation) -> Iterator[tuple[Node, Name]]:
    """The conditions of an expectation that bound the size of a force or moment from above."""
    for part in parts(expectation.expression.tree):
        if isinstance(part, Compare):
            left_is_less = part.op.startswith("<")
            sides = ((part.left, left_is_less), (part.right, not left_is_less))
        elif isinstance(part, WithinNode):
            sides = ((part.x, True), (part.x, False))
        else:
            continue
        for reduced, from_above in sides:
            if not isinstance(reduced, Reduce):
                continue
            for name in names(reduced.arg):
                if _effort(name) and _is_peak(task, reduced, name, from_above=from_above):
                    yield part, name


def _effort(name: Name) -> str:
    """`force` or `torque` where a name is of such a signal of contact; else empty."""
    return next((word for word in name.path if word in ("force", "torque")), "") * (
        "joint" not in name.path
    )


def _is_peak(task: TaskPlan, reduced: Reduce, name: Name, *, from_above: bool) -> bool:
    """Whether a greatest or least value of a force grows with the blow, and is bounded."""
    arg = reduced.arg
    if isinstance(arg, Call) and arg.function in ("norm", "abs"):
        return from_above and reduced.reducer == "max"
    stage = _stage_of(task.context, name)
    plan = None if stage is None else task.framed.get(stage)
    axis = as_axis(name.path[-1])
    if arg != name or plan is None or plan.contacts.approached is None or name.frame is not None:
        return False
    if axis is None or axis.is_rotation:
        return from_above and reduced.reducer == "max"
    # The robot applies a force against the normal.
    way = -plan.kinematics.along(axis, plan.contacts.normal(plan.contacts.approached))
    if abs(way) < MOSTLY:
        return False
    return reduced.reducer == ("max" if way > 0 else "min") and from_above == (way > 0)


def _well(context: Context) -> list[str]:
    """The stages of a run in which every stage ends well, in order."""
    stages = context.loaded.task.stages
    way: list[str] = []
    name: str | None = next(iter(stages))
    while name is not None and name not in way:
        way.append(name)
        name = good_end(stages, name)
    return way


def _stage_of(context: Context, name: Name) -> str | None:
    """The stage whose ticks a signal is judged in; None for the whole run, or another name."""
    stages = context.loaded.task.stages
    judged = len(name.path) > 1 and name.path[0] in stages and name.path[1] != "visits"
    return name.path[0] if judged else None


def _known(task: TaskPlan, node: Node) -> float | None:
    """The value of a part of an expression that params alone tell; None of any other."""
    interval = evaluate(node, _ALGEBRA, lambda name: _natural(task, name))
    return interval.low if interval.low == interval.high else None


def _never(
    task: TaskPlan, expectation: Expectation, before: Sequence[Expectation]
) -> Finding | None:
    """What can never hold, by itself or beside what was expected before; None where it can."""
    expression = expectation.expression

    def lookup(name: Name) -> Interval:
        return _natural(task, name)

    for part in parts(expression.tree):
        if value_of(part, _ALGEBRA, lookup).never:
            return error(
                "TS722",
                "this can never hold: no values of its signals make it true",
                expression.where(part),
                "correct the number or the relation",
            )
    for other in before:
        if isinstance(other.expression.tree, Held):
            continue
        bounds = bounds_of([other.expression.tree], _ALGEBRA, lookup)
        if not value_of(expression.tree, _ALGEBRA, lookup, bounds).never:
            continue
        if value_of(other.expression.tree, _ALGEBRA, lookup).never:
            continue  # Reported by itself.
        place = other.expression.span
        return error(
            "TS722",
            "this and an expectation before it exclude each other",
            expression.span,
            "a run can meet one of them at the most",
            () if place is None else (("the other one", place),),
        )
    return None


def _natural(task: TaskPlan, name: Name) -> Interval:
    """What a true signal can be by its nature."""
    stage = _stage_of(task.context, name)
    found = entry_of(task.context.loaded.task, name.path[1:] if stage else name.path)
    if found is None:
        return constant(task.context, name) or ANY
    if stage and found.signal is CLOCKS["t"]:
        return Interval(0.0, task.stages[stage].longest)
    return natural(found)


def _beside_a_set_point(task: TaskPlan, expectation: Expectation) -> Iterator[Finding]:
    """A force that is expected to be something else than its loop makes it."""
    context, expression = task.context, expectation.expression
    for part in parts(expression.tree):
        signals = {n for n in names(part) if not _is_constant(context, n)}
        reducers = {n.reducer for n in walk(part) if isinstance(n, Reduce)}
        if len(signals) != 1:
            continue
        (signal,) = signals
        wanted = _set_point(task, signal)
        if wanted is None:
            continue

        def lookup(name: Name, held: Name = signal, value: float = wanted) -> Interval:
            return point(value) if name == held else _natural(task, name)

        if reducers <= {*_LATE}:
            never = value_of(part, _ALGEBRA, lookup).never
        else:
            never = _never_beyond(task, part, signal, wanted)
        if never:
            stage, kind, axis = signal.path
            unit = FORCE.on(rotation=kind == "torque")
            width = "5 %" if wanted else f"0.5 {next(iter(fitting(unit)))}"
            yield warning(
                "TS723",
                f"stage {stage!r} holds {show(wanted, unit)} on {axis!r}, and this does not hold "
                "there",
                expression.where(part),
                f"expect the set point, with a tolerance: 'within {show(wanted, unit)} +- {width}'",
            )


def _never_beyond(task: TaskPlan, part: Node, signal: Name, wanted: float) -> bool:
    """Whether a condition on greatest or least values excludes a value that is reached."""
    bounds: dict[Node, Interval] = {}
    for node in walk(part):
        if isinstance(node, Reduce) and node.arg == signal:
            if node.reducer == "max":
                bounds[node] = Interval(wanted, math.inf)
            elif node.reducer == "min":
                bounds[node] = Interval(-math.inf, wanted)
    return (
        bool(bounds) and value_of(part, _ALGEBRA, lambda name: _natural(task, name), bounds).never
    )


def _is_constant(context: Context, name: Name) -> bool:
    return len(name.path) == 1 and name.path[0] in ("pi", *context.loaded.task.params)


def _set_point(task: TaskPlan, signal: Name) -> float | None:
    """The steady set point of a force that a loop reaches [N, N m]; None where there is none."""
    name = _stage_of(task.context, signal)
    if name is None or signal.frame is not None or len(signal.path) != len(("stage", "force", "z")):
        return None
    stage, axis = task.stages[name], as_axis(signal.path[2])
    entry = None if axis is None else stage.spec.axes.get(axis)
    # Motion that shares the axis, or a program, may leave another force.
    facts = stage.law.control_law
    if entry is None or not facts.force_loop or facts.shares or stage.law.solve == "qp":
        return None
    force = entry.set_point
    if axis is None or force is None or signal.path[1] != axis.effort:
        return None
    return known_value(task.context, force.wanted)


@rule("TS727", "an expectation that a guard ends short of", phase=Phase.RUN)
def short_ends(task: TaskPlan) -> Iterator[Finding]:
    """Last values beyond those at which the stage's own guard ends it."""
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        for condition in parts(expression.tree):
            finding = _short_of(task, expression, condition)
            if finding is not None:
                yield finding


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
    if stage is None or not isinstance(guard, Compare) or not _is_of(guard.left, name.path[1:]):
        return None
    passage = stage.nominal.passage
    if passage is None or len(passage.instants) == 1:
        return None  # Nothing says that it comes there by going on.
    up = condition.op.startswith(">")
    if guard.op.startswith(">") != up:
        return None
    least, ends = _known(task, condition.right), _known(task, guard.right)
    if least is None or ends is None or (least < ends if up else least > ends):
        return None
    return warning(
        "TS727",
        f"the guard of stage {name.path[0]!r} ends it in the tick in which this would hold, "
        "and that tick is no longer one of its own",
        expression.where(condition),
        "expect a little less than the guard waits for, or let the guard wait for a little more",
    )


def _is_of(node: Node, path: tuple[str, ...]) -> bool:
    return isinstance(node, Name) and node.path == path and node.frame is None


def _ends_by_touch(stage: StagePlan) -> bool:
    """Whether a stage comes from free space, by a motion alone, and ends as soon as it touches."""
    gap, until = stage.nominal.gap, stage.spec.until
    pushes = any(plan.set_point for plan in stage.plans.values()) or stage.spec.constraints
    if until is None or isinstance(until.tree, Held) or pushes or stage.contacts.held:
        return False
    if stage.contacts.approached is None or (gap is not None and gap < AT_SURFACE):
        return False
    sensed = {"force", "torque", "touching"}
    return any(sensed & {*name.path} for name in names(until.tree))
