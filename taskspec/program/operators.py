"""Operators of expressions that are put together with less work.

CasADi's Python layer tries of each operand whether it is a matrix of numbers, which takes six times
as long as the operation. Where one is an expression and the other an expression or a number, the
operation is known, and the node that it makes is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
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


_QUICK = {
    method: kind(operation, _OWN[method])
    for name, operation in _OPERATIONS.items()
    for method, kind in ((f"__{name}__", _direct), (f"__r{name}__", _reflected))
}


@contextmanager
def quick_operators() -> Iterator[None]:
    """Operators of `ca.SX` take the short way meanwhile."""
    _set(_QUICK)
    try:
        yield
    finally:
        _set(_OWN)


def _set(operators: dict[str, _Operator]) -> None:
    for method, operator in operators.items():
        setattr(ca.SX, method, operator)
