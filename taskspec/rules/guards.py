"""Guards that can never hold, that hold from the beginning, or whose force has the wrong sign."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from taskspec.foresight.conditions import names, parts, value_of
from taskspec.foresight.ranges import Ranges
from taskspec.geometry.axis import Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.flow import leading_to
from taskspec.program.held_part import HeldPart
from taskspec.program.interval import Interval, IntervalAlgebra, point
from taskspec.program.plan import StagePlan
from taskspec.program.signals import entry_of
from taskspec.program.walk.nominal import AT_SURFACE
from taskspec.rules import Finding, rule, warning
from taskspec.signals.entries import TOUCHING
from taskspec.signals.table import WRENCH
from taskspec.text.diagnostic import Severity
from taskspec.text.expression import Expression, evaluate
from taskspec.text.expression.tree import Compare, Held, Name, Node, walk
from taskspec.text.units import show

#: Of the time for which a guard is to hold, what is left once the set points are there.
_SETTLED = 2.0
#: By this share what is carried may weigh more or less, as the arm sets off or gives way.
_SWAYS = 0.1
#: Another object may push the other way from this share of its normal on.
_SLIGHTLY = 0.1


@rule(
    {
        "TS611": "a guard that can never hold",
        "TS612": "a guard whose force has the wrong sign",
        "TS613": "a guard that holds before anything is touched",
        "TS618": "a failure that the set point brings about",
    }
)
def useless_guards(stage: StagePlan) -> Iterator[Finding]:
    """Guards that cannot do what they are for: of each, the first reason that applies."""
    name = stage.name
    algebra = IntervalAlgebra(stage.longest)
    for key, guard in (("until", stage.spec.until), ("fail_if", stage.spec.fail_if)):
        if guard is None:
            continue
        ranges = Ranges(stage)
        if _never(guard.tree, algebra, ranges):
            yield _impossible(stage, key, guard, algebra, ranges)
            continue
        signs = _signs(stage)
        if signs and value_of(guard.tree, algebra, Ranges(stage, signs)).never:
            yield _wrong_sign(name, guard, signs)
        elif _always(guard.tree, algebra, ranges):
            yield warning(
                "TS613",
                f"this always holds, so stage {name!r} ends as it begins",
                guard.span,
                "turn the relation round, or leave the guard out",
            )
        elif key == "fail_if" and _held_by_set_points(stage, guard, algebra):
            yield warning(
                "TS618",
                f"stage {name!r} fails as soon as it has its set points: this holds there",
                guard.span,
                "let it begin beyond them, or lower the set points",
            )
        elif _apart(stage) and _holds_untouched(stage, guard, algebra):
            yield warning(
                "TS613",
                f"this holds as soon as stage {name!r} begins, when nothing is touched yet",
                guard.span,
                "turn the relation round, or the sign of what it compares with",
            )
        elif key == "until" and (before := _pressed_before(stage, guard, algebra)):
            yield warning(
                "TS613",
                f"this holds as soon as stage {name!r} begins: {before!r} before it presses with "
                "the same forces already",
                guard.span,
                f"wait for more than {before!r} presses with, or for something else",
            )
        elif (part := _hanging(stage)) and _holds_carrying(stage, guard, algebra, part):
            weight = show(float(np.linalg.norm(part.weight)), "N", 3)
            yield warning(
                "TS613",
                f"this holds as soon as stage {name!r} begins: {part.name!r} weighs {weight}, "
                "which the robot applies from the first tick on",
                guard.span,
                "wait for more than the weight, or tare the sensor in a stage before this one",
            )


def _impossible(
    stage: StagePlan, key: str, guard: Expression, algebra: IntervalAlgebra, ranges: Ranges
) -> Finding:
    inner = guard.tree.x if isinstance(guard.tree, Held) else guard.tree
    culprit = next((p for p in parts(inner) if _never(p, algebra, ranges)), None)
    reasons = [reason for n in names(culprit or inner) if (reason := ranges.why(n))]
    if culprit is None:
        reasons = ["its conditions exclude each other"]
    end = stage.longest
    if isinstance(guard.tree, Held) and guard.tree.amount.value_si > end:
        culprit = guard.tree
        most = show(end - stage.context.period, "s")
        reasons = [f"the stage ends after {most} at the latest"]
    reason = f": {reasons[0]}" if reasons else ": no values of its signals make it true"
    effect = "so the stage can only fail" if key == "until" else "so it does nothing"
    # A file that says where to go on after a failure may still come to a good end.
    refused = key == "until" and stage.spec.on_fail in (None, "fail")
    refused = refused and not _on_a_knob_that_turns(stage, culprit or inner)
    return Finding(
        "TS611",
        f"{key!r} of stage {stage.name!r} can never hold{reason}, {effect}",
        guard.where(culprit or inner),
        "change the number that it compares with, or the bound that it never gets to",
        severity=Severity.ERROR if refused else Severity.WARNING,
    )


def _on_a_knob_that_turns(stage: StagePlan, guard: Node) -> bool:
    """Whether a guard waits for how far a mechanism goes on whose knob the hand may turn.

    How a turn of the hand is shared between knob and mechanism, what each resists with decides.
    """
    mechanisms = stage.context.loaded.task.mechanisms
    held = {name.path[0] for name in names(guard)} & mechanisms.keys()
    return any(mechanisms[name].knob == "free" for name in held)


def _never(node: Node, algebra: IntervalAlgebra, ranges: Ranges) -> bool:
    return value_of(node, algebra, ranges, ranges.magnitudes(node)).never


def _always(node: Node, algebra: IntervalAlgebra, ranges: Ranges) -> bool:
    """Whether a guard holds whatever its signals are, from the first tick on."""
    inner = node.x if isinstance(node, Held) else node
    return evaluate(inner, algebra, ranges).always


def _held_by_set_points(stage: StagePlan, guard: Expression, algebra: IntervalAlgebra) -> bool:
    """Whether a guard holds at the forces which the stage's loops are to reach and keep."""
    if not stage.law.control_law.force_loop:
        return False
    node = guard.tree
    if isinstance(node, Held):
        rises = [entry.set_point.rise for entry in stage.spec.axes.values() if entry.set_point]
        if stage.longest < max(rises, default=0.0) + _SETTLED * node.amount.value_si:
            return False
        node = node.x
    reached = {f"{a.effort}.{a}": point(value) for a, value in stage.set_points.items()}
    used = {str(n) for n in names(guard.tree)}
    return bool(used & reached.keys()) and evaluate(node, algebra, Ranges(stage, reached)).always


