"""Guards that can never hold, that hold from the beginning, or whose force has the wrong sign."""

from __future__ import annotations

import math
import re
from functools import partial

import numpy as np
from numpy.typing import NDArray

from taskspec.check.reach.statics import steady
from taskspec.foresight.conditions import names, parts, value_of
from taskspec.foresight.interval import Interval, IntervalAlgebra, point
from taskspec.foresight.nominal import AT_SURFACE
from taskspec.foresight.ranges import Ranges, longest
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.program.signals import entry_of
from taskspec.signals.table import WRENCH
from taskspec.spec import AxisEntry
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.expression import Expression, evaluate
from taskspec.text.expression.tree import Compare, Held, Name, Node, walk
from taskspec.text.show import show

register(
    {
        "TS611": "a guard that can never hold",
        "TS612": "a guard whose force has the wrong sign",
        "TS613": "a guard that holds before anything is touched",
        "TS618": "a failure that the set point brings about",
    }
)

Vector = NDArray[np.float64]

#: Another object may push the other way from this share of its normal on.
_SLIGHTLY = 0.1


def check_guards(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: Vector,
    gap: float | None,
    found: Diagnostics,
) -> None:
    """Reports guards of stage `name` that cannot do what they are for.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose.
        gap: to the nominal contact as the stage begins [m]; None where it is not known.
        found: where findings go.
    """
    stage = context.loaded.task.stages[name]
    algebra = IntervalAlgebra(longest(context, stage))
    for key, guard in (("until", stage.until), ("fail_if", stage.fail_if)):
        if guard is None:
            continue
        ranges = Ranges(context, name)
        if _never(guard.tree, algebra, ranges):
            _report_never(context, name, key, guard, algebra, ranges, found)
            continue
        signs = _signs(context, name, axes, rotation)
        if signs and value_of(guard.tree, algebra, Ranges(context, name, signs)).never:
            _report_sign(name, guard, signs, found)
        elif _always(guard.tree, algebra, ranges):
            found.warning(
                "TS613",
                f"this always holds, so stage {name!r} ends as it begins",
                guard.span,
                "turn the relation round, or leave the guard out",
            )
        elif key == "fail_if" and _held_by_set_points(context, name, axes, guard, algebra):
            found.warning(
                "TS618",
                f"stage {name!r} fails as soon as it has its set points: this holds there",
                guard.span,
                "let it begin beyond them, or lower the set points",
            )
        elif _apart(context, gap) and _holds_untouched(context, name, guard, algebra):
            found.warning(
                "TS613",
                f"this holds as soon as stage {name!r} begins, when nothing is touched yet",
                guard.span,
                "turn the relation round, or the sign of what it compares with",
            )


def _report_never(
    context: Context,
    name: str,
    key: str,
    guard: Expression,
    algebra: IntervalAlgebra,
    ranges: Ranges,
    found: Diagnostics,
) -> None:
    inner = guard.tree.x if isinstance(guard.tree, Held) else guard.tree
    culprit = next((p for p in parts(inner) if _never(p, algebra, ranges)), None)
    reasons = [reason for n in names(culprit or inner) if (reason := ranges.why(n))]
    if culprit is None:
        reasons = ["its conditions exclude each other"]
    end = longest(context, context.loaded.task.stages[name])
    if isinstance(guard.tree, Held) and guard.tree.amount.value_si > end:
        culprit = guard.tree
        reasons = [f"the stage ends after {show(end - context.period, 's')} at the latest"]
    reason = f": {reasons[0]}" if reasons else ": no values of its signals make it true"
    effect = "so the stage can only fail" if key == "until" else "so it does nothing"
    found.add(
        Severity.ERROR if key == "until" else Severity.WARNING,
        "TS611",
        f"{key!r} of stage {name!r} can never hold{reason}, {effect}",
        guard.where(culprit or inner),
        "change the number that it compares with, or the bound that it never gets to",
    )


def _never(node: Node, algebra: IntervalAlgebra, ranges: Ranges) -> bool:
    return value_of(node, algebra, ranges, ranges.magnitudes(node)).never


def _always(node: Node, algebra: IntervalAlgebra, ranges: Ranges) -> bool:
    """Whether a guard holds whatever its signals are, from the first tick on."""
    inner = node.x if isinstance(node, Held) else node
    return evaluate(inner, algebra, ranges).always


