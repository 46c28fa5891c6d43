"""CasADi's SX functions as LLVM IR, to the bits of CasADi's own virtual machine.

One instruction of CasADi becomes one of LLVM, or a call of the function of libm that CasADi calls.
Nothing is contracted or reordered. NaN is NaN on both sides; its sign and payload may differ.
"""

from __future__ import annotations

import ctypes
import enum
import math
import struct
from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np

from taskspec.native import libm
from taskspec.native.instructions import instructions


class UnsupportedOperationError(Exception):
    """A function has an operation that only CasADi's virtual machine has, or has to its bits.

    Attributes:
        opcode: CasADi's number of it.
        operation: CasADi's name of it, such as OP_CALL.
    """

    def __init__(self, function: str, opcode: int, reason: str = "machine code lacks") -> None:
        """Takes the function's name, CasADi's number of the operation, and what is amiss."""
        self.opcode = opcode
        self.operation = _names().get(opcode, f"opcode {opcode}")
        super().__init__(f"function {function} uses {self.operation}, which {reason}")


def expression_ir(function: ca.Function, name: str) -> str:
    """LLVM IR of a function, with CasADi's calling convention.

    `int name(const double **arg, double **res, long long *iw, double *w, int mem)` returns 0 and
    needs neither `iw`, `w` nor `mem`. An argument of NULL is zeros, a result of NULL is left out.
    Everything is read before anything is written, so that a result may lie where an argument does;
    that also takes two thirds of the time (measured). CasADi's virtual machine writes as it goes:
    where both are to give the same bits, results have memory of their own.

    Args:
        function: of SX; MX functions have to be expanded.
        name: what the code is called.

    Raises:
        UnsupportedOperationError: it calls a function or prints, or needs a function of libm that
            is another one than CasADi's on this platform.
        TypeError: it is no function of SX.
    """
    return _Text(function, name).whole()


class Lines:
    """Lines of IR that compute numbers of numbers.

    Attributes:
        lines: so far.
        called: functions of libm and of LLVM that they call.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.called: set[str] = set()

    def new(self, right: str) -> str:
        """A value with a name of its own, which is returned."""
        self.lines.append(f"%v{len(self.lines)} = {right}")
        return f"%v{len(self.lines) - 1}"

    def two(self, operation: str, x: str, y: str) -> str:
        """An operation of LLVM, such as fadd, of two numbers."""
        return self.new(f"{operation} double {x}, {y}")

    def negative(self, x: str) -> str:
        """The number with the other sign."""
        return self.new(f"fneg double {x}")

    def bit(self, condition: str, x: str, y: str) -> str:
        """Whether LLVM's condition, such as olt, holds for two numbers."""
        return self.new(f"fcmp {condition} double {x}, {y}")

    def both(self, operation: str, a: str, b: str) -> str:
        """An operation of LLVM, such as and, of two bits."""
        return self.new(f"{operation} i1 {a}, {b}")

    def one_or_zero(self, bit: str) -> str:
        """A bit as a number."""
        return self.new(f"uitofp i1 {bit} to double")

    def choice(self, bit: str, x: str, y: str) -> str:
        """The number x where the bit is set, else y."""
        return self.new(f"select i1 {bit}, double {x}, double {y}")

    def signs(self, operation: str, x: str, y: str) -> str:
        """The bits of two equal numbers together: zeros alone differ, in their signs."""
        bits = [self.new(f"bitcast double {value} to i64") for value in (x, y)]
        return self.new(
            f"bitcast i64 {self.new(f'{operation} i64 {bits[0]}, {bits[1]}')} to double"
        )

    def call(self, called: str, *operands: str) -> str:
        """A function of libm, or one of LLVM's own, which are exact."""
        self.called.add(called)
        given = ", ".join(f"double {x}" for x in operands)
        at = f"@{called}" if called.startswith("llvm.") else libm.symbol(called)
        return self.new(f"call double {at}({given})")


