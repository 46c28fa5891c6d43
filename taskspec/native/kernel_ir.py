"""Kernels as LLVM IR."""

from __future__ import annotations

import ast
import inspect
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.native import expressions, instructions, kernel, libm
from taskspec.native.expressions import number
from taskspec.native.kernel import (
    ELEMENTS,
    KernelError,
    KernelFunction,
    Kind,
    Record,
    Signature,
    annotated,
    call,
    signature_of,
)


def kernel_ir(*functions: Callable[..., Any]) -> str:
    """LLVM IR of kernel functions and of all that they call.

    The functions have addresses by their names. Numbers are passed as int64 and double, vectors and
    records by their addresses; bool is one byte.

    Raises:
        KernelError: a function is not within the part of Python that is compiled.
    """
    unit = _Unit()
    for function in functions:
        unit.add(function, function.__name__)
    return unit.text()


def kernel_source(*modules: ModuleType) -> bytes:
    """What the IR of a kernel follows from: this package, and the modules that the kernel is in.

    Args:
        modules: every one in which it has a function, a record or a constant.
    """
    own = sys.modules[__name__]
    return b"".join(
        _written(module) for module in (libm, instructions, expressions, kernel, own, *modules)
    )


@cache
def _written(module: ModuleType) -> bytes:
    return Path(inspect.getfile(module)).read_bytes()


@dataclass(frozen=True)
class _Value:
    kind: Kind
    text: str
    literal: bool = False
    record: type[Record] | None = None


class _Unit:
    """Functions, each compiled once, and the lines that they share."""

    def __init__(self) -> None:
        self._signatures: dict[Any, Signature] = {}
        self._bodies: list[str] = []
        self.declared: set[str] = set()

    def add(self, function: Any, symbol: str | None = None) -> Signature:
        """The signature of a function, compiled if it was not yet."""
        if function in self._signatures:
            return self._signatures[function]
        if not isinstance(function, FunctionType):
            raise KernelError(f"{function!r} is no function of Python")
        source = KernelFunction(function)
        internal = symbol is None
        symbol = symbol or f"{function.__module__}.{function.__name__}"
        if any(symbol == other.symbol for other in self._signatures.values()):
            raise source.refusal(source.tree, f"two functions are named {symbol}")
        signature = signature_of(source, symbol)
        self._signatures[function] = signature
        self._bodies.append(_Body(self, source, signature).text("internal " if internal else ""))
        return signature

    def text(self) -> str:
        return "\n".join([*self._bodies, *sorted(self.declared), ""])


@dataclass
class _Loop:
    again: str
    after: str
    left: bool = False


