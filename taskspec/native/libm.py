"""The functions of the platform's libm, by address: those that CasADi and CPython call.

Code calls them by names of their own, `libm.sin`. LLVM knows what `sin` and `pow` are, and would
put other instructions in their place, with other bits.
"""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from typing import Any

UNARY = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh",
    "atanh", "exp", "expm1", "log", "log1p", "erf",
)  # fmt: skip
BINARY = ("pow", "atan2", "fmod", "remainder", "hypot")

NAMED = (*UNARY, *BINARY)

_PREFIX = "libm."
# LLVM calls these by itself: where the processor has no instruction, and for loops that copy.
IMPLIED = ("floor", "ceil", "trunc", "memcpy", "memmove", "memset")
NAMES = frozenset((*(_PREFIX + name for name in NAMED), *IMPLIED))


def declaration(name: str) -> str:
    """The line of LLVM IR that a text needs to call a function of libm, such as `sin`."""
    arguments = "double" if name in UNARY else "double, double"
    return f'declare double @"{_PREFIX}{name}"({arguments}) memory(none) nounwind willreturn'


def symbol(name: str) -> str:
    """What LLVM IR calls a function of libm."""
    return f'@"{_PREFIX}{name}"'


@cache
def address(name: str) -> int:
    """The address of a function by the name that code has for it, `libm.sin`.

    Raises:
        KeyError: code has no such name.
    """
    if name not in NAMES:
        raise KeyError(name)
    function = getattr(_library(), name.removeprefix(_PREFIX))
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


@cache
def _library() -> Any:
    # Elsewhere the interpreter itself is linked with the platform's libm.
    return ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None)