class _Text(Lines):
    """The text of one function, instruction by instruction."""

    def __init__(self, function: ca.Function, name: str) -> None:
        super().__init__()
        self._function, self._name = function, name
        self._stores: list[str] = []
        self._values: dict[int, str] = {}

    def whole(self) -> str:
        f = self._function
        inputs = [f.nnz_in(k) for k in range(f.n_in())]
        outputs = [f.nnz_out(k) for k in range(f.n_out())]
        rows = instructions(f)
        numbers = rows[:, 2:].copy().view(np.float64).ravel().tolist()
        for (operation, a, b, c), constant in zip(rows.tolist(), numbers, strict=True):
            self._instruction(operation, a, b, c, constant)
        head = [
            f'define i32 @"{self._name}"'
            "(ptr %arg, ptr %res, ptr %iw, ptr %w, i32 %mem) nounwind {",
            f"%unwanted = alloca [{max(outputs, default=0)} x double]",
            *_pointers("arg", inputs, f'@"{self._name}.zeros"'),
            *_pointers("res", outputs, "%unwanted"),
        ]
        zeros = f"[{max(inputs, default=0)} x double] zeroinitializer"
        return "\n".join(
            [
                f'@"{self._name}.zeros" = internal constant {zeros}',
                *head,
                *self.lines,
                *self._stores,
                "ret i32 0",
                "}",
                *(declaration(called) for called in sorted(self.called)),
                "",
            ]
        )

    def _instruction(self, operation: int, a: int, b: int, c: int, constant: float) -> None:
        if operation == ca.OP_INPUT:
            place = self.new(f"getelementptr double, ptr %arg{b}, i64 {c}")
            self._values[a] = self.new(f"load double, ptr {place}")
        elif operation == ca.OP_OUTPUT:
            place = self.new(f"getelementptr double, ptr %res{a}, i64 {c}")
            self._stores.append(f"store double {self._values[b]}, ptr {place}")
        elif operation == ca.OP_CONST:
            self._values[a] = number(constant)
        else:
            if operation not in OPERATIONS:
                raise UnsupportedOperationError(self._function.name(), operation)
            if not has_bits_of_casadi(operation):
                reason = "this libm has with other bits"
                raise UnsupportedOperationError(self._function.name(), operation, reason)
            operands = [self._values[place] for place in (b, c)[: operands_of(operation)]]
            self._values[a] = OPERATIONS[operation](self, *operands)


def number(value: float) -> str:
    """A double in LLVM's notation, to the bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def _pointers(name: str, sizes: list[int], otherwise: str) -> list[str]:
    """Where arguments or results lie, those that are not given at a place that serves for them."""
    lines = []
    for k, size in enumerate(sizes):
        if size:
            lines += [
                f"%{name}{k}.at = getelementptr ptr, ptr %{name}, i64 {k}",
                f"%{name}{k}.given = load ptr, ptr %{name}{k}.at",
                f"%{name}{k}.null = icmp eq ptr %{name}{k}.given, null",
                f"%{name}{k} = select i1 %{name}{k}.null, ptr {otherwise}, ptr %{name}{k}.given",
            ]
    return lines


def declaration(called: str) -> str:
    """The line that a text needs to call a function of libm or one of LLVM's own."""
    if called == "llvm.copysign.f64":
        return f"declare double @{called}(double, double)"
    return (
        f"declare double @{called}(double)"
        if called.startswith("llvm.")
        else libm.declaration(called)
    )


@cache
def _is_casadis(name: str) -> bool:
    """Whether a function of libm has the bits that CasADi has: it may be linked with another."""
    count = 1 if name in libm.UNARY else 2
    ends = (0.0, 5e-324, 1e-9, 0.5, 1.0, 1e22, math.inf)
    values = np.concatenate([np.linspace(-3.0, 3.0, 41), ends, np.negative(ends), [math.nan]])
    operands = [values, np.roll(values, 5)][:count]
    symbols = [ca.SX.sym(f"x{k}", values.size) for k in range(count)]
    make, opcode = (ca.SX.unary, ca.SX.binary)[count - 1], getattr(ca, f"OP_{name.upper()}")
    theirs = ca.Function("theirs", symbols, [make(opcode, *symbols)])(*operands)
    called = ctypes.CFUNCTYPE(*[ctypes.c_double] * (count + 1))(libm.address(f"libm.{name}"))
    ours = [called(*numbers) for numbers in zip(*operands, strict=True)]
    return bool(np.array_equal(np.array(theirs).ravel(), ours, equal_nan=True))


