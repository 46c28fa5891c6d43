"""Types and dimensions of an expression, and the names in it: the walk that finds them."""

from __future__ import annotations

from dataclasses import replace

from taskspec.deferred_methods import dataclass
from taskspec.expression import tree
from taskspec.expression.functions import FUNCTIONS, REDUCERS, Function
from taskspec.expression.problem import Problem
from taskspec.expression.scope import Meaning, Scope, ScopeKind, is_axis, resolve
from taskspec.expression.spelling import FUNCTION_WORDS
from taskspec.expression.types import (
    CONDITION,
    PLAIN,
    UNKNOWN,
    ZERO,
    Type,
    cycle_hint,
    ends,
    example_axis,
    in_words,
    is_bare,
)
from taskspec.expression.unknown import explain_name
from taskspec.geometry.axis import TRANSLATIONS
from taskspec.signals import VECTORS, Signal
from taskspec.signals.table import REFERENCE
from taskspec.text.codes import register
from taskspec.text.suggest import suggestion
from taskspec.text.units import (
    ANGLE,
    NUMBER,
    TIME,
    Dimension,
    describe,
    fitting_text,
    noun,
)

register(
    {
        "TS110": "a number without its unit",
        "TS112": "the wrong dimension",
        "TS113": "dimensions that do not go together",
        "TS114": "the wrong kind of value in an expression",
        "TS115": "the wrong number of arguments",
        "TS118": "a number out of its range",
        "TS119": "`for`, a reducer or an interval where it has no meaning",
        "TS121": "an unknown function",
        "TS122": "an unknown frame",
    }
)


