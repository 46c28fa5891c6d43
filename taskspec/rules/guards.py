"""Guards that no values of their signals make hold: by their numbers, or by the force's sign."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from taskspec.expression import Expression
from taskspec.expression.tree import Compare, Held, Name, Node, walk
from taskspec.geometry.axis import Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.conditions import parts, value_of
from taskspec.program.interval import ANY, Interval, IntervalAlgebra
from taskspec.program.plan import StagePlan
from taskspec.program.signals import constant, entry_of, natural
from taskspec.rules import Finding, rule, warning
from taskspec.signals import CLOCKS
from taskspec.text.diagnostic import Severity
from taskspec.text.units import show

#: Another object may push the other way from this share of its normal on.
_SLIGHTLY = 0.1


@rule("TS612", "a guard that no values of its signals make hold")
def impossible_guards(stage: StagePlan) -> Iterator[Finding]:
    """Guards that exclude themselves, or wait for a force of the wrong sign."""
    algebra = IntervalAlgebra(stage.longest)
    for key, guard in (("until", stage.spec.until), ("fail_if", stage.spec.fail_if)):
        if guard is None:
            continue
        signs = _signs(stage)
        possible = _Possible(stage, {})
        if value_of(guard.tree, algebra, possible).never:
            yield _impossible(stage, key, guard, algebra, possible)
        elif signs and value_of(guard.tree, algebra, _Possible(stage, signs)).never:
            yield _wrong_sign(stage.name, guard, signs)


class _Possible:
    """The interval of each signal of a stage that is possible whatever moves [SI]."""

    def __init__(self, stage: StagePlan, known: dict[str, Interval]) -> None:
        self._stage, self._known = stage, known

    def __call__(self, name: Name) -> Interval:
        if str(name) in self._known:
            return self._known[str(name)]
        found = entry_of(self._stage.context.loaded.task, name.path)
        if found is None:
            return constant(self._stage.context, name) or ANY
        if found.signal is CLOCKS["t"]:
            return Interval(0.0, self._stage.longest)
        return natural(found)


def _impossible(
    stage: StagePlan, key: str, guard: Expression, algebra: IntervalAlgebra, possible: _Possible
) -> Finding:
    inner = guard.tree.x if isinstance(guard.tree, Held) else guard.tree
    culprit = next((p for p in parts(inner) if value_of(p, algebra, possible).never), None)
    reason = "no values of its signals make it true"
    if isinstance(guard.tree, Held) and guard.tree.amount.value_si > stage.longest:
        culprit = guard.tree
        most = show(stage.longest - stage.context.period, "s")
        reason = f"the stage ends after {most} at the latest"
    elif culprit is None:
        reason = "its conditions exclude each other"
    # A file that says where to go on after a failure may still come to a good end.
    refused = key == "until" and stage.spec.on_fail in (None, "fail")
    effect = "so the stage can only fail" if key == "until" else "so it does nothing"
    return Finding(
        "TS612",
        f"{key!r} of stage {stage.name!r} can never hold: {reason}, {effect}",
        guard.where(culprit or inner),
        "change the number that it compares with, or the bound that it never gets to",
        severity=Severity.ERROR if refused else Severity.WARNING,
    )


def _signs(stage: StagePlan) -> dict[str, Interval]:
    """Half-lines of the forces along axes on which a stage moves or presses into its contact.

    Empty where anything but that contact could push the other way.
    """
    task = stage.context.loaded.task
    if task.equations or task.bushings or task.carried:
        return {}
    signs = {}
    for axis in stage.spec.axes:
        contact = stage.contacts.of(axis) if axis in stage.translations else None
        if contact is None:
            continue
        along = {
            o: stage.kinematics.along(axis, stage.contacts.normal(o))
            for o in stage.context.start_normals
        }
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
    return heading if heading is not None else stage.set_points.of(axis) or 0.0


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