@dataclass
class _Body:
    """The code of one function. Names live in memory; LLVM puts them into registers."""

    unit: _Unit
    source: KernelFunction
    signature: Signature
    lines: list[str] = field(default_factory=list)
    slots: list[str] = field(default_factory=list)
    kinds: dict[str, Kind] = field(default_factory=dict)
    # Names that have a value on every way that leads here.
    given: set[str] = field(default_factory=set)
    loops: list[_Loop] = field(default_factory=list)
    label: str = "body"
    # Whether the last instruction leaves the block.
    left: bool = False
    count: int = 0

    def text(self, linkage: str) -> str:
        signature = self.signature
        self._local = {name for node in ast.walk(self.source.tree) for name in _stored(node)}
        arguments = []
        for name, kind in zip(signature.names, signature.parameters, strict=True):
            arguments.append(f"{kind.passed} %{name}")
            self._store_name(self.source.tree, name, _Value(kind, f"%{name}"))
        self._block(self.source.tree.body)
        if not self.left:
            if signature.result is not Kind.NONE:
                raise self._refusal(
                    self.source.tree, "its end can be reached; return a value there"
                )
            self._leave("ret void")
        head = f'define {linkage}{signature.result.returned} @"{signature.symbol}"'
        return "\n".join(
            [
                f"{head}({', '.join(arguments)}) nounwind {{",
                *self.slots,
                "br label %body",
                "body:",
                *self.lines,
                "}",
            ]
        )

    def _refusal(self, node: ast.AST, reason: str) -> KernelError:
        return self.source.refusal(node, reason)

    # Instructions.

    def _new(self, right: str) -> str:
        self.count += 1
        self.lines.append(f"%.{self.count} = {right}")
        return f"%.{self.count}"

    def _leave(self, line: str) -> None:
        self.lines.append(line)
        self.left = True

    def _goto(self, label: str) -> None:
        if not self.left:
            self._leave(f"br label %{label}")

    def _labels(self, *names: str) -> list[str]:
        self.count += 1
        return [f"{name}.{self.count}" for name in names]

    def _at(self, label: str) -> None:
        self.lines.append(f"{label}:")
        self.label, self.left = label, False

    def _slot(self, name: str, kind: Kind) -> None:
        self.slots.append(f"%{name} = alloca {kind.ir}")

    # Statements.

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if self.left:
                raise self._refusal(statement, "this is never reached; leave it out")
            does = _STATEMENTS.get(type(statement))
            if does is None:
                raise self._refusal(statement, f"kernels have no `{_first_line(statement)}`")
            does(self, statement)

    def expression(self, s: ast.Expr) -> None:
        if isinstance(s.value, ast.Constant) and isinstance(s.value.value, str):
            return
        if not isinstance(s.value, ast.Call):
            raise self._refusal(s, "an expression alone does nothing; leave it out")
        self._called(s.value)

    def nothing(self, _: ast.Pass) -> None:
        """`pass`."""

    def assign(self, s: ast.Assign) -> None:
        targets = s.targets
        if isinstance(targets[0], ast.Tuple):
            targets = targets[0].elts
            written = s.value.elts if isinstance(s.value, ast.Tuple) else []
            if len(s.targets) > 1 or len(targets) != len(written):
                raise self._refusal(s, "names take as many values, written out: `a, b = x, y`")
            given = [self._value(value) for value in written]
        else:
            given = [self._value(s.value)] * len(targets)
        for target, value in zip(targets, given, strict=True):
            self._put(target, value)

    def declare(self, s: ast.AnnAssign) -> None:
        if s.value is None or not isinstance(s.target, ast.Name):
            raise self._refusal(s, "give the name a value where it is declared")
        value = self._value(s.value)
        if annotated(self.source, s, s.annotation) is not value.kind:
            raise self._refusal(s, f"{ast.unparse(s.value)} is {value.kind}")
        self._put(s.target, value)

    def change(self, s: ast.AugAssign) -> None:
        if isinstance(s.target, ast.Name):
            old = self._value(ast.copy_location(ast.Name(s.target.id, ast.Load()), s))
            new = self._arithmetic(s, s.op, old, self._value(s.value))
            self._store_name(s, s.target.id, new)
            return
        kind, stored, place = self._place(s.target)
        old = self._loaded(kind, stored, place)
        self._write(s, self._arithmetic(s, s.op, old, self._value(s.value)), kind, stored, place)

    def _put(self, target: ast.expr, value: _Value) -> None:
        if isinstance(target, ast.Name):
            self._store_name(target, target.id, value)
        elif isinstance(target, ast.Subscript | ast.Attribute):
            self._write(target, value, *self._place(target))
        else:
            raise self._refusal(target, f"nothing is assigned to `{ast.unparse(target)}`")

    def _store_name(self, node: ast.AST, name: str, value: _Value) -> None:
        if value.kind in (Kind.NONE, Kind.RECORD) and node is not self.source.tree:
            raise self._refusal(node, f"a name holds a number or a vector, not {value.kind}")
        if name not in self.kinds:
            self.kinds[name] = value.kind
            self._slot(f"{name}.slot", value.kind)
        kind = self.kinds[name]
        if kind is not value.kind:
            raise self._refusal(node, f"{name} is {kind} elsewhere; here it is given {value.kind}")
        self.lines.append(f"store {kind.ir} {value.text}, ptr %{name}.slot")
        self.given.add(name)

    def _write(self, node: ast.AST, value: _Value, kind: Kind, stored: str, place: str) -> None:
        if kind not in (Kind.INT, Kind.FLOAT):
            raise self._refusal(node, "the vectors and records of a record stay; write into them")
        if value.kind is not kind:
            written = "float(...) or 1.0" if kind is Kind.FLOAT else "int(...)"
            raise self._refusal(
                node, f"it holds {kind}, and is given {value.kind}; write {written}"
            )
        text = value.text
        if stored == "i32":
            text = self._new(f"trunc i64 {text} to i32")
        self.lines.append(f"store {stored} {text}, ptr {place}")

    def give_back(self, s: ast.Return) -> None:
        result = self.signature.result
        if s.value is None or result is Kind.NONE:
            if s.value is not None or result is not Kind.NONE:
                raise self._refusal(s, f"the function returns {result}")
            self._leave("ret void")
            return
        value = self._value(s.value)
        if value.kind is not result:
            raise self._refusal(s, f"the function returns {result}, and this is {value.kind}")
        self._leave(f"ret {result.ir} {value.text}")

    def choose(self, s: ast.If) -> None:
        then, other, after = self._labels("then", "else", "endif")
        self._fork(s.test, then, other)
        before, ends = set(self.given), []
        for label, body in ((then, s.body), (other, s.orelse)):
            self._at(label)
            self.given = set(before)
            self._block(body)
            if not self.left:
                ends.append(self.given)
            self._goto(after)
        if ends:
            self._at(after)
            self.given = set.intersection(*ends)

    def repeat(self, s: ast.While) -> None:
        if s.orelse:
            raise self._refusal(s, "a loop has no `else`; set a bool")
        test, body, after = self._labels("while", "do", "done")
        self._goto(test)
        self._at(test)
        forever = isinstance(s.test, ast.Constant) and s.test.value is True
        if forever:
            self._goto(body)
        else:
            self._fork(s.test, body, after)
        loop = self._looped(s.body, _Loop(test, after), body)
        self._goto(test)
        if loop.left or not forever:
            self._at(after)

    def count_up(self, s: ast.For) -> None:
        first, end, step = self._range(s)
        if not isinstance(s.target, ast.Name):
            raise self._refusal(s, "`for` counts one name")
        head, body, following, after = self._labels("for", "do", "next", "done")
        counter = f"counter.{self.count}"
        self._slot(counter, Kind.INT)
        self.lines.append(f"store i64 {first}, ptr %{counter}")
        self._goto(head)
        self._at(head)
        now = self._new(f"load i64, ptr %{counter}")
        inside = self._new(f"icmp {'slt' if step > 0 else 'sgt'} i64 {now}, {end}")
        self._leave(f"br i1 {inside}, label %{body}, label %{after}")
        self._looped(s.body, _Loop(following, after), body, s.target, now)
        self._goto(following)
        self._at(following)
        self.lines.append(f"store i64 {self._new(f'add i64 {now}, {step}')}, ptr %{counter}")
        self._goto(head)
        self._at(after)

    def _range(self, s: ast.For) -> tuple[str, str, int]:
        """Where a loop begins, where it ends, and its step."""
        i = s.iter
        plain = isinstance(i, ast.Call) and isinstance(i.func, ast.Name) and not i.keywords
        if s.orelse or not plain or not isinstance(i, ast.Call) or not 1 <= len(i.args) <= 3:
            raise self._refusal(s, "loops are `for i in range(...)`, without `else`")
        if self._meaning(i.func) is not range:
            raise self._refusal(s, "loops are `for i in range(...)`, without `else`")
        step = ast.unparse(i.args[2]).replace("-", "", 1) if len(i.args) == 3 else "1"
        if not step.isdigit() or int(step) == 0:
            raise self._refusal(s, "the step of a range is a number, written out, and not 0")
        bounds = [self._value(x) for x in i.args[:2]]
        if any(bound.kind is not Kind.INT for bound in bounds):
            raise self._refusal(s, "a range counts from an int to an int")
        down = len(i.args) == 3 and ast.unparse(i.args[2]).startswith("-")
        first = bounds[0].text if len(bounds) > 1 else "0"
        return first, bounds[-1].text, -int(step) if down else int(step)

    def _looped(
        self,
        statements: Sequence[ast.stmt],
        loop: _Loop,
        label: str,
        target: ast.Name | None = None,
        now: str = "",
    ) -> _Loop:
        """The body of a loop. It may not run at all: names given in it have no value after it."""
        before = set(self.given)
        self._at(label)
        if target is not None:
            self._store_name(target, target.id, _Value(Kind.INT, now))
        self.loops.append(loop)
        self._block(statements)
        self.loops.pop()
        self.given = before
        return loop

    def leave_loop(self, _: ast.Break) -> None:
        self.loops[-1].left = True
        self._goto(self.loops[-1].after)

    def next_turn(self, _: ast.Continue) -> None:
        self._goto(self.loops[-1].again)

    # Expressions.

    def _value(self, e: ast.expr) -> _Value:
        does = _EXPRESSIONS.get(type(e))
        if does is None:
            raise self._refusal(e, f"kernels have no `{_first_line(e)}`")
        value = does(self, e)
        if value.kind is Kind.NONE:
            raise self._refusal(e, f"`{ast.unparse(e)}` has no value")
        return value

    def constant(self, e: ast.Constant) -> _Value:
        return self._number(e, e.value)

    def _number(self, node: ast.AST, value: Any) -> _Value:
        if isinstance(value, bool):
            return _Value(Kind.BOOL, "true" if value else "false")
        if isinstance(value, int):
            if not -(2**63) <= value < 2**63:
                raise self._refusal(node, f"{value} has more than 64 bits")
            return _Value(Kind.INT, str(int(value)), literal=abs(value) <= 2**53)
        if isinstance(value, float):
            return _Value(Kind.FLOAT, number(value))
        raise self._refusal(node, f"{value!r} is no number")

    def name(self, e: ast.Name) -> _Value:
        if e.id not in self._local and e.id not in self.signature.names:
            return self._number(e, self._meaning(e))
        if e.id not in self.given:
            raise self._refusal(e, f"{e.id} may have no value here; give it one before")
        kind = self.kinds[e.id]
        text = self._new(f"load {kind.ir}, ptr %{e.id}.slot")
        return _Value(kind, text, record=self.signature.records.get(e.id))

    def _meaning(self, e: ast.expr) -> Any:
        """What a name, or a name in a module or in a class, is outside of this function."""
        if isinstance(e, ast.Name) and e.id not in self._local | {*self.signature.names}:
            try:
                return self.source.meaning(e.id)
            except KeyError:
                raise self._refusal(e, f"there is no {e.id}") from None
        if isinstance(e, ast.Attribute):
            found = getattr(self._meaning(e.value), e.attr, None)
            if found is not None:
                return found
        raise self._refusal(e, f"kernels do not know `{ast.unparse(e)}`")

    def attribute(self, e: ast.Attribute) -> _Value:
        record = self._record(e.value)
        if record is None:
            return self._number(e, self._meaning(e))
        value = self._loaded(*self._place(e))
        return replace(value, record=record.records.get(e.attr))

    def _record(self, e: ast.expr) -> type[Record] | None:
        """The class of a record's name, or of a record in a record."""
        if isinstance(e, ast.Name):
            return self.signature.records.get(e.id)
        outer = self._record(e.value) if isinstance(e, ast.Attribute) else None
        return outer.records.get(e.attr) if outer and isinstance(e, ast.Attribute) else None

    def _loaded(self, kind: Kind, stored: str, place: str) -> _Value:
        text = self._new(f"load {stored}, ptr {place}")
        return _Value(kind, self._new(f"sext i32 {text} to i64") if stored == "i32" else text)

    def _place(self, e: ast.expr) -> tuple[Kind, str, str]:
        """Kind, type in memory and place of `v[i]` or of a record's field."""
        if isinstance(e, ast.Subscript):
            base = self._value(e.value)
            if base.kind not in ELEMENTS or isinstance(e.slice, ast.Slice):
                raise self._refusal(e, f"`{ast.unparse(e)}` is no number of a vector")
            kind, stored = ELEMENTS[base.kind]
            index = self._index(e.slice)
            return kind, stored, self._new(f"getelementptr {stored}, ptr {base.text}, i64 {index}")
        assert isinstance(e, ast.Attribute)
        base = self._value(e.value)
        if base.record is None or e.attr not in base.record.fields:
            raise self._refusal(e, f"`{ast.unparse(e)}` is no field of a record")
        kind = base.record.fields[e.attr]
        # All fields are 8 bytes: i64, double or an address.
        index = str(list(base.record.fields).index(e.attr))
        return kind, kind.ir, self._new(f"getelementptr i64, ptr {base.text}, i64 {index}")

    def _index(self, e: ast.expr) -> str:
        index = self._value(e)
        if index.kind is not Kind.INT:
            raise self._refusal(e, f"an index is an int, and this is {index.kind}")
        if index.text.startswith("-"):
            raise self._refusal(
                e, "Python counts negative indices from the end; write the index itself"
            )
        return index.text

    def part(self, e: ast.Subscript) -> _Value:
        if not isinstance(e.slice, ast.Slice):
            return self._loaded(*self._place(e))
        base = self._value(e.value)
        if base.kind not in ELEMENTS or e.slice.upper or e.slice.step or e.slice.lower is None:
            raise self._refusal(e, "the part of a vector is its rest, `v[k:]`")
        start = self._index(e.slice.lower)
        stored = ELEMENTS[base.kind][1]
        return _Value(base.kind, self._new(f"getelementptr {stored}, ptr {base.text}, i64 {start}"))

    def two(self, e: ast.BinOp) -> _Value:
        return self._arithmetic(e, e.op, self._value(e.left), self._value(e.right))

    def _arithmetic(self, node: ast.AST, op: ast.operator, x: _Value, y: _Value) -> _Value:
        x, y = self._alike(node, x, y)
        names = _ARITHMETIC if x.kind is Kind.FLOAT else _WHOLE
        if type(op) in names:
            text = self._new(f"{names[type(op)]} {x.kind.ir} {x.text}, {y.text}")
            return _Value(x.kind, text)
        if x.kind is Kind.INT and isinstance(op, ast.FloorDiv | ast.Mod):
            return self._floored(op, x, y)
        if isinstance(op, ast.Div):
            raise self._refusal(node, "the quotient of ints is a float; write float(a) / float(b)")
        if isinstance(op, ast.Pow):
            raise self._refusal(node, "a power is written out: x * x")
        raise self._refusal(node, f"kernels have no {type(op).__name__} of {x.kind.value}s")

    def _floored(self, op: ast.operator, x: _Value, y: _Value) -> _Value:
        """Python rounds the quotient down, where the processor cuts it."""
        rest = self._new(f"srem i64 {x.text}, {y.text}")
        crossed = self._new(f"icmp slt i64 {self._new(f'xor i64 {rest}, {y.text}')}, 0")
        down = self._new(f"and i1 {crossed}, {self._new(f'icmp ne i64 {rest}, 0')}")
        if isinstance(op, ast.Mod):
            more = self._new(f"select i1 {down}, i64 {y.text}, i64 0")
            return _Value(Kind.INT, self._new(f"add i64 {rest}, {more}"))
        less = self._new(f"zext i1 {down} to i64")
        cut = self._new(f"sdiv i64 {x.text}, {y.text}")
        return _Value(Kind.INT, self._new(f"sub i64 {cut}, {less}"))

    def _alike(self, node: ast.AST, x: _Value, y: _Value) -> tuple[_Value, _Value]:
        """Both as floats if one is."""
        for value in (x, y):
            if value.kind not in (Kind.INT, Kind.FLOAT):
                raise self._refusal(
                    node, f"{value.kind} is no number; write int(...) for 0 or 1 of a bool"
                )
        if x.kind is not y.kind:
            return self._as_float(x), self._as_float(y)
        return x, y

    def _as_float(self, value: _Value) -> _Value:
        if value.kind is Kind.FLOAT:
            return value
        how = "uitofp" if value.kind is Kind.BOOL else "sitofp"
        return _Value(Kind.FLOAT, self._new(f"{how} {value.kind.ir} {value.text} to double"))

    def one(self, e: ast.UnaryOp) -> _Value:
        if isinstance(e.op, ast.Not):
            return _Value(Kind.BOOL, self._new(f"xor i1 {self._truth(e.operand)}, true"))
        written = e.operand.value if isinstance(e.operand, ast.Constant) else None
        if isinstance(e.op, ast.USub) and isinstance(written, int | float):
            return self._number(e, -written)
        x = self._value(e.operand)
        if isinstance(e.op, ast.USub) and x.kind is Kind.FLOAT:
            return _Value(Kind.FLOAT, self._new(f"fneg double {x.text}"))
        if isinstance(e.op, ast.USub) and x.kind is Kind.INT:
            return _Value(Kind.INT, self._new(f"sub i64 0, {x.text}"))
        raise self._refusal(e, f"kernels have no `{ast.unparse(e)}` of {x.kind}")

    def compare(self, e: ast.Compare) -> _Value:
        if len(e.ops) > 1:
            raise self._refusal(e, "comparisons are not chained; write `a < b and b < c`")
        op = type(e.ops[0])
        if op not in _COMPARED:
            raise self._refusal(e, f"kernels have no `{ast.unparse(e)}`")
        x, y = self._value(e.left), self._value(e.comparators[0])
        if x.kind is y.kind is Kind.BOOL and op in (ast.Eq, ast.NotEq):
            return self._compared(op, x, y)
        if {x.kind, y.kind} == {Kind.INT, Kind.FLOAT}:
            whole = x if x.kind is Kind.INT else y
            if not whole.literal:
                raise self._refusal(
                    e, "Python compares an int and a float exactly; write float(...)"
                )
        return self._compared(op, *self._alike(e, x, y))

    def _compared(self, op: type[ast.cmpop], x: _Value, y: _Value) -> _Value:
        floats, whole = _COMPARED[op]
        how = f"fcmp {floats}" if x.kind is Kind.FLOAT else f"icmp {whole}"
        return _Value(Kind.BOOL, self._new(f"{how} {x.kind.ir} {x.text}, {y.text}"))

    # Choices: the second part is evaluated only where it is needed.

    def _truth(self, e: ast.expr) -> str:
        """Whether a number is not zero."""
        if isinstance(e, ast.BoolOp):
            return self._joined(e, self._truth)
        return self._nonzero(e, self._value(e))

    def _nonzero(self, e: ast.expr, value: _Value) -> str:
        if value.kind is Kind.BOOL:
            return value.text
        if value.kind is Kind.INT:
            return self._new(f"icmp ne i64 {value.text}, 0")
        if value.kind is Kind.FLOAT:
            return self._new(f"fcmp une double {value.text}, {number(0.0)}")
        raise self._refusal(
            e, f"`{ast.unparse(e)}` is {value.kind}, which is neither true nor false"
        )

    def _fork(self, test: ast.expr, then: str, other: str) -> None:
        self._leave(f"br i1 {self._truth(test)}, label %{then}, label %{other}")

    def both_or_either(self, e: ast.BoolOp) -> _Value:
        def certain(part: ast.expr) -> str:
            value = self._value(part)
            if value.kind is not Kind.BOOL:
                raise self._refusal(
                    e, "outside of a test, `and` and `or` join bools; write `n != 0`"
                )
            return value.text

        return _Value(Kind.BOOL, self._joined(e, certain))

    def _joined(self, e: ast.BoolOp, truth: Callable[[ast.expr], str]) -> str:
        short = "false" if isinstance(e.op, ast.And) else "true"
        (after,) = self._labels("joined")
        ways = []
        for part in e.values[:-1]:
            (further,) = self._labels("further")
            true, false = (further, after) if short == "false" else (after, further)
            self._leave(f"br i1 {truth(part)}, label %{true}, label %{false}")
            ways.append(f"[ {short}, %{self.label} ]")
            self._at(further)
        last = truth(e.values[-1])
        ways.append(f"[ {last}, %{self.label} ]")
        self._goto(after)
        self._at(after)
        return self._new(f"phi i1 {', '.join(ways)}")

    def either(self, e: ast.IfExp) -> _Value:
        then, other, after = self._labels("then", "else", "chosen")
        self._fork(e.test, then, other)
        ways = []
        for label, part in ((then, e.body), (other, e.orelse)):
            self._at(label)
            value = self._value(part)
            ways.append((value, self.label))
            self._goto(after)
        self._at(after)
        (x, _), (y, _) = ways
        if x.kind is not y.kind or x.kind is Kind.RECORD:
            raise self._refusal(e, f"one part is {x.kind}, the other {y.kind}")
        came = ", ".join(f"[ {value.text}, %{label} ]" for value, label in ways)
        return _Value(x.kind, self._new(f"phi {x.kind.ir} {came}"))

    # Calls.

    def _called(self, e: ast.Call) -> _Value:
        if e.keywords or any(isinstance(x, ast.Starred) for x in e.args):
            raise self._refusal(e, "arguments are given by their places")
        meant = self._meaning(e.func)
        arguments = [self._value(x) for x in e.args]
        if meant is call:
            return self._outside(e, arguments)
        if isinstance(meant, FunctionType):
            return self._inside(e, meant, arguments)
        does = _CALLED.get(meant)
        if does is None:
            raise self._refusal(e, f"kernels do not call `{ast.unparse(e.func)}`")
        return does(self, e, arguments)

    def _inside(self, e: ast.Call, function: FunctionType, given: list[_Value]) -> _Value:
        """Calls another function of the kernel."""
        signature = self.unit.add(function)
        if len(given) != len(signature.parameters):
            raise self._refusal(
                e, f"{function.__name__} takes {len(signature.parameters)} arguments"
            )
        for name, kind, value in zip(signature.names, signature.parameters, given, strict=True):
            if value.kind is not kind or value.record is not signature.records.get(name):
                raise self._refusal(e, f"{name} of {function.__name__} is {kind}, not {value.kind}")
        return self._result(signature.result, f'@"{signature.symbol}"', given)

    def _outside(self, e: ast.Call, given: list[_Value]) -> _Value:
        """Calls a native function by address."""
        if not given or given[0].kind is not Kind.INT:
            raise self._refusal(e, "call(address, ...) takes an address, which is an int")
        if any(value.kind is Kind.BOOL for value in given):
            raise self._refusal(
                e, "native functions take ints, floats, vectors and records; write int(...)"
            )
        place = self._new(f"inttoptr i64 {given[0].text} to ptr")
        return self._result(Kind.NONE, place, given[1:])

    def _result(self, kind: Kind, place: str, given: list[_Value]) -> _Value:
        passed = ", ".join(f"{value.kind.passed} {value.text}" for value in given)
        line = f"call {kind.returned} {place}({passed})"
        if kind is Kind.NONE:
            self.lines.append(line)
            return _Value(kind, "")
        return _Value(kind, self._new(line))

    def exactly(self, e: ast.Call, given: list[_Value], count: int) -> list[_Value]:
        """As many floats, ints among them made floats."""
        if len(given) != count:
            raise self._refusal(e, f"`{ast.unparse(e.func)}` takes {count} here")
        if any(value.kind not in (Kind.INT, Kind.FLOAT) for value in given):
            raise self._refusal(e, f"`{ast.unparse(e.func)}` takes numbers")
        return [self._as_float(value) for value in given]

    def own(self, name: str, *given: _Value) -> str:
        """A function of LLVM that is exact."""
        kinds = ", ".join(["double"] * len(given))
        self.unit.declared.add(f"declare double @llvm.{name}.f64({kinds})")
        arguments = ", ".join(f"double {value.text}" for value in given)
        return self._new(f"call double @llvm.{name}.f64({arguments})")

    def to_int(self, e: ast.Call, given: list[_Value]) -> _Value:
        """int(x): cut towards zero."""
        if len(given) != 1 or given[0].kind not in (Kind.INT, Kind.FLOAT, Kind.BOOL):
            raise self._refusal(e, "int(...) takes one number")
        (x,) = given
        if x.kind is Kind.INT:
            return x
        how = "fptosi double" if x.kind is Kind.FLOAT else "zext i1"
        return _Value(Kind.INT, self._new(f"{how} {x.text} to i64"))

    def to_float(self, e: ast.Call, given: list[_Value]) -> _Value:
        if len(given) != 1 or given[0].kind not in (Kind.INT, Kind.FLOAT, Kind.BOOL):
            raise self._refusal(e, "float(...) takes one number")
        return self._as_float(given[0])

    def size(self, e: ast.Call, given: list[_Value]) -> _Value:
        if len(given) == 1 and given[0].kind is Kind.INT:
            x = given[0].text
            less = self._new(f"icmp slt i64 {x}, 0")
            minus = self._new(f"sub i64 0, {x}")
            return _Value(Kind.INT, self._new(f"select i1 {less}, i64 {minus}, i64 {x}"))
        return _Value(Kind.FLOAT, self.own("fabs", *self.exactly(e, given, 1)))

    def extreme(self, e: ast.Call, given: list[_Value], op: type[ast.cmpop]) -> _Value:
        """Python keeps the first but where a later one is beyond it."""
        kinds = {value.kind for value in given}
        if len(given) < 2 or len(kinds) > 1 or not kinds <= {Kind.INT, Kind.FLOAT}:
            raise self._refusal(
                e, f"`{ast.unparse(e.func)}` takes ints, or floats, and at least two"
            )
        best = given[0]
        for value in given[1:]:
            beyond = self._compared(op, value, best).text
            kind = value.kind.ir
            text = self._new(f"select i1 {beyond}, {kind} {value.text}, {kind} {best.text}")
            best = _Value(value.kind, text)
        return best

    def exact(self, e: ast.Call, given: list[_Value], name: str, count: int = 1) -> _Value:
        return _Value(Kind.FLOAT, self.own(name, *self.exactly(e, given, count)))

    def rounded(self, e: ast.Call, given: list[_Value], name: str) -> _Value:
        return self.to_int(e, [self.exact(e, given, name)])

    def classified(self, e: ast.Call, given: list[_Value], condition: str) -> _Value:
        """Compares the size with infinity."""
        size = self.own("fabs", *self.exactly(e, given, 1))
        return _Value(Kind.BOOL, self._new(f"fcmp {condition} double {size}, {number(math.inf)}"))

    def of_libm(self, e: ast.Call, given: list[_Value], name: str) -> _Value:
        operands = self.exactly(e, given, 1 if name in libm.UNARY else 2)
        self.unit.declared.add(libm.declaration(name))
        return self._result(Kind.FLOAT, libm.symbol(name), operands)