class Checker:
    """Walks a tree once; a part that is wrong is reported there and fits everything above."""

    def __init__(self, scope: Scope, place: Dimension | None = None) -> None:
        """Begins without a problem; `place` is the dimension that the whole should have."""
        self.scope, self.place = scope, place
        self.problems: list[Problem] = []
        #: Ids of the intervals `a +- 5 %` whose percentage is a share of a.
        self.relative: set[int] = set()
        self._reducing = False
        #: By the id of a param after `+-`, what it is to be the width about.
        self._shares: dict[int, tree.Node] = {}

    def report(self, code: str, message: str, node: tree.Node, hint: str = "") -> Type:
        """Adds a problem at a node, whose type is unknown from then on."""
        self.problems.append(Problem(code, message, node.start, node.end, hint))
        return UNKNOWN

    def type_of(self, node: tree.Node) -> Type:  # noqa: C901 - one case for each kind of node
        """The type of a node; reports what is wrong in it and below it."""
        match node:
            case tree.Number():
                zero = node.value_si == 0 and not node.unit
                return ZERO if zero else Type("number", node.dimension)
            case tree.Name():
                return self._name(node)
            case tree.Negate(x):
                return self.number(x, self.type_of(x))
            case tree.Binary():
                return self._binary(node)
            case tree.Power(base, exponent):
                kind = self.number(base, self.type_of(base))
                return Type("number", kind.dimension**exponent) if kind.dimension else kind
            case tree.Call():
                return self._call(node)
            case tree.Reduce():
                return self._reduce(node)
            case tree.Compare(_, left, right):
                self.same([left, right])
                return CONDITION
            case tree.WithinNode(x, low, high):
                self._interval(node, [x], low, high)
                return CONDITION
            case tree.Not(x):
                return self.want_condition(x, self.type_of(x))
            case tree.Logic(_, items):
                for item in items:
                    self.want_condition(item, self.type_of(item))
                return CONDITION
            case tree.Held():
                return self._held(node)
            case tree.IntervalNode(low, high):
                return self._interval(node, [], low, high)
            case tree.SpreadNode(x):
                if tree.is_share(x) and self.place not in (None, NUMBER):
                    return Type("number", self.place)
                return self.number(x, self.type_of(x))
            case _:
                raise TypeError(f"{type(node).__name__} is not part of a value")

    def number(self, node: tree.Node, found: Type) -> Type:
        """Reports a condition or a vector where one number is needed."""
        if found.kind == "condition":
            return self.report("TS114", "a number is needed here, this is true or false", node)
        if found.kind == "vector":
            name = str(node)
            one = ".".join(_with_axis(node, example_axis(node)))
            hint = f"write one of them, such as {one}, or norm({name})"
            return self.report("TS114", f"'{name}' has three components", node, hint)
        return found

    def want(self, node: tree.Node, found: Type, expected: Dimension) -> Type:
        """Reports a number that is not of the expected dimension."""
        found = self.number(node, found)
        if found.kind == "unknown" or found.dimension in (None, expected):
            return found
        if is_bare(node):
            return self._missing_unit(node, fitting_text(expected), expected)
        message = f"{describe(expected)} is needed here, this is {in_words(found)}"
        hint = self._unit_hint(node, expected)
        if not hint and expected != NUMBER:
            hint = f"it has to come out in {fitting_text(expected)}"
            if self.scope.kind is ScopeKind.COUPLING:
                ratio = "2 rad/m of a length" if expected == ANGLE else "5 mm/rad of an angle"
                hint += f": a factor of the axis has a unit, as in {ratio}"
        return self.report("TS112", message, node, hint)

    def _unit_hint(self, node: tree.Node, wanted: Dimension | None) -> str:
        """Which unit would have fitted a lone number, or where a param lacks its unit."""
        lone = node.x if isinstance(node, tree.Negate) else node
        if isinstance(lone, tree.Number) and wanted not in (None, NUMBER):
            return f"units that fit: {fitting_text(wanted)}"
        if isinstance(lone, tree.Name):
            param = self.scope.params.get(lone.path[0])
            if param is not None and param.dimension == NUMBER and id(lone) in self._shares:
                return _as_a_share(lone.path[0], self._shares[id(lone)])
            if param is not None and param.dimension == NUMBER:
                return f"'{lone.path[0]}' is defined without a unit"
        return ""

    def want_condition(self, node: tree.Node, found: Type) -> Type:
        """Reports anything that is neither true nor false."""
        if found.kind in ("condition", "unknown"):
            return found
        what = "three numbers" if found.kind == "vector" else in_words(found)
        return self.report(
            "TS114",
            f"a condition is needed here, this is {what}",
            node,
            "compare it: x < a, or x within a..b",
        )

    def same(self, nodes: list[tree.Node]) -> Type:
        """Requires one dimension of all nodes; returns it."""
        kinds = [self.number(node, self.type_of(node)) for node in nodes]
        leader: tuple[tree.Node, Type] | None = None
        for node, kind in zip(nodes, kinds, strict=True):
            if kind.kind == "unknown" or kind.dimension is None:
                continue
            if leader is None or (leader[1].dimension == NUMBER and kind.dimension != NUMBER):
                leader = (node, kind)
        if leader is None:
            return UNKNOWN if any(k.kind == "unknown" for k in kinds) else ZERO
        right = True
        for node, kind in zip(nodes, kinds, strict=True):
            if kind.kind == "unknown" or kind.dimension in (None, leader[1].dimension):
                continue
            right = False
            if is_bare(node) and leader[1].dimension is not None:
                self._missing_unit(node, self._unit_of(leader[0]), leader[1].dimension)
            else:
                message = f"{in_words(kind)} does not go together with {in_words(leader[1])}"
                self.report("TS113", message, node, self._unit_hint(node, leader[1].dimension))
        return leader[1] if right else UNKNOWN

    def _interval(
        self, node: tree.Node, others: list[tree.Node], low: tree.Node, high: tree.Node
    ) -> Type:
        """Requires one dimension of the ends of an interval and of what lies in it.

        In `a +- 5 %` the percentage is a share of a, unless a is a plain number: that has the
        dimension of a percentage, which is added to it as it is.
        """
        parts = ends(low, high)
        around = tree.about(low, high) is not None
        share = around and tree.is_share(parts[1])
        if around and isinstance(parts[1], tree.Name):
            self._shares[id(parts[1])] = parts[0]
        kind = self.same([*others, *(parts[:1] if share else parts)])
        whole = kind.dimension if others else kind.dimension or self.place
        if share and kind.kind == "number" and whole not in (None, NUMBER):
            self.relative.add(id(node))
        return kind

    def _unit_of(self, node: tree.Node) -> str:
        """The units that fit what a node comes out in: of an energy those of energies."""
        found = [
            resolve(name.path, self.scope)
            for name in tree.walk(node)
            if isinstance(name, tree.Name)
        ]
        units = {f.signal.unit for f in found if f is not None and f.signal is not None}
        (unit,) = units if len(units) == 1 else ("",)
        dimension = self.type_of(node).dimension
        return unit or ("" if dimension is None else fitting_text(dimension))

    def _missing_unit(self, node: tree.Node, units: str, wanted: Dimension) -> Type:
        if wanted == NUMBER:
            return UNKNOWN
        what = "an energy" if units == "J" else noun(wanted)
        message = f"a number without a unit, where {what} is needed"
        return self.report("TS110", message, node, f"add a unit: {units}")

    def _binary(self, node: tree.Binary) -> Type:
        if node.op in "+-":
            return self.same([node.left, node.right])
        left = self.number(node.left, self.type_of(node.left))
        right = self.number(node.right, self.type_of(node.right))
        if "unknown" in (left.kind, right.kind):
            return UNKNOWN
        if left.dimension is None:
            return ZERO
        second = right.dimension or NUMBER
        product = left.dimension * second if node.op == "*" else left.dimension / second
        return ZERO if node.op == "*" and right.dimension is None else Type("number", product)

    def _name(self, node: tree.Name) -> Type:
        if node.path[0] in self.scope.broken:
            return UNKNOWN
        meaning = resolve(node.path, self.scope)
        if meaning is None:
            self.problems.append(explain_name(node, self.scope))
            return UNKNOWN
        if meaning.kind == "energy" and self.scope.kind is ScopeKind.REWARD:
            message = f"'{node}' is worked out of a whole log, which a reward does not have"
            return self.report("TS116", message, node, "judge it in 'expect'")
        if node.frame is not None:
            self._frame(node, meaning)
        if meaning.kind == "condition":
            return CONDITION
        if meaning.kind == "vector":
            return Type("vector", meaning.dimension)
        if meaning.kind == "param" and self.scope.params[node.path[0]].bare:
            return ZERO
        return Type("number", meaning.dimension)

    def _frame(self, node: tree.Name, meaning: Meaning) -> None:
        assert node.frame is not None
        start, signal = node.end - len(node.frame), meaning.signal
        if meaning.beside or self.scope.kind is ScopeKind.REWARD:
            what = "a reference" if meaning.beside else "what a reward counts"
            message = f"{what} is in the frame of its stage"
            self.problems.append(Problem("TS116", message, start, node.end, "leave out 'in'"))
        elif signal is None or not signal.framed:
            message = f"'{'.'.join(node.path)}' is the same in every frame"
            self.problems.append(Problem("TS116", message, start, node.end, "leave out 'in'"))
        elif node.frame not in self.scope.frames:
            hint = suggestion(node.frame, self.scope.frames, "frames")
            self.problems.append(
                Problem("TS122", f"unknown frame '{node.frame}'", start, node.end, hint)
            )

    def _call(self, node: tree.Call) -> Type:
        rule = FUNCTIONS.get(node.function)
        end = node.start + len(node.function)
        if rule is None:
            for arg in node.args:
                self.type_of(arg)
            hint = suggestion(node.function, [*FUNCTIONS, *REDUCERS], "functions")
            if node.function in REDUCERS:
                message, code = f"'{node.function}' takes one argument", "TS115"
                hint = ""
            else:
                message, code = f"unknown function '{node.function}'", "TS121"
                if (word := FUNCTION_WORDS.get(node.function.lower())) is not None:
                    hint = f"did you mean '{word}'?"
                before, _, last = node.function.rpartition(".")
                if before and last in (*FUNCTIONS, *REDUCERS):
                    hint = f"the function comes first: {last}({before}.…)"
            self.problems.append(Problem(code, message, node.start, end, hint))
            return UNKNOWN
        if not rule.fewest <= len(node.args) <= (rule.most or len(node.args)):
            for arg in node.args if rule.rule != "two axes" else ():
                self.type_of(arg)
            wanted = str(rule.fewest) if rule.most else f"at least {rule.fewest}"
            message = f"'{node.function}' takes {wanted} argument{'s' * (wanted != '1')}"
            return self.report("TS115", f"{message}, not {len(node.args)}", node)
        return self._apply(node, rule)

    def _apply(self, node: tree.Call, rule: Function) -> Type:
        args = list(node.args)
        if node.function == "norm" and len(args) == 1:
            kind = self.type_of(args[0])
            return Type("number", kind.dimension) if kind.kind == "vector" else self.number(
                args[0], kind)  # fmt: skip
        if rule.rule in ("same", "two to angle"):
            kind = self.same(args)
            return kind if rule.rule == "same" else Type("number", ANGLE)
        if rule.rule == "two axes":
            return self._between(node)
        kind = self.number(args[0], self.type_of(args[0]))
        if rule.rule == "root":
            return Type("number", kind.dimension**0.5) if kind.dimension else kind
        if rule.rule == "angle to number" and kind.dimension in (ANGLE, NUMBER, None):
            return PLAIN
        if rule.rule == "angle to number":
            message = f"an angle or a plain number is needed here, this is {in_words(kind)}"
            self.report("TS112", message, args[0], cycle_hint(kind))
        elif rule.rule != "to number":
            self.want(args[0], kind, NUMBER)
        return Type("number", ANGLE) if rule.rule == "number to angle" else PLAIN

    def _between(self, node: tree.Call) -> Type:
        """The angle between two axes of frames, each with a sign."""
        if self.scope.kind is not ScopeKind.EQUATION:
            message = f"'{node.function}' has a meaning in equations only"
            return self.report("TS119", message, node, "the tool's lean is the signal 'tilt'")
        for arg in node.args:
            axis = arg.x if isinstance(arg, tree.Negate) else arg
            if isinstance(axis, tree.Name) and is_axis(axis.path, self.scope):
                continue
            if isinstance(axis, tree.Name) and len(axis.path) == 2 and axis.path[1] in TRANSLATIONS:
                hint = suggestion(axis.path[0], self.scope.frames, "frames")
                end = axis.start + len(axis.path[0])
                message = f"unknown frame '{axis.path[0]}'"
                self.problems.append(Problem("TS122", message, axis.start, end, hint))
            else:
                hint = "such as angle(tool.z, world.z)"
                self.report("TS114", "an axis of a frame is needed here", arg, hint)
        return Type("number", ANGLE)

    def _reduce(self, node: tree.Reduce) -> Type:
        if self.scope.kind not in (ScopeKind.GUARD, ScopeKind.EXPECT):
            self.type_of(node.arg)
            if node.reducer in FUNCTIONS:
                message = f"'{node.reducer}' needs at least 2 arguments here"
                return self.report("TS115", message, node)
            message = f"'{node.reducer}' looks back over time, which only conditions can"
            return self.report("TS119", message, node, "use it in until, fail_if or expect")
        if self._reducing:
            return self.report("TS119", "a reducer inside a reducer", node)
        self._reducing = True
        kind = self.number(node.arg, self.type_of(node.arg))
        self._reducing = False
        return kind

    def _held(self, node: tree.Held) -> Type:
        self.want_condition(node.x, self.type_of(node.x))
        amount = node.amount
        if self.scope.kind is ScopeKind.GUARD:
            self.want(amount, self.type_of(amount), TIME)
        elif self.scope.kind is not ScopeKind.EXPECT:
            self.report("TS119", "'for' has a meaning in guards and expectations only", node)
        elif amount.unit != "%":
            message = "in an expectation 'for' takes a share of all ticks"
            self.report("TS119", message, amount, "write a percentage: for 95 %")
        elif amount.value_si > 1:
            self.report("TS118", "a share is at most 100 %", amount, "write a percentage: for 95 %")
        elif amount.value_si == 0:
            hint = "write the least share of ticks that will do: for 95 %"
            self.report("TS118", "a share of no ticks expects nothing", amount, hint)
        return CONDITION