def _held_by_set_points(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    guard: Expression,
    algebra: IntervalAlgebra,
) -> bool:
    """Whether a guard holds at the forces which the stage's loops are to reach and keep."""
    stage = context.loaded.task.stages[name]
    if not context.law_of(stage).control_law.force_loop or isinstance(guard.tree, Held):
        return False
    reached = {
        f"{'torque' if axis.startswith('r') else 'force'}.{axis}": point(value)
        for axis, value in steady(context, name, axes).items()
    }
    used = {str(n) for n in names(guard.tree)}
    return (
        bool(used & reached.keys())
        and evaluate(guard.tree, algebra, Ranges(context, name, reached)).always
    )


def _signs(
    context: Context, name: str, axes: tuple[Axis, ...], rotation: Vector
) -> dict[str, Interval]:
    """Half-lines of the forces along axes on which a stage moves or presses into its contact.

    Empty where anything but that contact could push the other way.
    """
    task = context.loaded.task
    stage = task.stages[name]
    contact = context.contact_of(context.frame_of(stage))
    if contact is None or task.equations or task.robot.grasp is not None:
        return {}
    found = {}
    for axis, entry in stage.axes.items():
        if axis not in axes or axis.is_rotation:
            continue
        direction = rotation[:, AXES.index(axis)]
        along = {o: float(direction @ n) for o, n in context.start_normals.items()}
        own = along[contact]
        towards = _direction(context, entry)
        others = any(a * own < -_SLIGHTLY * abs(own) for a in along.values())
        friction = task.shapes[contact].friction
        cone = friction * math.sqrt(max(0.0, 1 - own**2)) <= abs(own)
        if abs(own) > MOSTLY and towards * own < 0 and cone and not others:
            half = Interval(-math.inf, 0.0) if own > 0 else Interval(0.0, math.inf)
            found[f"force.{axis}"] = half
    return found


def _direction(context: Context, entry: AxisEntry) -> float:
    """Which way along its axis an entry moves or presses, as far as it is constant; else 0."""
    heading = entry.mode.heading(partial(known_value, context))
    if heading is not None:
        return heading
    force = entry.set_point
    return (None if force is None else known_value(context, force.wanted)) or 0.0


def _report_sign(
    name: str, guard: Expression, signs: dict[str, Interval], found: Diagnostics
) -> None:
    turned = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
    for node in walk(guard.tree):
        if not isinstance(node, Compare):
            continue
        for side, other, op in (
            (node.left, node.right, node.op),
            (node.right, node.left, turned[node.op]),
        ):
            if not isinstance(side, Name) or str(side) not in signs:
                continue
            sign = "negative" if signs[str(side)].high == 0 else "positive"
            text = _negated(guard, other)
            found.warning(
                "TS612",
                f"stage {name!r} goes into the surface, which makes '{side}' {sign}: this never "
                "holds",
                guard.where(node),
                f"did you mean '{side} {turned[op]} {text}'? forces are what the robot applies",
            )
            return
    found.warning(
        "TS612",
        f"stage {name!r} goes into the surface, and {_listed(signs)}: this never holds",
        guard.span,
        "forces are what the robot applies: pressing goes against the outward normal",
    )


def _listed(signs: dict[str, Interval]) -> str:
    words = [
        f"{a!r} is {'negative' if s.high == 0 else 'positive'} there" for a, s in signs.items()
    ]
    return " and ".join(words)


def _negated(guard: Expression, node: Node) -> str:
    text = guard.text[node.start : node.end].strip()
    if text.startswith("-"):
        return text[1:].strip()
    return f"-{text}" if re.fullmatch(r"[\w.]+( ?[\w*/^]+)?", text) else f"-({text})"


def _apart(context: Context, gap: float | None) -> bool:
    """Whether a stage begins apart from everything that could be felt."""
    task = context.loaded.task
    if task.robot.grasp is not None or task.equations or gap is None:
        return False
    return gap > AT_SURFACE and len(context.start_gaps) == 1


def _holds_untouched(
    context: Context, name: str, guard: Expression, algebra: IntervalAlgebra
) -> bool:
    """Whether a guard holds whatever its signals are, if nothing is felt."""
    task = context.loaded.task
    felt = {
        str(n): point(0.0)
        for n in names(guard.tree)
        if (found := entry_of(task, n.path)) is not None and found.signal.sensed == WRENCH
    }
    inner = guard.tree.x if isinstance(guard.tree, Held) else guard.tree
    return evaluate(inner, algebra, Ranges(context, name, felt)).always