def _stored(node: ast.AST) -> list[str]:
    """The name that a node gives a value."""
    return [node.id] if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else []


def _first_line(node: ast.AST) -> str:
    return ast.unparse(node).split("\n")[0]


_ARITHMETIC: dict[type[ast.operator], str] = {
    ast.Add: "fadd",
    ast.Sub: "fsub",
    ast.Mult: "fmul",
    ast.Div: "fdiv",
}
_WHOLE: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.BitAnd: "and",
    ast.BitOr: "or",
    ast.BitXor: "xor",
    ast.LShift: "shl",
    ast.RShift: "ashr",
}
# Of floats, for which NaN is unequal to everything, and of ints.
_COMPARED: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("olt", "slt"),
    ast.LtE: ("ole", "sle"),
    ast.Gt: ("ogt", "sgt"),
    ast.GtE: ("oge", "sge"),
    ast.Eq: ("oeq", "eq"),
    ast.NotEq: ("une", "ne"),
}
_STATEMENTS: dict[type[ast.stmt], Callable[[_Body, Any], None]] = {
    ast.Expr: _Body.expression,
    ast.Pass: _Body.nothing,
    ast.Assign: _Body.assign,
    ast.AnnAssign: _Body.declare,
    ast.AugAssign: _Body.change,
    ast.Return: _Body.give_back,
    ast.If: _Body.choose,
    ast.While: _Body.repeat,
    ast.For: _Body.count_up,
    ast.Break: _Body.leave_loop,
    ast.Continue: _Body.next_turn,
}
_EXPRESSIONS: dict[type[ast.expr], Callable[[_Body, Any], _Value]] = {
    ast.Constant: _Body.constant,
    ast.Name: _Body.name,
    ast.Attribute: _Body.attribute,
    ast.Subscript: _Body.part,
    ast.BinOp: _Body.two,
    ast.UnaryOp: _Body.one,
    ast.Compare: _Body.compare,
    ast.BoolOp: _Body.both_or_either,
    ast.IfExp: _Body.either,
    ast.Call: _Body._called,
}
_Call = Callable[[_Body, ast.Call, list[_Value]], _Value]


def _of_libm(name: str) -> _Call:
    return lambda body, e, given: body.of_libm(e, given, name)


# CPython passes these on to libm as they are, but for errors, which it raises.
_LIBM = ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "atan2")
_CALLED: dict[Any, _Call] = {
    int: _Body.to_int,
    float: _Body.to_float,
    abs: _Body.size,
    max: lambda body, e, given: body.extreme(e, given, ast.Gt),
    min: lambda body, e, given: body.extreme(e, given, ast.Lt),
    math.sqrt: lambda body, e, given: body.exact(e, given, "sqrt"),
    math.fabs: lambda body, e, given: body.exact(e, given, "fabs"),
    math.copysign: lambda body, e, given: body.exact(e, given, "copysign", 2),
    math.floor: lambda body, e, given: body.rounded(e, given, "floor"),
    math.ceil: lambda body, e, given: body.rounded(e, given, "ceil"),
    math.isfinite: lambda body, e, given: body.classified(e, given, "olt"),
    math.isinf: lambda body, e, given: body.classified(e, given, "oeq"),
    math.isnan: lambda body, e, given: body.classified(e, given, "uno"),
    **{getattr(math, name): _of_libm(name) for name in _LIBM},
}
