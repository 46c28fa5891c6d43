"""A small part of Python for loops over numbers that a tick cannot wait for Python to do.

`kernel_ir` makes LLVM IR of it, `kernel_c` C.

A kernel is functions with annotations `int`, `float`, `bool`, `Vector`, `Counts`,
`Words`, or a `Record`:

- assignments, `if`, `for` over `range`, `while`, `break`, `continue`, `return`;
- arithmetic and comparison of numbers, `and`, `or`, `not`, `a if t else b`;
- `v[i]`, and `v[k:]` for the rest of a vector; fields of a record;
- calls of such functions, of `call`, and of a few of `math` and of Python's own.

The same source runs under Python, with the same bits, wherever it runs there without an exception,
with integers of 64 bits and vectors that are views of memory (`vector`). What would mean something
else is refused where it is compiled, with its place and with what to write instead. Values that
Python refuses as it goes are the author's to avoid: an index outside a vector, a division by zero,
the root of a negative number.
"""

from __future__ import annotations

import ast
import builtins
import ctypes
import enum
import inspect
import sys
from functools import cache
from types import FunctionType
from typing import TYPE_CHECKING, Any, ClassVar

from taskspec.deferred_methods import dataclass

if TYPE_CHECKING:
    Vector = memoryview[float]
    Counts = memoryview[int]
    Words = memoryview[int]
else:

    class Vector:
        """Doubles in memory: under Python a view of them, in machine code their address."""

    class Counts:
        """Integers of 32 bits in memory, as `Vector`."""

    class Words:
        """Integers of 64 bits in memory, as `Vector`."""


class KernelError(Exception):
    """A function is not in the part of Python that is compiled; says where, and what to write."""


def vector(array: Any) -> Any:
    """A view of an array of doubles or of integers, as kernels take vectors.

    Raises:
        TypeError: it holds other numbers, or does not lie in one piece.
    """
    view = memoryview(array)
    if _in_memory(view) is None or not view.c_contiguous:
        raise TypeError("a vector is doubles, or integers of 32 or 64 bits, in one piece of memory")
    if view.ndim == 1:
        return view
    whole: Any = view.cast("B") if view.nbytes else memoryview(bytearray())
    return whole.cast(view.format)


def _in_memory(view: memoryview[Any]) -> Kind | None:
    """What a view is a vector of; None for none."""
    # Memory of ctypes names its byte order, which is this machine's.
    written = view.format.removeprefix("<" if sys.byteorder == "little" else ">")
    if written == "d":
        return Kind.VECTOR
    if written in ("i", "l", "q"):
        return {4: Kind.COUNTS, 8: Kind.WORDS}[view.itemsize]
    return None


def address_of(view: Any) -> int:
    """Where the numbers of a vector lie."""
    import numpy as np

    return int(np.asarray(view).ctypes.data)


def call(address: int, *arguments: Any) -> None:
    """Calls a native function, of integers, doubles, vectors and records, by its address.

    What it returns is dropped. This is what `call` means under Python.
    """
    given: list[Any] = []
    for value in arguments:
        if isinstance(value, Record):
            given.append(ctypes.c_void_p(value.address))
        elif isinstance(value, memoryview):
            given.append(ctypes.c_void_p(address_of(value)))
        else:
            given.append((ctypes.c_double if isinstance(value, float) else ctypes.c_int64)(value))
    ctypes.CFUNCTYPE(None, *map(type, given))(address)(*given)


class Kind(enum.Enum):
    """What a value is."""

    INT = "int"
    FLOAT = "float"
    BOOL = "bool"
    VECTOR = "Vector"
    COUNTS = "Counts"
    WORDS = "Words"
    RECORD = "record"
    NONE = "None"

    @property
    def ir(self) -> str:
        """LLVM's type of it."""
        return _IR.get(self, "ptr")

    @property
    def passed(self) -> str:
        """LLVM's type of it as an argument; a bool fills its byte."""
        return "i1 zeroext" if self is Kind.BOOL else self.ir

    @property
    def returned(self) -> str:
        """LLVM's type of it as a result."""
        return "zeroext i1" if self is Kind.BOOL else self.ir

    def __str__(self) -> str:
        return "an int" if self is Kind.INT else f"a {self.value}"


_IR = {Kind.INT: "i64", Kind.FLOAT: "double", Kind.BOOL: "i1", Kind.NONE: "void"}
ELEMENTS = {
    Kind.VECTOR: (Kind.FLOAT, "double"),
    Kind.COUNTS: (Kind.INT, "i32"),
    Kind.WORDS: (Kind.INT, "i64"),
}
_FIELDS = {
    kind.value: kind for kind in (Kind.INT, Kind.FLOAT, Kind.VECTOR, Kind.COUNTS, Kind.WORDS)
}
_IN_C = {Kind.INT: ctypes.c_int64, Kind.FLOAT: ctypes.c_double}


