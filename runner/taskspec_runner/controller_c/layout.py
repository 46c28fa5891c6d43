"""Where the memory of a controller lies in C: in one instance of a structure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.native.kernel import Kind, Record
from taskspec.native.kernel_c import number, record_name
from taskspec.program.evaluation import Evaluation

#: Kinds of vectors: what the instance calls the block that they lie in, and their type in it.
_BLOCKS = {
    Kind.VECTOR: ("numbers", np.float64, "double"),
    Kind.WORDS: ("words", np.int64, "int64_t"),
    Kind.COUNTS: ("counts", np.int32, "int32_t"),
}
#: What an evaluation is in C: the number of its function, its arguments and its results.
_EVALUATION_FIELDS = 3


@dataclass(frozen=True)
class _Span:
    """Memory of a run that becomes part of a block: its addresses, and where it is there."""

    first: int
    end: int
    place: int


class _Block:
    """Arrays of one kind, laid one after the other; those that overlap share their place.

    Attributes:
        name: in the instance; type: of its numbers in C.
        values: (size,) the first numbers.
    """

    def __init__(self, kind: Kind, arrays: Sequence[NDArray[Any]]) -> None:
        """Lays the arrays, each in one piece."""
        self.name, self._dtype, self.type = _BLOCKS[kind]
        sized = [a for a in arrays if a.size]
        merged: list[list[int]] = []
        for first, end in sorted((a.ctypes.data, a.ctypes.data + a.nbytes) for a in sized):
            if merged and first < merged[-1][1]:
                merged[-1][1] = max(merged[-1][1], end)
            else:
                merged.append([first, end])
        # By their first mention, so that the same task has the same layout wherever it lies.
        spans, size = list[_Span](), 0
        item = np.dtype(self._dtype).itemsize
        for array in sized:
            if not any(s.first <= array.ctypes.data < s.end for s in spans):
                first, end = next(m for m in merged if m[0] <= array.ctypes.data < m[1])
                spans.append(_Span(first, end, size))
                size += (end - first) // item
        self._spans = spans
        self.values = np.zeros(size, self._dtype)
        for array in sized:
            at = self.place(array)
            self.values[at : at + array.size] = array.reshape(-1)

    def place(self, array: NDArray[Any]) -> int:
        """Where an array begins; 0 for an empty one."""
        if not array.size:
            return 0
        address = array.ctypes.data
        span = next(s for s in self._spans if s.first <= address < s.end)
        return span.place + (address - span.first) // array.itemsize


class Layout:
    """The records of a controller and all that they have addresses of.

    Attributes:
        records: of each class in C: its records, in the order in which the instance has them.
        functions: of CasADi, each once, by their number from 1 on.
        blocks: of the arrays, by kind.
        arguments, results: places in `numbers` of what functions read and write, one after the
            other.
    """

    def __init__(self, roots: Sequence[Record]) -> None:
        """For records and those within them."""
        self.records: dict[str, list[Record]] = {}
        self.functions: dict[str, tuple[int, ca.Function]] = {}
        self._numbers: dict[int, int] = {}
        self._arrays: dict[Kind, list[NDArray[Any]]] = {kind: [] for kind in _BLOCKS}
        for root in roots:
            self._collect(root)
        self.blocks = {kind: _Block(kind, arrays) for kind, arrays in self._arrays.items()}
        self.arguments, self.results = list[int](), list[int]()
        calls = [e for e in self.records.get("Evaluation", ()) if isinstance(e, Evaluation)]
        self._calls = {id(e): self._call(e) for e in calls}

    def _collect(self, record: Record) -> None:
        of_class = self.records.setdefault(type(record).__name__, [])
        if id(record) in self._numbers:
            return
        if isinstance(record, Evaluation) and record.bound is None:
            return
        self._numbers[id(record)] = len(of_class)
        of_class.append(record)
        if isinstance(record, Evaluation):
            assert record.bound is not None
            key = record.bound.function.serialize()
            self.functions.setdefault(key, (len(self.functions) + 1, record.bound.function))
            for arrays in record.arrays:
                self._arrays[Kind.VECTOR] += arrays
            return
        for name, kind in record.fields.items():
            if kind is Kind.RECORD:
                inner = record.record(name)
                if inner is not None:
                    self._collect(inner)
            elif kind in _BLOCKS:
                self._arrays[kind].append(np.asarray(getattr(record, name)))

    def _call(self, evaluation: Evaluation) -> tuple[int, int, int]:
        """Number of the function, and where its arguments and results begin among all."""
        assert evaluation.bound is not None
        number_of, _ = self.functions[evaluation.bound.function.serialize()]
        block, first = self.blocks[Kind.VECTOR], (len(self.arguments), len(self.results))
        given, found = evaluation.arrays
        self.arguments += [block.place(array) for array in given]
        self.results += [block.place(array) for array in found]
        return number_of, *first

    def members(self) -> list[str]:
        """The members of the instance."""
        blocks = [f"{b.type} {b.name}[{max(len(b.values), 1)}]" for b in self.blocks.values()]
        records = [
            f"struct {name} {name.lower()}[{len(records)}]"
            for name, records in self.records.items()
            if records
        ]
        return [
            *blocks,
            f"const double *arguments[{max(len(self.arguments), 1)}]",
            f"double *results[{max(len(self.results), 1)}]",
            *records,
        ]

    @property
    def size(self) -> int:
        """Bytes of the members, where no pointer and no integer has more than eight."""
        blocks = sum(-(-max(b.values.nbytes, 8) // 8) * 8 for b in self.blocks.values())
        pointers = max(len(self.arguments), 1) + max(len(self.results), 1)
        fields = sum(
            _EVALUATION_FIELDS if isinstance(record, Evaluation) else len(record.fields)
            for records in self.records.values()
            for record in records
        )
        return blocks + 8 * (pointers + fields)

    def place_of(self, record: Record) -> str:
        """A record in the instance `m`."""
        name = type(record).__name__
        return f"&m->{name.lower()}[{self._numbers[id(record)]}]"

    def filling(self) -> list[str]:
        """Statements that give the records of the instance `m` their fields."""
        lines = []
        for name, records in self.records.items():
            for i, record in enumerate(records):
                at = f"m->{name.lower()}[{i}]"
                if isinstance(record, Evaluation):
                    code, given, found = self._calls[id(record)]
                    lines += [
                        f"{at}.code = {code};",
                        f"{at}.arguments = m->arguments + {given};",
                        f"{at}.results = m->results + {found};",
                    ]
                else:
                    lines += [f"{at}.{field} = {value};" for field, value in self._fields(record)]
        return lines

    def _fields(self, record: Record) -> list[tuple[str, str]]:
        found = []
        for name, kind in record.fields.items():
            if kind is Kind.RECORD:
                inner = record.record(name)
                if inner is not None and id(inner) in self._numbers:
                    found.append((name, self.place_of(inner)))
                elif record.records[name] is Evaluation:
                    found.append((name, "&m->nothing"))
                continue
            value = getattr(record, name)
            if kind in _BLOCKS:
                array, block = np.asarray(value), self.blocks[kind]
                if array.size:
                    found.append((name, f"m->{block.name} + {block.place(array)}"))
            elif value:
                found.append((name, number(value) if kind is Kind.FLOAT else str(int(value))))
        return found


def structure_names(layout: Layout) -> list[str]:
    """What C calls the records of a layout."""
    return [record_name(type(records[0])) for records in layout.records.values() if records]