def _as_a_share(param: str, value: tree.Node) -> str:
    """How a param is a share of a value."""
    middle = value.x if isinstance(value, tree.Negate) else value
    name = str(middle) if isinstance(middle, tree.Name) else "its size"
    return f"a param that is a share is multiplied: +- {param} * {name}"


@dataclass(frozen=True, slots=True)
class Checked:
    """The outcome of a check: the tree with vectors written out, its dimension, the problems."""

    tree: tree.Node
    dimension: Dimension
    problems: tuple[Problem, ...]


def check(node: tree.Node, scope: Scope, expected: Dimension | None) -> Checked:
    """Checks names, types and dimensions, all of them.

    Args:
        node: a parsed expression.
        scope: the names it may use.
        expected: the dimension that its place requires; None if the place requires a condition.

    Returns:
        The tree in which `norm(force)` is written out as `norm(force.x, force.y, force.z)` and
        `12 N +- 5 %` as `12 N +- 5 % * abs(12 N)`, and every problem found.
        The dimension is the expected one, plain for conditions.
    """
    checker = Checker(scope, expected)
    found = checker.type_of(node)
    if expected is None:
        checker.want_condition(node, found)
    else:
        checker.want(node, found, expected)
    problems = tuple(checker.problems)
    written = node if problems else _written_out(node, checker.relative)
    return Checked(written, expected or NUMBER, problems)