class Record:
    """Base of a class of fields that kernels share with Python.

    A subclass annotates its fields, in the order in which they lie in memory: `int`, `float`,
    `Vector`, `Counts`, `Words`, or another record. Its instances hold numbers and views under
    Python, and `address` is where machine code has the same fields.
    """

    fields: ClassVar[dict[str, Kind]] = {}
    records: ClassVar[dict[str, type[Record]]] = {}
    _structure: type[ctypes.Structure]

    def __init_subclass__(cls) -> None:
        cls.fields, cls.records = dict(cls.fields), dict(cls.records)
        names = vars(sys.modules[cls.__module__])
        for name, annotation in cls.__annotations__.items():
            written = annotation if isinstance(annotation, str) else annotation.__name__
            if written.startswith("ClassVar"):
                continue
            inner = names.get(written)
            if isinstance(inner, type) and issubclass(inner, Record):
                cls.fields[name], cls.records[name] = Kind.RECORD, inner
                setattr(cls, name, _inner(name))
            elif written in _FIELDS:
                cls.fields[name] = _FIELDS[written]
                setattr(cls, name, _scalar(name) if _FIELDS[written] in _IR else _view(name))
            else:
                raise KernelError(
                    f"{cls.__name__}.{name} is {written}; "
                    f"a field is {', '.join(_FIELDS)}, or a record"
                )
        members = [(name, _IN_C.get(kind, ctypes.c_void_p)) for name, kind in cls.fields.items()]
        cls._structure = type(cls.__name__, (ctypes.Structure,), {"_fields_": members})

    def __init__(self, **values: Any) -> None:
        """Takes fields by name. Numbers left out are zero, vectors empty, records not there.

        Raises:
            TypeError: there is no such field, or it is given what it does not hold.
        """
        self._memory, self._held = self._structure(), dict[str, Any]()
        for name, value in values.items():
            if name not in self.fields:
                raise TypeError(f"{type(self).__name__} has no field {name}")
            setattr(self, name, value)

    def record(self, name: str) -> Record | None:
        """The record in a field; None where there is none."""
        return self._held.get(name)

    @property
    def address(self) -> int:
        """Where the fields lie, for as long as this object lives."""
        return ctypes.addressof(self._memory)


def _scalar(name: str) -> property:
    return property(
        lambda self: getattr(self._memory, name),
        lambda self, value: setattr(self._memory, name, value),
    )


def _view(name: str) -> property:
    def put(self: Record, array: Any) -> None:
        view = vector(array)
        if _in_memory(view) is not self.fields[name]:
            raise TypeError(f"{name} is {self.fields[name]}, not memory of {view.format!r}")
        self._held[name] = view
        setattr(self._memory, name, address_of(view))

    return property(lambda self: self._held.get(name, _EMPTY), put)


def _inner(name: str) -> property:
    def put(self: Record, record: Record) -> None:
        if not isinstance(record, self.records[name]):
            raise TypeError(f"{name} is a {self.records[name].__name__}, not {record!r}")
        self._held[name] = record
        setattr(self._memory, name, record.address)

    return property(lambda self: self._held[name], put)


_EMPTY = memoryview(b"")


@dataclass(frozen=True)
class Signature:
    """What a kernel function is called, takes and returns; `records` by parameter."""

    symbol: str
    names: tuple[str, ...]
    parameters: tuple[Kind, ...]
    records: dict[str, type[Record]]
    result: Kind


class KernelFunction:
    """A function as it is written, and what its names mean in its module."""

    def __init__(self, function: FunctionType) -> None:
        self.name, self._globals = function.__name__, function.__globals__
        self._path = function.__code__.co_filename
        first = function.__code__.co_firstlineno
        tree = _functions(function.__module__, self._path).get((self.name, first))
        if tree is None:
            raise KernelError(f"{self._path}:{first}: {self.name} is no plain function of a module")
        self.tree = tree
        if function.__closure__:
            raise self.refusal(tree, "it takes names from a function around it; pass them")

    def meaning(self, name: str) -> Any:
        """What a name is in the module, or in Python; a KeyError if nothing."""
        return self._globals[name] if name in self._globals else vars(builtins)[name]

    def refusal(self, node: ast.AST, reason: str) -> KernelError:
        """The error for a part of the function, with its place."""
        line = getattr(node, "lineno", self.tree.lineno)
        return KernelError(f"{self._path}:{line}: in {self.name}: {reason}")


@cache
def _functions(module: str, path: str) -> dict[tuple[str, int], ast.FunctionDef]:
    """The functions of a module, by name and line."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError, KeyError):
        raise KernelError(f"{path}: there is no source of {module}") from None
    found = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    return {(node.name, node.lineno): node for node in found if not node.decorator_list}


def signature_of(source: KernelFunction, symbol: str) -> Signature:
    """The signature by the annotations; a KernelError where kernels have none such."""
    tree = source.tree
    a = tree.args
    if a.posonlyargs or a.kwonlyargs or a.vararg or a.kwarg or a.defaults:
        raise source.refusal(tree, "parameters are plain names without defaults")
    records: dict[str, type[Record]] = {}
    kinds = []
    for parameter in a.args:
        kind = annotated(source, parameter, parameter.annotation)
        if isinstance(kind, type):
            records[parameter.arg] = kind
        kinds.append(Kind.RECORD if isinstance(kind, type) else kind)
    result = annotated(source, tree, tree.returns)
    if isinstance(result, type) or result in ELEMENTS:
        raise source.refusal(tree, "a function returns a number or nothing; write into a vector")
    names = tuple(parameter.arg for parameter in a.args)
    return Signature(symbol, names, tuple(kinds), records, result)


def annotated(
    source: KernelFunction, node: ast.AST, annotation: ast.expr | None
) -> Kind | type[Record]:
    """The kind of a parameter or result, or the class of a record."""
    kinds: dict[Any, Kind] = {int: Kind.INT, float: Kind.FLOAT, bool: Kind.BOOL}
    kinds |= {Vector: Kind.VECTOR, Counts: Kind.COUNTS, Words: Kind.WORDS}
    if isinstance(annotation, ast.Constant) and annotation.value is None:
        return Kind.NONE
    if isinstance(annotation, ast.Name):
        meant = source.meaning(annotation.id)
        if isinstance(meant, type) and issubclass(meant, Record):
            return meant
        kind = kinds.get(meant)
        if kind is not None:
            return kind
    raise source.refusal(
        node, "annotations are int, float, bool, Vector, Counts, Words, a Record, or -> None"
    )
