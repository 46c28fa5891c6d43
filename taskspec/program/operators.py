"""Operators of expressions that are put together with less work.

CasADi's Python layer tries of each operand whether it is a matrix of numbers, which takes six times
as long as the operation. Where one is an expression and the other an expression or a number, the
operation is known, and the node that it makes is the same, for threads that do not use it too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import casadi as ca

_Operator = Callable[[Any, Any], Any]

_OPERATIONS = {"add": ca.OP_ADD, "sub": ca.OP_SUB, "mul": ca.OP_MUL, "truediv": ca.OP_DIV}
#: CasADi's own, by the name of the method.
_OWN: dict[str, _Operator] = {
    method: getattr(ca.SX, method)
    for name in _OPERATIONS
    for method in (f"__{name}__", f"__r{name}__")
}


def _direct(operation: int, own: _Operator) -> _Operator:
    """x o y, x the expression."""
    binary = ca.SX.binary

    def operate(x: ca.SX, y: Any) -> Any:
        if type(y) is ca.SX:
            return binary(operation, x, y)
        if isinstance(y, float | int):
            return binary(operation, x, ca.SX(y))
        return own(x, y)

    return operate


def _reflected(operation: int, own: _Operator) -> _Operator:
    """y o x, x the expression, where y knows nothing of expressions."""
    binary = ca.SX.binary

    def operate(x: ca.SX, y: Any) -> Any:
        if isinstance(y, float | int):
            return binary(operation, ca.SX(y), x)
        return own(x, y)

    return operate


def choice(condition: ca.SX, yes: ca.SX, no: ca.SX) -> ca.SX:
    """`ca.if_else(condition, yes, no)` of three expressions: the same nodes."""
    unary, binary = ca.SX.unary, ca.SX.binary
    chosen = binary(ca.OP_IF_ELSE_ZERO, condition, yes)
    other = binary(ca.OP_IF_ELSE_ZERO, unary(ca.OP_NOT, condition), no)
    return binary(ca.OP_ADD, chosen, other)


_QUICK = {
    method: kind(operation, _OWN[method])
    for name, operation in _OPERATIONS.items()
    for method, kind in ((f"__{name}__", _direct), (f"__r{name}__", _reflected))
}


_lock = Lock()
#: How many are in `quick_operators` now: one may compile in another, and threads at once.
_within = 0


@contextmanager
def quick_operators() -> Iterator[None]:
    """Operators of `ca.SX` take the short cut until the last that uses it is done."""
    _count(1)
    try:
        yield
    finally:
        _count(-1)


def _count(change: int) -> None:
    global _within
    with _lock:
        before, _within = _within, _within + change
        if not before or not _within:
            for method, operator in (_QUICK if _within else _OWN).items():
                setattr(ca.SX, method, operator)
