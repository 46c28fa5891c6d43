"""`vary`: what is uncertain about the real world."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.shapes import SHAPES, size_keys
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.model import mapping
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.world import is_free
from taskspec.text.codes import register
from taskspec.text.data import Items, Map
from taskspec.text.expression import FloatAlgebra, Problem, ScopeKind, check, evaluate
from taskspec.text.expression.intervals import share_of_a_number, share_problems
from taskspec.text.expression.tree import IntervalNode, Node, SpreadNode, is_share
from taskspec.text.suggest import closest, suggestion
from taskspec.text.units import (
    ANGLE,
    ANGULAR_DAMPING,
    ANGULAR_STIFFNESS,
    DAMPING,
    FORCE,
    FREQUENCY,
    INERTIA,
    LENGTH,
    MASS,
    MOMENT,
    NUMBER,
    STIFFNESS,
    TIME,
    Dimension,
    describe,
)

register({"TS710": "a variation of something that cannot vary"})

Target = tuple[Dimension, ...]
"""Dimension of each component."""

_CONTACT: dict[str, Target] = {"stiffness": (STIFFNESS,), "damping": (DAMPING,)}
_PLACE: dict[str, Target] = {"xyz": (LENGTH,) * 3, "rpy": (ANGLE,) * 3}
_SIZES: dict[str, Target] = {k.name: (k.dimension,) * k.entries for k in size_keys().values()}
_TURNING: dict[str, Target] = {"damping": (ANGULAR_DAMPING,), "friction": (MOMENT,)}
_INERTIA: dict[str, Target] = {"inertia": (INERTIA,)}
_MASS: dict[str, Target] = {"mass": (MASS,)}

OBJECT: dict[str, dict[str, Target]] = {
    "shape": _CONTACT | {"friction": (NUMBER,)} | _PLACE | _SIZES | _MASS,
    "equation": _CONTACT,
    "joint equation": {"stiffness": (ANGULAR_STIFFNESS,), "damping": (ANGULAR_DAMPING,)},
    "hinge": _PLACE | _TURNING | _INERTIA,
    "slide": _PLACE | {"damping": (DAMPING,), "friction": (FORCE,)} | _MASS,
    "screw": _PLACE | _TURNING | _INERTIA | _MASS,
}
"""Values of an object that can vary, by its kind."""

ROBOT: dict[str, Target] = {
    "tool.mass": (MASS,),
    "joint_damping": (ANGULAR_DAMPING,),
    "sensor.delay": (TIME,),
    "sensor.noise.force": (FORCE,),
    "sensor.noise.torque": (MOMENT,),
    "sensor.bias": (FORCE,) * 3 + (MOMENT,) * 3,
    "sensor.filter": (FREQUENCY,),
}
"""Values of the robot that can vary; a joint damping is that of every joint."""

_SUCH_AS = {
    LENGTH: "such as [+- 2 mm, 0, 0]",
    ANGLE: "such as [+- 3 deg, 0, 0]",
    FORCE: "such as [+- 1 N, 0, 0, 0, 0, 0]",
}


@dataclass(frozen=True, slots=True)
class Variation:
    """An uncertain component.

    Attributes:
        low, high: its ends [SI], or how far they are from the nominal value.
        relative: to the nominal value.
        share: `low` and `high` are shares of the nominal value, such as 0.05 for 5 %.
    """

    low: float
    high: float
    relative: bool
    share: bool = False

    def ends(self, nominal: float) -> tuple[float, float]:
        """Least and greatest value [SI] where the file has the `nominal` one."""
        base = nominal if self.relative else 0.0
        scale = abs(nominal) if self.share else 1.0
        return base + scale * self.low, base + scale * self.high


@dataclass(frozen=True)
class Variations(FieldType):
    """Paths of values, each with an interval for every component."""

    def read(self, value: object, context: ParseContext) -> dict[str, tuple[Variation | None, ...]]:
        """The variations by path; a component that does not vary is None."""
        if not isinstance(value, Map):
            message = f"'vary' is a mapping of paths to intervals, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "world.table.stiffness: 5..80 kN/m")
            return {}
        found = {}
        for path, entry in value.items():
            target = _target(path, value, context)
            if target is not None:
                found[path] = _components(entry, target, context)
        return found

    def json(self) -> dict[str, Any]:
        """Describes the mapping."""
        one = {"type": ["string", "number"], "description": "'a..b', '+- x', or 0"}
        entry = {"anyOf": [one, {"type": "array", "items": one}]}
        return {"type": "object", "additionalProperties": entry}


def _target(path: str, data: Map, context: ParseContext) -> Target | None:
    """What a path names, or None after reporting that nothing there can vary."""
    section, _, rest = path.partition(".")
    owner, _, key = rest.partition(".")
    span = data.node.key_span(path)
    if section == "robot":
        if rest in ROBOT:
            return ROBOT[rest]
        near = closest(rest, ROBOT)
        hint = suggestion("", ROBOT, "values of the robot that can vary")
        hint = hint if near is None else f"did you mean 'robot.{near}'?"
        context.error("TS710", f"'{path}' is no value that can vary", span, hint)
        return None
    if section == "world" and owner in context.objects:
        raw = mapping(mapping(context.data.get("world")).get(owner))
        fields = _fields(raw, context.objects[owner])
        if fields is None or key in fields:
            return OBJECT[context.objects[owner]].get(key)
        hint = suggestion(key, fields, f"values of '{owner}' that can vary")
        context.error("TS710", f"'{key}' of '{owner}' is no value that can vary", span, hint)
        return None
    if section == "world" and owner:
        hint = suggestion(owner, context.objects, "objects")
        context.error("TS123", f"unknown object '{owner}'", span, hint)
        return None
    options = [f"world.{name}.stiffness" for name in context.objects]
    options += [f"robot.{name}" for name in ROBOT]
    hint = suggestion(path, options, "values that can vary")
    context.error("TS710", f"'{path}' is no value that can vary", span, hint)
    return None


def _fields(data: Map, kind: str) -> list[str] | None:
    """The values of a raw object that can vary; None if its shape is not known."""
    if kind != "shape":
        return list(OBJECT[kind])
    name = data.get("shape")
    if not isinstance(name, str) or name not in SHAPES:
        return None
    missing = size_keys().keys() - {key.name for key in SHAPES[name].keys}
    missing |= set() if is_free(data) else {"mass"}
    return [key for key in OBJECT[kind] if key not in missing]


def _components(
    value: object, target: Target, context: ParseContext
) -> tuple[Variation | None, ...]:
    count = len(target)
    if count == 1:
        if isinstance(value, Items):
            message = "one interval is needed here, this is a list"
            context.error("TS023", message, span_of(value))
            return ()
        return (_variation(value, target[0], context),)
    if not isinstance(value, Items) or len(value) != count:
        if not (isinstance(value, Items) and value.node.broken):
            hint = _SUCH_AS.get(target[0], "")
            message = f"{count} components are needed here, 0 for one that does not vary"
            context.error("TS023", message, span_of(value), hint)
        return ()
    return tuple(
        _variation(entry, dimension, context)
        for entry, dimension in zip(value, target, strict=True)
    )


def _variation(value: object, dimension: Dimension, context: ParseContext) -> Variation | None:
    node = values.parsed(value, "uncertain", context, "an interval")
    if node is None:
        return None
    checked = check(node, context.scope(ScopeKind.CONSTANT), dimension)
    problems = checked.problems
    if problems and isinstance(node, IntervalNode) and is_share(node.high):
        width = f"+- {100 * evaluate(node.high, FloatAlgebra(), lambda _: math.nan):g} %"
        hint = f"a share of the value in the file is written {width}"
        problems = tuple(replace(each, hint=hint) for each in problems)
    context.problems(value, problems)
    if problems:
        return None
    node = checked.tree
    if isinstance(node, SpreadNode):
        return _spread(value, node, dimension, context)
    if isinstance(node, IntervalNode):
        return _interval(value, node, context)
    nominal = values.number(value, node, context)
    if nominal != 0 and nominal is not None:
        message = f"{describe(dimension)} that varies is an interval"
        _report(value, node, message, context)
    return None


def _spread(
    value: object, node: SpreadNode, dimension: Dimension, context: ParseContext
) -> Variation | None:
    half = values.number(value, node.x, context)
    if half is None:
        return None
    if half < 0:
        problem = Problem("TS711", "a tolerance below zero", node.x.start, node.x.end,
                          "leave out its sign")  # fmt: skip
        context.problems(value, (problem,))
    elif half and is_share(node.x) and dimension == NUMBER:
        context.problems(value, (share_of_a_number(node.x),))
    share = is_share(node.x) and dimension != NUMBER
    return Variation(-half, half, relative=True, share=share)


def _interval(value: object, node: IntervalNode, context: ParseContext) -> Variation | None:
    low = values.number(value, node.low, context)
    high = values.number(value, node.high, context)
    if low is None or high is None:
        return None
    context.problems(
        value, tuple(share_problems(node.low, node.high, lambda name: values.known(name, context)))
    )
    if low > high:
        problem = Problem("TS711", "this interval ends before it begins", node.start, node.end,
                          "write the smaller value first")  # fmt: skip
        context.problems(value, (problem,))
    return Variation(low, high, relative=False)


def _report(value: object, node: Node, message: str, context: ParseContext) -> None:
    hint = "write a..b or '+- x'; 0 does not vary"
    context.problems(value, (Problem("TS710", message, node.start, node.end, hint),))