def infer(node: tree.Node, scope: Scope) -> tuple[Type, tuple[Problem, ...]]:
    """The type of an expression whose place requires none, and every problem found."""
    checker = Checker(scope)
    found = checker.type_of(node)
    if found.kind == "vector":
        checker.number(node, found)
    return found, tuple(checker.problems)


def _written_out(node: tree.Node, relative: set[int]) -> tree.Node:
    """Replaces the argument of norm(vector) by the vector's components, and shares by products."""

    def full(x: tree.Node) -> tree.Node:
        return _written_out(x, relative)

    match node:
        case tree.Call("norm", (tree.Name() as name,)) if (vector := _vector(name)) is not None:
            return replace(
                node, args=tuple(replace(name, path=_with_axis(name, a)) for a in vector.bare)
            )
        case tree.Negate(x) | tree.Not(x) | tree.Held(x, _):
            return replace(node, x=full(x))
        case tree.Binary(_, left, right) | tree.Compare(_, left, right):
            return replace(node, left=full(left), right=full(right))
        case tree.Power(base, _):
            return replace(node, base=full(base))
        case tree.Call(_, args):
            return replace(node, args=tuple(map(full, args)))
        case tree.Reduce(_, arg):
            return replace(node, arg=full(arg))
        case tree.WithinNode(x, low, high):
            low, high = _width_in_full(low, high) if id(node) in relative else (low, high)
            return replace(node, x=full(x), low=full(low), high=full(high))
        case tree.IntervalNode(low, high):
            low, high = _width_in_full(low, high) if id(node) in relative else (low, high)
            return replace(node, low=full(low), high=full(high))
        case tree.Logic(_, items):
            return replace(node, items=tuple(map(full, items)))
        case _:
            return node


def _vector(name: tree.Name) -> Signal | None:
    """The family of axes that a name means as a whole, or whose references."""
    return VECTORS.get(_split(name)[0][-1])


def _with_axis(node: tree.Node, axis: str) -> tuple[str, ...]:
    """A component of a vector, or of its reference."""
    assert isinstance(node, tree.Name)
    path, beside = _split(node)
    return (*path, axis, *beside)


def _split(name: tree.Name) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The path of a vector, and what beside it is meant."""
    size = len(name.path) - (name.path[-1] == REFERENCE)
    return name.path[:size], name.path[size:]


def _width_in_full(low: tree.Node, high: tree.Node) -> tuple[tree.Node, tree.Node]:
    """The ends of `a +- 5 %` as those of `a +- 5 % * abs(a)`."""
    parts = tree.about(low, high)
    assert parts is not None
    assert isinstance(low, tree.Binary)
    assert isinstance(high, tree.Binary)
    middle, half = parts
    place = {"start": half.start, "end": half.end}
    width = tree.Binary("*", half, tree.Call("abs", (middle,), **place), **place)
    return replace(low, right=width), replace(high, right=width)
