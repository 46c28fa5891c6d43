"""Kernels as C99, with the bits that they have as LLVM IR and under Python.

What is translated has been accepted by `kernel_ir`, which refuses what would mean something else.
Compilers keep the bits as long as they neither contract nor reorder: `-std=c99`, no `-ffast-math`.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from types import FunctionType
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.native.kernel import (
    ELEMENTS,
    KernelError,
    KernelFunction,
    Kind,
    Record,
    Signature,
    call,
    signature_of,
)
from taskspec.native.kernel_ir import kernel_ir

_TYPES = {
    Kind.INT: "int64_t",
    Kind.FLOAT: "double",
    Kind.BOOL: "bool",
    Kind.VECTOR: "double *",
    Kind.COUNTS: "int32_t *",
    Kind.WORDS: "int64_t *",
    Kind.NONE: "void",
}

#: What stands ahead of all C.
INCLUDES = """\
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

"""
#: What Python means where C means something else. A function that is not used costs nothing.
PRELUDE = """\
static inline int64_t py_mod(int64_t x, int64_t y)
{
    int64_t rest = x % y;
    return rest != 0 && (rest ^ y) < 0 ? rest + y : rest;
}
static inline int64_t py_floor_div(int64_t x, int64_t y)
{
    return x / y - (x % y != 0 && ((x % y) ^ y) < 0);
}
static inline int64_t py_shift(int64_t x, int64_t by) { return (int64_t)((uint64_t)x << by); }
static inline int64_t py_abs(int64_t x) { return x < 0 ? -x : x; }
static inline int64_t py_min(int64_t x, int64_t y) { return y < x ? y : x; }
static inline int64_t py_max(int64_t x, int64_t y) { return y > x ? y : x; }
static inline double py_fmin(double x, double y) { return y < x ? y : x; }
static inline double py_fmax(double x, double y) { return y > x ? y : x; }
"""


def kernel_c(
    *functions: Callable[..., Any],
    instead: Mapping[Callable[..., Any], str] | None = None,
    structures: Mapping[type[Record], str] | None = None,
) -> str:
    """C of kernel functions, of all that they call, and of the records that they take.

    The functions named are visible outside; others are static. `PRELUDE` comes before it.

    Args:
        functions: whose C is wanted, by their names.
        instead: functions that C has by other names, with the same arguments.
        structures: C of records that are to lie in memory otherwise than under Python.

    Raises:
        KernelError: a function is not within the part of Python that is compiled.
    """
    # What would mean something else is refused there.
    kernel_ir(*functions)
    unit = _CUnit(functions, dict(instead or {}), dict(structures or {}))
    for function in functions:
        unit.add(function)
    return unit.text()


def record_name(record: type[Record]) -> str:
    """What C calls a record."""
    return f"struct {record.__name__}"


class _CUnit:
    """Functions, each translated once, and the records that they take."""

    def __init__(
        self,
        visible: Sequence[Callable[..., Any]],
        instead: dict[Callable[..., Any], str],
        structures: dict[type[Record], str],
    ) -> None:
        self._visible, self.instead, self._structures = visible, instead, structures
        self._signatures: dict[Any, Signature] = {}
        self._heads: list[str] = []
        self._bodies: list[str] = []
        self._records: dict[str, type[Record]] = {}

    def add(self, function: Any) -> Signature:
        """The signature of a function, translated if it was not yet."""
        if function in self._signatures:
            return self._signatures[function]
        source = KernelFunction(function)
        symbol = function.__name__ if function in self._visible else None
        linkage = "static " if symbol is None else ""
        own = function.__name__.lstrip("_")
        # Names that begin with an underscore are the compiler's.
        for name in (symbol, f"ts_{own}", f"ts_{function.__module__.rpartition('.')[2]}_{own}"):
            signature = signature_of(source, name or "")
            if name and all(name != other.symbol for other in self._signatures.values()):
                break
        self._signatures[function] = signature
        for record in signature.records.values():
            self._take(record)
        if function in self.instead:
            return self._renamed(function, signature)
        head = f"{linkage}{_declared(signature)}"
        self._heads.append(f"{head};")
        self._bodies.append(_CBody(self, source, signature).text(head))
        return signature

    def _renamed(self, function: Any, signature: Signature) -> Signature:
        named = Signature(
            self.instead[function],
            signature.names,
            signature.parameters,
            signature.records,
            signature.result,
        )
        self._signatures[function] = named
        return named

    def _take(self, record: type[Record]) -> None:
        if record.__name__ in self._records:
            return
        for inner in record.records.values():
            self._take(inner)
        self._records[record.__name__] = record

    def text(self) -> str:
        structures = [self._structures.get(r) or structure(r) for r in self._records.values()]
        return "\n\n".join(["\n\n".join(structures), "\n".join(self._heads), *self._bodies, ""])


def structure(record: type[Record]) -> str:
    """The C structure of a record; records in it are pointers, as vectors are."""
    members = []
    for name, kind in record.fields.items():
        inner = record.records.get(name)
        written = _TYPES[kind] if inner is None else f"{record_name(inner)} *"
        members.append(f"    {written} {name};".replace("* ", "*"))
    return "\n".join([f"{record_name(record)} {{", *members, "};"])


def _declared(signature: Signature) -> str:
    given = []
    for name, kind in zip(signature.names, signature.parameters, strict=True):
        record = signature.records.get(name)
        written = f"{record_name(record)} *" if record is not None else f"{_TYPES[kind]} "
        given.append(f"{written}{_named(name)}".replace("* ", "*"))
    return f"{_TYPES[signature.result]} {signature.symbol}({', '.join(given) or 'void'})"


#: Words of C, and what it declares, that a name of Python may not be.
_RESERVED = frozenset(
    (
        *("auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else"),
        *("enum", "extern", "float", "for", "goto", "if", "inline", "int", "long", "register"),
        *("restrict", "return", "short", "signed", "sizeof", "static", "struct", "switch"),
        *("typedef", "union", "unsigned", "void", "volatile", "while", "bool", "true", "false"),
        *("y0", "y1", "yn", "j0", "j1", "jn", "gamma"),
    )
)


def _named(name: str) -> str:
    return f"{name}_" if name in _RESERVED else name


@dataclass(frozen=True)
class _Term:
    """A value in C: its text, as an operand of anything, and whether it calls a kernel function."""

    kind: Kind
    text: str
    record: type[Record] | None = None
    calls: bool = False


@dataclass
class _CBody:
    """The C of one function, whose names are declared at its begin."""

    unit: _CUnit
    source: KernelFunction
    signature: Signature
    lines: list[str] = field(default_factory=list)
    kinds: dict[str, Kind] = field(default_factory=dict)
    depth: int = 1
    count: int = 0

    def text(self, head: str) -> str:
        for name, kind in zip(self.signature.names, self.signature.parameters, strict=True):
            self.kinds[name] = kind
        self._block(self.source.tree.body)
        own = [name for name in self.kinds if name not in self.signature.names]
        zero = {Kind.INT: "0", Kind.FLOAT: "0.0", Kind.BOOL: "false"}
        declared = [
            f"    {_TYPES[self.kinds[name]]} {_named(name)} = {zero.get(self.kinds[name], '0')};"
            .replace("* ", "*")
            for name in own
        ]  # fmt: skip
        unused = [
            f"    (void){_named(name)};" for name in self.signature.names if not self._reads(name)
        ]
        document = ast.get_docstring(self.source.tree)
        said = [f"/* {document.split(chr(10))[0]} */"] if document else []
        return "\n".join([*said, head, "{", *declared, *unused, *self.lines, "}"])

    def _line(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    def _reads(self, name: str) -> bool:
        """Whether the function reads a name."""
        return any(
            isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Load)
            for node in ast.walk(self.source.tree)
        )

    # Statements.

    def _block(self, statements: list[ast.stmt]) -> None:
        for statement in statements:
            _DOES[type(statement)](self, statement)

    def _inner(self, statements: list[ast.stmt]) -> None:
        self.depth += 1
        self._block(statements)
        self.depth -= 1

    def expression(self, s: ast.Expr) -> None:
        if not isinstance(s.value, ast.Constant):
            self._line(f"{self._value(s.value).text};")

    def nothing(self, _: ast.Pass) -> None:
        self._line(";")

    def assign(self, s: ast.Assign) -> None:
        targets = s.targets
        if not isinstance(targets[0], ast.Tuple):
            value = self._value(s.value)
            for target in targets:
                self._put(target, value)
            return
        assert isinstance(s.value, ast.Tuple)
        values = []
        for element in s.value.elts:
            value = self._value(element)
            self.count += 1
            name = f"given{self.count}"
            self.kinds[name] = value.kind
            self._line(f"{name} = {value.text};")
            values.append(_Term(value.kind, name))
        for target, value in zip(targets[0].elts, values, strict=True):
            self._put(target, value)

    def declare(self, s: ast.AnnAssign) -> None:
        assert s.value is not None
        self._put(s.target, self._value(s.value))

    def change(self, s: ast.AugAssign) -> None:
        place: ast.expr
        if isinstance(s.target, ast.Name):
            place = ast.copy_location(ast.Name(s.target.id, ast.Load()), s)
        else:
            place = s.target
        old = self._value(place)
        self._put(s.target, self._arithmetic(s, s.op, old, self._value(s.value)))

    def _put(self, target: ast.expr, value: _Term) -> None:
        if isinstance(target, ast.Name):
            self.kinds.setdefault(target.id, value.kind)
            self._line(f"{_named(target.id)} = {value.text};")
            return
        place = self._value(target)
        narrow = isinstance(target, ast.Subscript) and self._kind(target.value) is Kind.COUNTS
        self._line(f"{place.text} = {'(int32_t)' if narrow else ''}{value.text};")

    def _kind(self, e: ast.expr) -> Kind:
        return self._value(e).kind

    def give_back(self, s: ast.Return) -> None:
        self._line("return;" if s.value is None else f"return {self._value(s.value).text};")

    def choose(self, s: ast.If) -> None:
        self._line(f"if ({self._truth(s.test)}) {{")
        self._inner(s.body)
        while len(s.orelse) == 1 and isinstance(s.orelse[0], ast.If):
            s = s.orelse[0]
            self._line(f"}} else if ({self._truth(s.test)}) {{")
            self._inner(s.body)
        if s.orelse:
            self._line("} else {")
            self._inner(s.orelse)
        self._line("}")

    def repeat(self, s: ast.While) -> None:
        forever = isinstance(s.test, ast.Constant) and s.test.value is True
        self._line(f"while ({'1' if forever else self._truth(s.test)}) {{")
        self._inner(s.body)
        self._line("}")

    def count_up(self, s: ast.For) -> None:
        assert isinstance(s.iter, ast.Call)
        assert isinstance(s.target, ast.Name)
        bounds = [self._value(x).text for x in s.iter.args[:2]]
        first, end = bounds if len(bounds) > 1 else ("0", bounds[0])
        step = ast.unparse(s.iter.args[2]) if len(s.iter.args) == 3 else "1"
        self.count += 1
        at, to, name = f"at{self.count}", f"to{self.count}", s.target.id
        compares = ">" if step.startswith("-") else "<"
        self._line(
            f"for (int64_t {at} = {first}, {to} = {end}; {at} {compares} {to}; {at} += {step}) {{"
        )
        self.depth += 1
        if self._reads(name):
            self.kinds.setdefault(name, Kind.INT)
            self._line(f"{_named(name)} = {at};")
        self._block(s.body)
        self.depth -= 1
        self._line("}")

    def leave_loop(self, _: ast.Break) -> None:
        self._line("break;")

    def next_turn(self, _: ast.Continue) -> None:
        self._line("continue;")

    # Expressions.

    def _value(self, e: ast.expr) -> _Term:
        return _VALUES[type(e)](self, e)

    def _truth(self, e: ast.expr) -> str:
        text = self._value(e).text
        # What is in parentheses as a whole has a pair of its own in an `if`.
        return text[1:-1] if _enclosed(text) else text

    def constant(self, e: ast.Constant) -> _Term:
        return _number(e.value)

    def name(self, e: ast.Name) -> _Term:
        if e.id in self.kinds:
            return _Term(self.kinds[e.id], _named(e.id), self.signature.records.get(e.id))
        return _number(self.source.meaning(e.id))

    def attribute(self, e: ast.Attribute) -> _Term:
        root: ast.expr = e
        while isinstance(root, ast.Attribute):
            root = root.value
        if isinstance(root, ast.Name) and root.id not in self.kinds:
            return _number(self._meaning(e))
        base = self._value(e.value)
        if base.record is None:
            raise self.source.refusal(e, f"C does not know `{ast.unparse(e)}`")
        kind, inner = base.record.fields[e.attr], base.record.records.get(e.attr)
        return _Term(kind, f"{base.text}->{e.attr}", inner)

    def part(self, e: ast.Subscript) -> _Term:
        base = self._value(e.value)
        if isinstance(e.slice, ast.Slice):
            assert e.slice.lower is not None
            return _Term(base.kind, f"({base.text} + {self._value(e.slice.lower).text})")
        index = self._truth(e.slice)
        return _Term(ELEMENTS[base.kind][0], f"{base.text}[{index}]")

    def two(self, e: ast.BinOp) -> _Term:
        return self._arithmetic(e, e.op, self._value(e.left), self._value(e.right))

    def _arithmetic(self, node: ast.AST, op: ast.operator, x: _Term, y: _Term) -> _Term:
        if x.calls and y.calls:
            raise self.source.refusal(node, "C may call the second first; give the first a name")
        kind = Kind.FLOAT if Kind.FLOAT in (x.kind, y.kind) else Kind.INT
        by_function = {
            ast.FloorDiv: "py_floor_div",
            ast.Mod: "py_mod",
            ast.LShift: "py_shift",
        }.get(type(op))
        if by_function is not None:
            return _Term(kind, f"{by_function}({x.text}, {y.text})", calls=x.calls or y.calls)
        text = f"({x.text} {_OPERATORS[type(op)]} {y.text})"
        return _Term(kind, text, calls=x.calls or y.calls)

    def one(self, e: ast.UnaryOp) -> _Term:
        x = self._value(e.operand)
        if isinstance(e.op, ast.Not):
            return _Term(Kind.BOOL, f"!{x.text}", calls=x.calls)
        return _Term(x.kind, f"(-{x.text})", calls=x.calls)

    def compare(self, e: ast.Compare) -> _Term:
        x, y = self._value(e.left), self._value(e.comparators[0])
        if x.calls and y.calls:
            raise self.source.refusal(e, "C may call the second first; give the first a name")
        text = f"({x.text} {_COMPARES[type(e.ops[0])]} {y.text})"
        return _Term(Kind.BOOL, text, calls=x.calls or y.calls)

    def both_or_either(self, e: ast.BoolOp) -> _Term:
        sign = " && " if isinstance(e.op, ast.And) else " || "
        parts = [self._value(part) for part in e.values]
        text = sign.join(part.text for part in parts)
        return _Term(Kind.BOOL, f"({text})", calls=any(part.calls for part in parts))

    def either(self, e: ast.IfExp) -> _Term:
        x, y = self._value(e.body), self._value(e.orelse)
        calls = x.calls or y.calls or self._value(e.test).calls
        return _Term(x.kind, f"({self._truth(e.test)} ? {x.text} : {y.text})", calls=calls)

    # Calls.

    def called(self, e: ast.Call) -> _Term:
        meant = self._meaning(e.func)
        given = [self._value(x) for x in e.args]
        if sum(each.calls for each in given) > 1:
            raise self.source.refusal(e, "C may call the arguments in any order; give them names")
        if meant is call:
            raise self.source.refusal(e, "C has no functions by address; name one instead")
        if isinstance(meant, FunctionType):
            signature = self.unit.add(meant)
            text = ", ".join(_bare(each.text) for each in given)
            return _Term(signature.result, f"{signature.symbol}({text})", calls=True)
        return _CALLS[meant](given)

    def _meaning(self, e: ast.expr) -> Any:
        if isinstance(e, ast.Name):
            return self.source.meaning(e.id)
        assert isinstance(e, ast.Attribute)
        return getattr(self._meaning(e.value), e.attr)


def _enclosed(text: str) -> bool:
    """Whether the first parenthesis of a text is closed by its last character."""
    if not text.startswith("("):
        return False
    depth = 0
    for i, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return i == len(text) - 1
    return False


def _bare(text: str) -> str:
    return text[1:-1] if _enclosed(text) else text


def number(value: float) -> str:
    """A double in C, to the bit."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    return repr(float(value)) if math.copysign(1.0, value) > 0 else f"({float(value)!r})"


