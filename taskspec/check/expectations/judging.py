"""Expectations that no good run can meet, or that cannot be judged."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from taskspec.check.axes.signals import no_such_signal
from taskspec.check.stages.conditions import bounds_of, names, parts, value_of
from taskspec.foresight.flow import good_end, reached
from taskspec.foresight.interval import ANY, Interval, IntervalAlgebra, point
from taskspec.foresight.ranges import constant, longest, natural
from taskspec.geometry.axis import Axis, as_axis
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.program.signals import entry_of
from taskspec.signals import CLOCKS
from taskspec.spec import Expectation
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.expression import evaluate
from taskspec.text.expression.tree import Call, Held, Name, Node, Reduce, Within, walk
from taskspec.text.show import show

register(
    {
        "TS720": "an expectation of a stage that is not entered",
        "TS721": "an expectation of a signal that a stage does not have",
        "TS722": "an expectation that can never hold",
        "TS723": "an expectation that a set point contradicts",
        "TS724": "an expectation of a time finer than a tick",
    }
)

_ALGEBRA = IntervalAlgebra()
#: Reducers whose value is that of a steady signal although the signal was another before.
_LATE = ("last",)


def check_judging(
    context: Context, axes_of: Mapping[str, tuple[Axis, ...]], found: Diagnostics
) -> None:
    """Reports expectations that fail whatever happens, or in every run that ends well.

    Args:
        context: the task. axes_of: that exist in the frame of each stage. found: where findings go.
    """
    expectations = context.loaded.task.expect
    for number, expectation in enumerate(expectations):
        _check_visited(context, expectation, found)
        _check_valued(context, axes_of, expectation, found)
        _check_ticks(context, expectation, found)
        if not _check_possible(context, expectation, expectations[:number], found):
            _check_set_point(context, expectation, found)


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


def _check_visited(context: Context, expectation: Expectation, found: Diagnostics) -> None:
    stages = context.loaded.task.stages
    expression, way = expectation.expression, _well(context)
    told: set[str] = set()
    for name in names(expression.tree):
        stage = _stage_of(context, name)
        if stage is None or stage in way or stage in told:
            continue
        told.add(stage)
        if stage in reached(stages, {next(iter(stages))}):
            found.warning(
                "TS720",
                f"stage {stage!r} is entered only after a failure: in a run without one this fails",
                expression.where(name),
                "expect something of a stage that every good run enters",
            )
        else:
            found.error(
                "TS720",
                f"stage {stage!r} is never entered, so this always fails",
                expression.where(name),
                "lead to the stage with 'next' or 'on_fail', or leave the expectation out",
            )


def _check_valued(
    context: Context,
    axes_of: Mapping[str, tuple[Axis, ...]],
    expectation: Expectation,
    found: Diagnostics,
) -> None:
    """Reports signals of the whole run that some stage of every good run does not have."""
    expression = expectation.expression
    inside = {
        name
        for call in walk(expression.tree)
        if isinstance(call, Call) and call.function == "norm"
        for name in names(call)
    }
    for name in names(expression.tree):
        if name in inside or _stage_of(context, name) is not None or name.path[0] == "path_done":
            continue
        here = Name(name.path)  # The verdict resolves other frames from the log.
        for stage in _well(context):
            if name.frame is not None or stage not in axes_of:
                continue
            reason = no_such_signal(context, stage, axes_of[stage], here, inside_norm=False)
            if reason is None:
                continue
            found.error(
                "TS721",
                f"{name} is judged in the whole run, and has no value in stage {stage!r}: {reason}",
                expression.where(name),
                f"ask for it in the stages that have it, as in STAGE.{name}",
            )
            break


def _check_ticks(context: Context, expectation: Expectation, found: Diagnostics) -> None:
    """Reports times that are to be met more finely than ticks come."""
    expression = expectation.expression
    for part in parts(expression.tree):
        if not isinstance(part, Within):
            continue
        inner = part.x.arg if isinstance(part.x, Reduce) else part.x
        low, high = (known(context, end) for end in (part.low, part.high))
        if not isinstance(inner, Name) or inner.path[-1] not in ("t", "clock"):
            continue
        if low is not None and high is not None and 0 <= high - low < context.period:
            found.warning(
                "TS724",
                f"this asks for a time within {show(high - low, 'ms', 3)}, and the controller "
                f"ticks every {show(context.period, 'ms', 3)}",
                expression.where(part),
                "widen it to one tick at least",
            )


def known(context: Context, node: Node) -> float | None:
    """The value of a part of an expression that params alone tell; None of any other."""
    interval = evaluate(node, _ALGEBRA, lambda name: _natural(context, name))
    return interval.low if interval.low == interval.high else None


def _check_possible(
    context: Context, expectation: Expectation, before: Sequence[Expectation], found: Diagnostics
) -> bool:
    """Reports what can never hold, by itself or beside what was expected before."""
    expression = expectation.expression

    def lookup(name: Name) -> Interval:
        return _natural(context, name)

    for part in parts(expression.tree):
        if value_of(part, _ALGEBRA, lookup).never:
            found.error(
                "TS722",
                "this can never hold: no values of its signals make it true",
                expression.where(part),
                "correct the number or the relation",
            )
            return True
    for other in before:
        if isinstance(other.expression.tree, Held):
            continue
        bounds = bounds_of([other.expression.tree], _ALGEBRA, lookup)
        if not value_of(expression.tree, _ALGEBRA, lookup, bounds).never:
            continue
        if value_of(other.expression.tree, _ALGEBRA, lookup).never:
            continue  # Told by itself.
        place = other.expression.span
        found.error(
            "TS722",
            "this and an expectation before it exclude each other",
            expression.span,
            "a run can meet one of them at the most",
            () if place is None else (("the other one", place),),
        )
        return True
    return False


def _natural(context: Context, name: Name) -> Interval:
    """What a true signal can be by its nature."""
    stage = _stage_of(context, name)
    found = entry_of(context.loaded.task, name.path[1:] if stage else name.path)
    if found is None:
        return constant(context, name) or ANY
    if stage and found.signal is CLOCKS["t"]:
        return Interval(0.0, longest(context, context.loaded.task.stages[stage]))
    return natural(found)


def _check_set_point(context: Context, expectation: Expectation, found: Diagnostics) -> None:
    """Reports a force that is expected to be something else than its loop makes it."""
    expression = expectation.expression
    for part in parts(expression.tree):
        signals = {n for n in names(part) if not _is_constant(context, n)}
        reducers = {n.reducer for n in walk(part) if isinstance(n, Reduce)}
        if len(signals) != 1:
            continue
        (signal,) = signals
        wanted = _set_point(context, signal)
        if wanted is None:
            continue

        def lookup(name: Name, held: Name = signal, value: float = wanted) -> Interval:
            return point(value) if name == held else _natural(context, name)

        if reducers <= {*_LATE}:
            never = value_of(part, _ALGEBRA, lookup).never
        else:
            never = _never_beyond(context, part, signal, wanted)
        if never:
            stage, kind, axis = signal.path
            unit = "N" if kind == "force" else "N*m"
            found.warning(
                "TS723",
                f"stage {stage!r} holds {show(wanted, unit)} on {axis!r}, and this does not hold "
                "there",
                expression.where(part),
                "expect the set point, with a tolerance: 'within -press +- 0.5 N'",
            )


def _never_beyond(context: Context, part: Node, signal: Name, wanted: float) -> bool:
    """Whether a condition on greatest or least values excludes a value that is reached."""
    bounds: dict[Node, Interval] = {}
    for node in walk(part):
        if isinstance(node, Reduce) and node.arg == signal:
            if node.reducer == "max":
                bounds[node] = Interval(wanted, math.inf)
            elif node.reducer == "min":
                bounds[node] = Interval(-math.inf, wanted)
    return (
        bool(bounds)
        and value_of(part, _ALGEBRA, lambda name: _natural(context, name), bounds).never
    )


def _is_constant(context: Context, name: Name) -> bool:
    return len(name.path) == 1 and name.path[0] in ("pi", *context.loaded.task.params)


def _set_point(context: Context, signal: Name) -> float | None:
    """The steady set point of a force that a loop reaches [N, N m]; None where there is none."""
    stage = _stage_of(context, signal)
    if (
        stage is None
        or signal.frame is not None
        or len(signal.path) != len(("stage", "force", "z"))
    ):
        return None
    declared, axis = context.loaded.task.stages[stage], as_axis(signal.path[2])
    law = context.law_of(declared)
    entry = None if axis is None else declared.axes.get(axis)
    # Motion that shares the axis, or a program, may leave another force.
    if (
        entry is None
        or not law.control_law.force_loop
        or law.control_law.shares
        or law.solve == "qp"
    ):
        return None
    wanted = {"force": entry.force, "torque": entry.torque}.get(signal.path[1])
    return None if wanted is None else known_value(context, wanted)