@cache
def _names() -> dict[int, str]:
    return {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}


_ZERO, _ONE, _MINUS_ONE = number(0.0), number(1.0), number(-1.0)

_Operation = Callable[..., str]


def _arithmetic(operation: str) -> _Operation:
    return lambda text, x, y: text.two(operation, x, y)


def _comparison(condition: str) -> _Operation:
    return lambda text, x, y: text.one_or_zero(text.bit(condition, x, y))


def _called(name: str) -> _Operation:
    return lambda text, *operands: text.call(name, *operands)


def _logic(operation: str) -> _Operation:
    """Of truths, which all numbers but zeros are, NaN among them."""

    def lines(text: Lines, x: str, y: str) -> str:
        left, right = text.bit("une", x, _ZERO), text.bit("une", y, _ZERO)
        return text.one_or_zero(text.both(operation, left, right))

    return lines


def _sign(text: Lines, x: str) -> str:
    """x < 0 ? -1 : x > 0 ? 1 : x, so that zeros keep their sign and NaN stays."""
    rest = text.choice(text.bit("ogt", x, _ZERO), _ONE, x)
    return text.choice(text.bit("olt", x, _ZERO), _MINUS_ONE, rest)


def _extreme(name: str, condition: str) -> _Operation:
    """The smaller or larger of two, the other one where one is NaN.

    Of zeros of both signs the standard lets a libm take either, so that CasADi is asked.
    """

    def lines(text: Lines, x: str, y: str) -> str:
        zero = _zero_taken(name)
        # A comparison that holds for equal numbers takes the first of them.
        before = text.bit(condition + ("e" if zero is Zero.FIRST else "t"), x, y)
        taken = text.choice(text.both("or", before, text.bit("uno", y, y)), x, y)
        if zero in (Zero.FIRST, Zero.SECOND):
            return taken
        sign = text.signs("or" if zero is Zero.NEGATIVE else "and", x, y)
        return text.choice(text.bit("oeq", x, y), sign, taken)

    return lines


class Zero(enum.Enum):
    """Which one of 0 and -0 is the smaller or larger."""

    FIRST = (False, True)
    SECOND = (True, False)
    NEGATIVE = (True, True)
    POSITIVE = (False, False)


@cache
def _zero_taken(name: str) -> Zero:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    extreme = ca.Function("extreme", [x, y], [getattr(ca, name)(x, y)])
    signs = (np.signbit(float(extreme(*zeros))) for zeros in ((0.0, -0.0), (-0.0, 0.0)))
    return Zero(tuple(bool(sign) for sign in signs))


def _polynomial(text: Lines, z: str, coefficients: tuple[float, ...]) -> str:
    """By Horner's scheme, from the highest power."""
    total = number(coefficients[0])
    for coefficient in coefficients[1:]:
        total = text.two("fadd", text.two("fmul", total, z), number(coefficient))
    return total


_MIDDLE = (
    (-0.140543331, 0.914624893, -1.645349621, 0.886226899),
    (-0.329097515, 0.012229801, 1.442710462, -2.118377725, 1.0),
)
_TAIL = ((1.641345311, 3.429567803, -1.624906493, -1.970840454), (1.6370678, 3.5438892, 1.0))