def _number(value: Any) -> _Term:
    if isinstance(value, bool):
        return _Term(Kind.BOOL, "true" if value else "false")
    if isinstance(value, int):
        # A literal of C is an int, in which large ones and their products have no room.
        text = str(int(value)) if abs(value) < 2**15 else f"INT64_C({int(value)})"
        return _Term(Kind.INT, text if value >= 0 else f"({text})")
    if isinstance(value, float):
        return _Term(Kind.FLOAT, number(value))
    raise KernelError(f"{value!r} is no number")


def _to_int(given: list[_Term]) -> _Term:
    return _Term(Kind.INT, f"(int64_t){given[0].text}", calls=given[0].calls)


def _to_float(given: list[_Term]) -> _Term:
    return _Term(Kind.FLOAT, f"(double){given[0].text}", calls=given[0].calls)


def _size(given: list[_Term]) -> _Term:
    name = "py_abs" if given[0].kind is Kind.INT else "fabs"
    return _Term(given[0].kind, f"{name}({_bare(given[0].text)})", calls=given[0].calls)


def _extreme(name: str) -> Callable[[list[_Term]], _Term]:
    def called(given: list[_Term]) -> _Term:
        text, kind = given[0].text, given[0].kind
        prefix = "py_" if kind is Kind.INT else "py_f"
        for each in given[1:]:
            text = f"{prefix}{name}({_bare(text)}, {_bare(each.text)})"
        return _Term(kind, text, calls=any(each.calls for each in given))

    return called


