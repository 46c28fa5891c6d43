"""Expressions of a task file as URScript."""

from __future__ import annotations

from collections.abc import Callable

from taskspec.expression.tree import (
    Binary,
    Call,
    Compare,
    Held,
    Logic,
    Name,
    Negate,
    Node,
    Not,
    Number,
    Power,
    Reduce,
    WithinNode,
)
from taskspec_runner.urscript.script import number

#: How strongly operators bind; what binds less than what is around it stands in brackets.
_OR, _AND, _NOT, _COMPARED, _SUM, _PRODUCT, _SIGN, _ATOM = range(8)
_LEVELS = {"+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "or": _OR, "and": _AND}
#: Functions of the language by their names in URScript or its library.
_FUNCTIONS = {
    **{name: name for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt")},
    **{"abs": "norm", "sign": "sign_of", "clamp": "clamp", "smooth": "smooth"},
}
_OF_TWO = {"min": "smaller", "max": "larger"}
_EULER = 2.718281828459045


class UntranslatableError(Exception):
    """A part of an expression has no counterpart in URScript.

    Attributes:
        node: the part.
        reason: why, as a clause.
    """

    def __init__(self, node: Node, reason: str) -> None:
        super().__init__(reason)
        self.node, self.reason = node, reason


#: Writes a name of a file, or what is remembered of an expression over time.
Lookup = Callable[[Name], str]
Remember = Callable[[Held | Reduce], str]


def translated(node: Node, lookup: Lookup, remember: Remember | None = None) -> str:
    """An expression in URScript.

    Args:
        node: its tree.
        lookup: writes params and signals.
        remember: writes what depends on the past; None where nothing may.

    Raises:
        UntranslatableError: a part has no counterpart.
    """
    return _Writer(lookup, remember).text(node, _OR)


class _Writer:
    def __init__(self, lookup: Lookup, remember: Remember | None) -> None:
        self._lookup, self._remember = lookup, remember

    def text(self, node: Node, least: int) -> str:
        """A node, in brackets where it binds less than `least`."""
        found, level = self._written(node)
        return f"({found})" if level < least else found

    def _written(self, node: Node) -> tuple[str, int]:
        match node:
            case Number(value):
                return number(value), _ATOM if value >= 0 else _SIGN
            case Name():
                return self._lookup(node), _ATOM
            case Negate(x):
                return f"-{self.text(x, _ATOM)}", _SIGN
            case Binary(op, left, right):
                level = _LEVELS[op]
                return f"{self.text(left, level)} {op} {self.text(right, level + 1)}", level
            case Power(base, exponent):
                return f"pow({self.text(base, _OR)}, {number(exponent)})", _ATOM
            case Call(function, args):
                return self._called(node, function, [self.text(each, _OR) for each in args])
            case Compare(op, left, right):
                return f"{self.text(left, _SUM)} {op} {self.text(right, _SUM)}", _COMPARED
            case Not(x):
                return f"not {self.text(x, _ATOM)}", _NOT
            case Logic(op, items):
                level = _LEVELS[op]
                return f" {op} ".join(self.text(item, level + 1) for item in items), level
            case WithinNode(x, low, high):
                both = (Compare(">=", x, low), Compare("<=", x, high))
                return self._written(Logic("and", both))
            case _:
                return self._kept(node)

    def _kept(self, node: Node) -> tuple[str, int]:
        if not isinstance(node, Held | Reduce):
            raise UntranslatableError(node, "URScript has nothing like it")
        if self._remember is None:
            raise UntranslatableError(node, "a reference that depends on the past")
        return self._remember(node), _COMPARED if isinstance(node, Held) else _ATOM

    def _called(self, node: Node, function: str, args: list[str]) -> tuple[str, int]:
        if function in _OF_TWO:
            text = args[0]
            for each in args[1:]:
                text = f"{_OF_TWO[function]}({text}, {each})"
            return text, _ATOM
        if function == "norm":
            return f"sqrt({' + '.join(f'pow({each}, 2.0)' for each in args)})", _ATOM
        if function == "exp":
            return f"pow({number(_EULER)}, {args[0]})", _ATOM
        if function == "log":
            return f"log({number(_EULER)}, {args[0]})", _ATOM
        if function not in _FUNCTIONS:
            raise UntranslatableError(node, f"URScript has no '{function}'")
        return f"{_FUNCTIONS[function]}({', '.join(args)})", _ATOM
