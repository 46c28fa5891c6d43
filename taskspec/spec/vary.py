"""`vary`: what is uncertain about the real world."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import FloatAlgebra, Problem, Scope, ScopeKind, check, evaluate, infer
from taskspec.expression.intervals import share_of_a_number, share_problems
from taskspec.expression.spelling import other_word
from taskspec.expression.tree import Call, IntervalNode, Name, Node, SpreadNode, is_share, walk
from taskspec.shapes import SHAPES, size_keys
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import EXACT
from taskspec.spec.model import mapping
from taskspec.spec.names import why_not
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.value_path import ValuePath
from taskspec.spec.varied import OBJECT, ROBOT, VariedValue
from taskspec.spec.world import is_free
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Text
from taskspec.text.suggest import closest, suggestion
from taskspec.text.units import (
    ANGLE,
    FORCE,
    LENGTH,
    NUMBER,
    Dimension,
    Quantity,
    describe,
)

register({"TS710": "a variation of something that cannot vary"})

_SUCH_AS = {
    LENGTH: "such as [+- 2 mm, 0, 0]",
    ANGLE: "such as [+- 3 deg, 0, 0]",
    FORCE: "such as [+- 1 N, 0, 0, 0, 0, 0]",
}

#: Standard deviations to either side at which a normal distribution is cut.
CUT = 3.0
_NORMAL = "normal"
_FLOATS = FloatAlgebra()
#: A component that is a formula uses no more names than this: all their ends are tried.
_MOST_NAMES = 8


@dataclass(frozen=True, slots=True)
class Draw:
    """A random number, drawn once a world.

    Attributes:
        name: by which it is drawn: one of the file, or path and number of a component.
        low, high: its ends [SI]; of a normal distribution 3 standard deviations from 0.
        normal: it is distributed normally about 0, cut at its ends; else uniformly.
    """

    name: str
    low: float
    high: float
    normal: bool = False


@dataclass(frozen=True)
class Variation:
    """An uncertain component.

    Attributes:
        low, high: its ends [SI], or how far they are from the nominal value.
        relative: to the nominal value.
        share: `low` and `high` are shares of the nominal value, such as 0.05 for 5 %.
        draws: the random numbers that it follows from.
        formula: it as a function of them; None for the one draw itself.
        fixed: params and constants that the formula uses [SI].
    """

    low: float
    high: float
    relative: bool
    share: bool = False
    draws: tuple[Draw, ...] = ()
    formula: Node | None = None
    fixed: tuple[tuple[str, float], ...] = ()

    def ends(self, nominal: float) -> tuple[float, float]:
        """Least and greatest value [SI] where the true world has the `nominal` one."""
        return self._of(self.low, nominal), self._of(self.high, nominal)

    def value(self, nominal: float, drawn: Mapping[str, float]) -> float:
        """The value [SI] for what has been drawn, by name."""
        if self.formula is None:
            return self._of(drawn[self.draws[0].name], nominal)
        known = {**dict(self.fixed), **drawn}
        return self._of(evaluate(self.formula, _FLOATS, lambda n: known[str(n)]), nominal)

    def drawn(self, value: float, nominal: float) -> float:
        """What its one draw is for a value [SI]: the inverse of `value` where it has no formula."""
        base = nominal if self.relative else 0.0
        return (value - base) / (abs(nominal) if self.share and nominal else 1.0)

    def _of(self, deviation: float, nominal: float) -> float:
        base = nominal if self.relative else 0.0
        return base + (abs(nominal) if self.share else 1.0) * deviation


@dataclass(frozen=True)
class _Named:
    """A random number that the file gives a name."""

    draw: Draw
    relative: bool
    dimension: Dimension


@dataclass(frozen=True)
class _Names:
    """The random numbers that entries may use, and the scope of what uses them."""

    known: Mapping[str, _Named]
    broken: frozenset[str]
    context: ParseContext

    @cached_property
    def scope(self) -> Scope:
        """Params and constants, and the names of random numbers."""
        own = {name: Quantity(0.0, each.dimension) for name, each in self.known.items()}
        plain = self.context.scope(ScopeKind.CONSTANT)
        params = MappingProxyType({**plain.params, **own})
        return replace(plain, params=params, broken=plain.broken | self.broken)

    def used(self, node: Node) -> dict[str, _Named]:
        """The names that a tree uses."""
        names = (str(each) for each in walk(node) if isinstance(each, Name))
        return {name: self.known[name] for name in names if name in self.known}


@dataclass(frozen=True)
class Variations(FieldType):
    """Paths of values, each with an interval for every component; names of random numbers."""

    def read(self, value: object, context: ParseContext) -> dict[str, tuple[Variation | None, ...]]:
        """The variations by path; a component that does not vary is None."""
        if not isinstance(value, Map):
            message = f"'vary' is a mapping of paths to intervals, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "world.table.stiffness: 5..80 kN/m")
            return {}
        names = _names(value, context)
        found = {}
        for path, entry in value.items():
            if path in names.known or path in names.broken:
                continue
            target = target_of(path, value, context, "vary")
            if target is not None:
                found[path] = _components(path, entry, target.dimensions, names)
        return found

    def json(self) -> dict[str, Any]:
        """Describes the mapping."""
        one = {
            "type": ["string", "number"],
            "description": "'a..b', '+- x', 'normal(x)', a name that 'vary' has, or 0",
        }
        entry = {"anyOf": [one, {"type": "array", "items": one}]}
        return {"type": "object", "additionalProperties": entry}


def _names(data: Map, context: ParseContext) -> _Names:
    """The random numbers that have a name: keys without a dot that another entry uses."""
    found: dict[str, _Named] = {}
    names = _Names(found, frozenset(), context)
    broken = set()
    keys = [key for key in data if "." not in key and key not in ("world", "robot")]
    for key in keys:
        if not any(key in _words(entry) for other, entry in data.items() if other != key):
            continue
        span = data.node.key_span(key)
        reason = why_not(key, "params")
        if key in context.params or key in context.broken:
            reason = f"a param has this name: {key}"
        before = len(context.diagnostics)
        if reason is not None:
            message = f"{key!r} cannot be the name of a random number"
            context.error("TS125", message, span, reason)
            broken.add(key)
            continue
        if (named := _named(key, data[key], names)) is None:
            broken.add(key)
            if len(context.diagnostics) == before:
                message = f"{key!r} is a random number, and this does not vary"
                hint = "write a..b, '+- x' or normal(x)"
                context.error("TS710", message, span_of(data[key]), hint)
        else:
            found[key] = named
    return _Names(found, frozenset(broken), context)


def _words(entry: object) -> set[str]:
    texts = entry if isinstance(entry, Items) else [entry]
    words: set[str] = set()
    for text in texts:
        if isinstance(text, Text):
            words.update("".join(c if c.isalnum() or c == "_" else " " for c in text).split())
    return words


def _named(key: str, value: object, names: _Names) -> _Named | None:
    context = names.context
    if isinstance(value, Items | Map):
        message = f"one interval is needed here, this is {kind_of(value)}"
        context.error("TS023", message, span_of(value))
        return None
    node = values.parsed(value, "uncertain", context, "an interval")
    if node is None:
        return None
    inner = _normal(node) or node
    kind, problems = infer(inner.x if isinstance(inner, SpreadNode) else inner, names.scope)
    if problems:
        context.problems(value, problems)
        return None
    found = _variation(key, value, kind.dimension or NUMBER, names)
    if found is None:
        return None
    if found.share:
        message, hint = "a share of what? A name stands for a number", "write the width itself"
        context.problems(value, (Problem("TS106", message, node.start, node.end, hint),))
        return None
    return _Named(found.draws[0], found.relative, kind.dimension or NUMBER)


def target_of(path: str, data: Map, context: ParseContext, section: str) -> VariedValue | None:
    """What a path under `vary` or `truth` names, or None after reporting that nothing there can.

    Args:
        path: such as `world.table.stiffness`.
        data: the section, which has the path as a key.
        context: the pass.
        section: its name.
    """
    of = ValuePath.of(path)
    span = data.node.key_span(path)
    can = "can vary" if section == "vary" else "can be otherwise in truth"
    if of.section == "robot":
        if of.first == "servo" and mapping(context.data.get("robot")).get("command") in (
            None,
            "torque",
        ):
            message = "joints that are commanded torques have no servo"
            context.error("TS026", message, span, "say: robot: {command: velocity}, or position")
            return None
        if of.key in ROBOT:
            return ROBOT[of.key]
        near = closest(of.key, ROBOT)
        hint = suggestion("", ROBOT, f"values of the robot that {can}")
        hint = hint if near is None else f"did you mean 'robot.{near}'?"
        context.error("TS710", f"'{path}' is no value that {can}", span, hint)
        return None
    if of.owner in context.objects:
        raw = mapping(mapping(context.data.get("world")).get(of.owner))
        fields = _fields(raw, context.objects[of.owner])
        if fields is None or of.key in fields:
            return OBJECT[context.objects[of.owner]].get(of.key)
        hint = other_word(of.key, fields) or suggestion(
            of.key, fields, f"values of '{of.owner}' that {can}"
        )
        if context.objects[of.owner].startswith(EXACT):
            hint = "what is exact has no spring; give the equation a stiffness in newtons per metre"
        context.error("TS710", f"'{of.key}' of '{of.owner}' is no value that {can}", span, hint)
        return None
    if of.owner:
        hint = suggestion(of.owner, context.objects, "objects")
        context.error("TS123", f"unknown object '{of.owner}'", span, hint)
        return None
    if section == "vary" and "faults" in path.split("."):
        message, hint = "faults cannot vary", "they are the same in every world of a sweep"
        context.error("TS710", message, span, hint)
        return None
    options = [f"world.{name}.stiffness" for name in context.objects]
    options += [f"robot.{name}" for name in ROBOT]
    hint = suggestion(path, options, f"values that {can}")
    alone = section == "vary" and "." not in path
    also = ", and no other entry uses it as a name" if alone else ""
    context.error("TS710", f"'{path}' is no value that {can}{also}", span, hint)
    return None


def _fields(data: Map, kind: str) -> list[str] | None:
    """The values of a raw object that can vary; None if its shape is not known."""
    if kind != "shape":
        absent = {name for name in OBJECT[kind] if "." in name and name.split(".")[0] not in data}
        return [name for name in OBJECT[kind] if name not in absent]
    name = data.get("shape")
    if not isinstance(name, str) or name not in SHAPES:
        return None
    missing = size_keys().keys() - {key.name for key in SHAPES[name].keys}
    missing |= set() if is_free(data) else {"mass"}
    return [key for key in OBJECT[kind] if key not in missing]


def _components(
    path: str, value: object, dimensions: tuple[Dimension, ...], names: _Names
) -> tuple[Variation | None, ...]:
    count, context = len(dimensions), names.context
    if count == 1:
        if isinstance(value, Items):
            message = "one interval is needed here, this is a list"
            context.error("TS023", message, span_of(value))
            return ()
        return (_variation(path, value, dimensions[0], names),)
    if not isinstance(value, Items) or len(value) != count:
        if not (isinstance(value, Items) and value.node.broken):
            hint = _SUCH_AS.get(dimensions[0], "")
            message = f"{count} components are needed here, 0 for one that does not vary"
            context.error("TS023", message, span_of(value), hint)
        return ()
    return tuple(
        _variation(f"{path}.{number}", entry, dimension, names)
        for number, (entry, dimension) in enumerate(zip(value, dimensions, strict=True))
    )


def _variation(name: str, value: object, dimension: Dimension, names: _Names) -> Variation | None:
    """One component; `name` is that of its random number where it has one of its own."""
    context = names.context
    node = values.parsed(value, "uncertain", context, "an interval")
    if node is None:
        return None
    if (width := _normal(node)) is not None:
        spread = SpreadNode(width, start=node.start, end=node.end)
        checked = _checked(value, spread, dimension, names)
        return None if checked is None else _spread(name, value, checked, dimension, context, CUT)
    checked = _checked(value, node, dimension, names)
    if checked is None:
        return None
    used = names.used(checked)
    if isinstance(checked, SpreadNode | IntervalNode) and used:
        message = f"the ends of an interval are fixed, and {next(iter(used))!r} varies"
        hint = "a component is an interval, or a sum of names"
        context.problems(value, (Problem("TS710", message, node.start, node.end, hint),))
        return None
    if isinstance(checked, SpreadNode):
        return _spread(name, value, checked, dimension, context)
    if isinstance(checked, IntervalNode):
        return _interval(name, value, checked, context)
    if used:
        return _formula(value, checked, used, context)
    if names.broken & _names_in(checked):
        return None
    nominal = values.number(value, checked, context)
    if nominal != 0 and nominal is not None:
        message = f"{describe(dimension)} that varies is an interval"
        hint = "write a..b, '+- x' or normal(x); 0 does not vary"
        context.problems(value, (Problem("TS710", message, node.start, node.end, hint),))
    return None


def _normal(node: Node) -> Node | None:
    """The standard deviation of `normal(x)`; None of anything else."""
    if isinstance(node, Call) and node.function == _NORMAL and len(node.args) == 1:
        return node.args[0]
    return None


def _checked(value: object, node: Node, dimension: Dimension, names: _Names) -> Node | None:
    checked = check(node, names.scope, dimension)
    problems = checked.problems
    if problems and isinstance(node, IntervalNode) and is_share(node.high):
        width = f"+- {100 * evaluate(node.high, FloatAlgebra(), lambda _: math.nan):g} %"
        hint = f"a share of the value in the file is written {width}"
        problems = tuple(replace(each, hint=hint) for each in problems)
    if isinstance(node, Call) and closest(node.function, [_NORMAL]):
        hint = f"did you mean '{_NORMAL}'?"
        problems = tuple(replace(p, hint=hint) if p.code == "TS121" else p for p in problems)
    names.context.problems(value, problems)
    return None if problems else checked.tree


def _spread(
    name: str,
    value: object,
    node: Node,
    dimension: Dimension,
    context: ParseContext,
    deviations: float = 0.0,
) -> Variation | None:
    """`+- x`, or with a number of standard deviations `normal(x)`."""
    assert isinstance(node, SpreadNode)
    half = values.number(value, node.x, context)
    if half is None:
        return None
    if half < 0:
        what = "standard deviation" if deviations else "tolerance"
        problem = Problem("TS711", f"a {what} below zero", node.x.start, node.x.end,
                          "leave out its sign")  # fmt: skip
        context.problems(value, (problem,))
    elif half and is_share(node.x) and dimension == NUMBER:
        context.problems(value, (share_of_a_number(node.x),))
    share = is_share(node.x) and dimension != NUMBER
    half *= deviations or 1.0
    draw = Draw(name, -half, half, normal=bool(deviations))
    return Variation(-half, half, relative=True, share=share, draws=(draw,))


def _interval(
    name: str, value: object, node: IntervalNode, context: ParseContext
) -> Variation | None:
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
    return Variation(low, high, relative=False, draws=(Draw(name, low, high),))


def _formula(
    value: object, node: Node, used: Mapping[str, _Named], context: ParseContext
) -> Variation | None:
    """A component that follows from random numbers with a name."""
    kinds = {each.relative for each in used.values()}
    if len(kinds) > 1 or len(used) > _MOST_NAMES:
        message = "names of deviations and of values do not go together"
        hint = "declare all of them by '+- x' or normal(x), or all of them by a..b"
        if len(used) > _MOST_NAMES:
            message, hint = f"more than {_MOST_NAMES} names in one component", "use fewer"
        context.problems(value, (Problem("TS710", message, node.start, node.end, hint),))
        return None
    constants = {name: values.known(Name((name,)), context) for name in _names_in(node) - {*used}}
    found = []
    for chosen in itertools.product(*((each.draw.low, each.draw.high) for each in used.values())):
        at = constants | dict(zip(used, chosen, strict=True))
        found.append(evaluate(node, _FLOATS, lambda n, at=at: at[str(n)]))  # type: ignore[misc]
    if not all(map(math.isfinite, found)):
        message = "this has no finite value at the ends of what varies"
        context.problems(value, (Problem("TS117", message, node.start, node.end),))
        return None
    draws = tuple(each.draw for each in used.values())
    return Variation(
        min(found),
        max(found),
        kinds.pop(),
        draws=draws,
        formula=node,
        fixed=tuple(constants.items()),
    )


def _names_in(node: Node) -> set[str]:
    return {str(each) for each in walk(node) if isinstance(each, Name)}