def _of_c(name: str, kind: Kind = Kind.FLOAT) -> Callable[[list[_Term]], _Term]:
    cast = "(int64_t)" if kind is Kind.INT else ""

    def called(given: list[_Term]) -> _Term:
        text = ", ".join(_bare(each.text) for each in given)
        written = f"{cast}{name}({text})"
        if kind is Kind.BOOL:
            written = f"({written} != 0)"
        return _Term(kind, written, calls=any(each.calls for each in given))

    return called


_SAME_IN_C = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "atan2"),
    *("sqrt", "fabs", "copysign"),
)
_CALLS: dict[Any, Callable[[list[_Term]], _Term]] = {
    int: _to_int,
    float: _to_float,
    abs: _size,
    max: _extreme("max"),
    min: _extreme("min"),
    math.floor: _of_c("floor", Kind.INT),
    math.ceil: _of_c("ceil", Kind.INT),
    math.isfinite: _of_c("isfinite", Kind.BOOL),
    math.isinf: _of_c("isinf", Kind.BOOL),
    math.isnan: _of_c("isnan", Kind.BOOL),
    **{getattr(math, name): _of_c(name) for name in _SAME_IN_C},
}
_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.BitXor: "^",
    ast.RShift: ">>",
}
_COMPARES: dict[type[ast.cmpop], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}
_DOES: dict[type[ast.stmt], Callable[[_CBody, Any], None]] = {
    ast.Expr: _CBody.expression,
    ast.Pass: _CBody.nothing,
    ast.Assign: _CBody.assign,
    ast.AnnAssign: _CBody.declare,
    ast.AugAssign: _CBody.change,
    ast.Return: _CBody.give_back,
    ast.If: _CBody.choose,
    ast.While: _CBody.repeat,
    ast.For: _CBody.count_up,
    ast.Break: _CBody.leave_loop,
    ast.Continue: _CBody.next_turn,
}
_VALUES: dict[type[ast.expr], Callable[[_CBody, Any], _Term]] = {
    ast.Constant: _CBody.constant,
    ast.Name: _CBody.name,
    ast.Attribute: _CBody.attribute,
    ast.Subscript: _CBody.part,
    ast.BinOp: _CBody.two,
    ast.UnaryOp: _CBody.one,
    ast.Compare: _CBody.compare,
    ast.BoolOp: _CBody.both_or_either,
    ast.IfExp: _CBody.either,
    ast.Call: _CBody.called,
}