def _erfinv(text: Lines, x: str) -> str:
    """CasADi's own approximation and its two steps of Newton, which its lower tail goes without.

    All parts are computed, and one is chosen.
    """

    def tail(sign: str) -> str:
        half = text.two("fdiv", text.two(sign, _ONE, x), number(2.0))
        z = text.call("llvm.sqrt.f64", text.negative(text.call("log", half)))
        return text.two("fdiv", *(_polynomial(text, z, part) for part in _TAIL))

    above, below = (_polynomial(text, text.two("fmul", x, x), part) for part in _MIDDLE)
    near = text.two("fdiv", text.two("fmul", x, above), below)
    y = text.choice(text.bit("olt", x, number(0.7)), near, tail("fsub"))
    slope = number(2.0 / math.sqrt(math.pi))
    for _ in range(2):
        bell = text.call("exp", text.two("fmul", text.negative(y), y))
        error = text.two("fsub", text.call("erf", y), x)
        y = text.two("fsub", y, text.two("fdiv", error, text.two("fmul", slope, bell)))
    y = text.choice(text.bit("olt", x, number(-0.7)), text.negative(tail("fadd")), y)
    for condition, end in (("ole", -1.0), ("oge", 1.0)):
        limit = text.choice(
            text.bit("oeq", x, number(end)), number(end * math.inf), number(math.nan)
        )
        y = text.choice(text.bit(condition, x, number(end)), limit, y)
    return y


_ONE_OPERAND: dict[int, _Operation] = {
    ca.OP_ASSIGN: lambda _text, x: x,
    ca.OP_NEG: lambda text, x: text.negative(x),
    ca.OP_SQ: lambda text, x: text.two("fmul", x, x),
    ca.OP_TWICE: lambda text, x: text.two("fadd", x, x),
    ca.OP_INV: lambda text, x: text.two("fdiv", _ONE, x),
    ca.OP_NOT: lambda text, x: text.one_or_zero(text.bit("oeq", x, _ZERO)),
    ca.OP_SIGN: _sign,
    ca.OP_ERFINV: _erfinv,
    ca.OP_SQRT: _called("llvm.sqrt.f64"),
    ca.OP_FABS: _called("llvm.fabs.f64"),
    ca.OP_FLOOR: _called("llvm.floor.f64"),
    ca.OP_CEIL: _called("llvm.ceil.f64"),
    **{getattr(ca, f"OP_{name.upper()}"): _called(name) for name in libm.UNARY},
}
_TWO_OPERANDS: dict[int, _Operation] = {
    ca.OP_LIFT: lambda _text, x, _guess: x,
    ca.OP_ADD: _arithmetic("fadd"),
    ca.OP_SUB: _arithmetic("fsub"),
    ca.OP_MUL: _arithmetic("fmul"),
    ca.OP_DIV: _arithmetic("fdiv"),
    ca.OP_LT: _comparison("olt"),
    ca.OP_LE: _comparison("ole"),
    ca.OP_EQ: _comparison("oeq"),
    ca.OP_NE: _comparison("une"),
    ca.OP_AND: _logic("and"),
    ca.OP_OR: _logic("or"),
    ca.OP_IF_ELSE_ZERO: lambda text, x, y: text.choice(text.bit("oeq", x, _ZERO), _ZERO, y),
    ca.OP_FMIN: _extreme("fmin", "ol"),
    ca.OP_FMAX: _extreme("fmax", "og"),
    ca.OP_COPYSIGN: _called("llvm.copysign.f64"),
    ca.OP_CONSTPOW: _called("pow"),
    **{getattr(ca, f"OP_{name.upper()}"): _called(name) for name in libm.BINARY},
}
#: By CasADi's number of each operation, what its lines are made by, of its operands.
OPERATIONS: dict[int, _Operation] = {**_ONE_OPERAND, **_TWO_OPERANDS}
# What operations call.
_LIBM: dict[int, tuple[str, ...]] = {
    ca.OP_CONSTPOW: ("pow",),
    ca.OP_ERFINV: ("log", "exp", "erf"),
    **{getattr(ca, f"OP_{name.upper()}"): (name,) for name in libm.NAMED},
}


def operands_of(operation: int) -> int:
    """How many operands one of `OPERATIONS` has."""
    return 1 if operation in _ONE_OPERAND else 2


def has_bits_of_casadi(operation: int) -> bool:
    """Whether one of `OPERATIONS` gives CasADi's bits with this platform's libm."""
    return all(_is_casadis(name) for name in _LIBM.get(operation, ()))
