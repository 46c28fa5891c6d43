"""CasADi's SX functions as C99, to the bits of their machine code.

The operations are those of `expressions`: only how a line is written is another.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from taskspec.native import libm
from taskspec.native.expressions import (
    OPERATIONS,
    Lines,
    UnsupportedOperationError,
    has_bits_of_casadi,
    operands_of,
)
from taskspec.native.instructions import instructions
from taskspec.native.kernel_c import number

#: What functions call; one that is not used costs nothing.
PRELUDE = """\
static inline double ts_signs(double x, double y, bool either)
{
    uint64_t a, b;
    memcpy(&a, &x, sizeof a);
    memcpy(&b, &y, sizeof b);
    a = either ? (a | b) : (a & b);
    memcpy(&x, &a, sizeof x);
    return x;
}
"""
_TWO = {"fadd": "+", "fsub": "-", "fmul": "*", "fdiv": "/"}
_CONDITIONS = {
    "olt": "<",
    "ole": "<=",
    "ogt": ">",
    "oge": ">=",
    "oeq": "==",
    "une": "!=",
}
_OWN = {f"llvm.{name}.f64": name for name in ("sqrt", "fabs", "floor", "ceil", "copysign")}


def expression_c(function: ca.Function, name: str) -> str:
    """C of a function: `static void name(const double *const *arg, double *const *res)`.

    Everything is read before anything is written. No argument and no result is NULL where it has
    numbers.

    Args:
        function: of SX; MX functions have to be expanded.
        name: what the code is called.

    Raises:
        UnsupportedOperationError: as `expressions.expression_ir`.
        TypeError: it is no function of SX.
    """
    text = _CText()
    rows = instructions(function)
    constants = rows[:, 2:].copy().view(np.float64).ravel().tolist()
    for row, constant in zip(rows.tolist(), constants, strict=True):
        text.instruction(function, row, constant)
    head = f"static void {name}(const double *const *arg, double *const *res)"
    unused = [
        f"    (void){side};"
        for side, read in (("arg", text.reads), ("res", text.stores))
        if not read
    ]
    return "\n".join([head, "{", *unused, *text.lines, *text.stores, "}"])


class _CText(Lines):
    """The lines of one function."""

    def __init__(self) -> None:
        super().__init__()
        self.stores: list[str] = []
        self.reads = False
        self._values: dict[int, str] = {}

    def instruction(self, function: ca.Function, row: list[int], constant: float) -> None:
        """One instruction of CasADi's, as `instructions` has it."""
        operation, a, b, c = row
        if operation == ca.OP_INPUT:
            self.reads = True
            self._values[a] = self.new(f"arg[{b}][{c}]")
        elif operation == ca.OP_OUTPUT:
            self.stores.append(f"    res[{a}][{c}] = {self._values[b]};")
        elif operation == ca.OP_CONST:
            self._values[a] = number(constant)
        else:
            if operation not in OPERATIONS or not has_bits_of_casadi(operation):
                raise UnsupportedOperationError(function.name(), operation)
            operands = [self._values[place] for place in (b, c)[: operands_of(operation)]]
            # Constants of the operations' own are in LLVM's notation.
            self._values[a] = OPERATIONS[operation](self, *operands)

    def new(self, right: str) -> str:
        return self._named("double", right)

    def _named(self, kind: str, right: str) -> str:
        name = f"v{len(self.lines)}"
        self.lines.append(f"    const {kind} {name} = {right};")
        return name

    def two(self, operation: str, x: str, y: str) -> str:
        return self.new(f"{_c(x)} {_TWO[operation]} {_c(y)}")

    def negative(self, x: str) -> str:
        return self.new(f"-{_c(x)}")

    def bit(self, condition: str, x: str, y: str) -> str:
        if condition == "uno":
            return self._named("bool", f"{_c(x)} != {_c(x)} || {_c(y)} != {_c(y)}")
        return self._named("bool", f"{_c(x)} {_CONDITIONS[condition]} {_c(y)}")

    def both(self, operation: str, a: str, b: str) -> str:
        return self._named("bool", f"{a} {'&&' if operation == 'and' else '||'} {b}")

    def one_or_zero(self, bit: str) -> str:
        return self.new(f"{bit} ? 1.0 : 0.0")

    def choice(self, bit: str, x: str, y: str) -> str:
        return self.new(f"{bit} ? {_c(x)} : {_c(y)}")

    def signs(self, operation: str, x: str, y: str) -> str:
        return self.new(f"ts_signs({_c(x)}, {_c(y)}, {'true' if operation == 'or' else 'false'})")

    def call(self, called: str, *operands: str) -> str:
        name = _OWN.get(called, called)
        assert name in (*libm.NAMED, *_OWN.values())
        return self.new(f"{name}({', '.join(map(_c, operands))})")


def _c(value: str) -> str:
    """A value as C has it, which may be a number in LLVM's notation."""
    if not value.startswith("0x"):
        return value
    return number(float(np.array([int(value, 16)], dtype=np.uint64).view(np.float64)[0]))