def _signs(stage: StagePlan) -> dict[str, Interval]:
    """Half-lines of the forces along axes on which a stage moves or presses into its contact.

    Empty where anything but that contact could push the other way.
    """
    task = stage.context.loaded.task
    if task.equations or task.robot.grasp is not None:
        return {}
    signs = {}
    for axis in stage.spec.axes:
        contact = stage.contact_of(axis) if axis in stage.translations else None
        if contact is None:
            continue
        along = {o: stage.along(axis, stage.normal_of(o)) for o in stage.context.start_normals}
        own = along[contact]
        towards = _direction(stage, axis)
        others = any(a * own < -_SLIGHTLY * abs(own) for a in along.values())
        friction = task.shapes[contact].friction
        cone = friction * math.sqrt(max(0.0, 1 - own**2)) <= abs(own)
        if abs(own) > MOSTLY and towards * own < 0 and cone and not others:
            half = Interval(-math.inf, 0.0) if own > 0 else Interval(0.0, math.inf)
            signs[f"force.{axis}"] = half
    return signs


def _direction(stage: StagePlan, axis: Axis) -> float:
    """Which way along an axis a stage moves or presses, as far as it is constant; else 0."""
    heading = stage.spec.axes[axis].mode.heading(stage.known)
    return heading if heading is not None else stage.set_point_of(axis) or 0.0


def _wrong_sign(name: str, guard: Expression, signs: dict[str, Interval]) -> Finding:
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
            return warning(
                "TS612",
                f"stage {name!r} goes into the surface, which makes '{side}' {sign}: this never "
                "holds",
                guard.where(node),
                f"did you mean '{side} {turned[op]} {text}'? forces are what the robot applies",
            )
    return warning(
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


def _apart(stage: StagePlan) -> bool:
    """Whether a stage starts apart from everything that could be felt."""
    task, gap = stage.context.loaded.task, stage.nominal.gap
    if task.robot.grasp is not None or task.equations or gap is None:
        return False
    return gap > AT_SURFACE and len(stage.context.start_gaps) == 1


def _holds_untouched(stage: StagePlan, guard: Expression, algebra: IntervalAlgebra) -> bool:
    """Whether a guard holds whatever its signals are, if nothing is felt."""
    task = stage.context.loaded.task
    contact_signals = {
        str(n): point(0.0)
        for n in names(guard.tree)
        if (entry := entry_of(task, n.path)) is not None and entry.signal.sensed == WRENCH
    }
    inner = guard.tree.x if isinstance(guard.tree, Held) else guard.tree
    return evaluate(inner, algebra, Ranges(stage, contact_signals)).always


def _pressed_before(stage: StagePlan, guard: Expression, algebra: IntervalAlgebra) -> str:
    """The stage before one whose set points make its guard hold as it begins; empty for none.

    It has the same set points on the same axes, so that the force is there when they are handed
    over.
    """
    task, node = stage.context.loaded.task, guard.tree
    if isinstance(node, Held) or not stage.law.control_law.force_loop or stage.spec.tare:
        return ""
    before = leading_to(task.stages, stage.name)
    if len(before) != 1 or any(each.on_fail == stage.name for each in task.stages.values()):
        return ""
    previous = StagePlan(stage.context, before[0])
    if previous.frame.name != stage.frame.name or previous.law.kind != stage.law.kind:
        return ""
    kept = {
        f"{a.effort}.{a}": point(value)
        for a, value in stage.set_points.items()
        if previous.set_points.get(a) == value
    }
    used = {str(n) for n in names(node)}
    holds = bool(used & kept.keys()) and evaluate(node, algebra, Ranges(stage, kept)).always
    return before[0] if holds else ""


def _hanging(stage: StagePlan) -> HeldPart | None:
    """The loose body whose weight the tool bears as the run begins with this stage."""
    task = stage.context.loaded.task
    if stage.name != next(iter(task.stages)) or task.equations or stage.spec.tare:
        return None
    part = HeldPart.of(stage.context)
    return part if part is not None and part.hangs else None


def _holds_carrying(
    stage: StagePlan, guard: Expression, algebra: IntervalAlgebra, part: HeldPart
) -> bool:
    """Whether a guard holds with the weight of what is held, whatever the other signals are."""
    weight = float(np.linalg.norm(part.weight))
    known = {
        "touching": Interval(*(float(s * weight > TOUCHING) for s in (1 - _SWAYS, 1 + _SWAYS)))
    }
    for axis, force in zip("xyz", stage.rotation.T @ part.weight, strict=True):
        ends = sorted(((1 - _SWAYS) * float(force), (1 + _SWAYS) * float(force)))
        known[f"force.{axis}"] = Interval(*ends)
    inner = guard.tree.x if isinstance(guard.tree, Held) else guard.tree
    if any(n.frame is not None for n in names(inner)):
        return False
    return evaluate(inner, algebra, Ranges(stage, known)).always
