"""The columns of a long run, and other arrays that grow, in files that are mapped into memory."""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.record.file_array import PAGES, FileArray, empty, unnamed_file

#: Rows of a log that are in memory before they go to a file.
SPILL_ROWS = 1 << 15
#: Rows that a file has room for at first; the room is made of holes.
_FIRST_CAPACITY = 1 << 20
_CHUNK = 1 << 22


def gathered(parts: Iterable[NDArray[Any]], rows: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Parts (n,) one after the other, in a file if they are many; not to be written.

    Args:
        parts: of any length, made one by one.
        rows: of all of them.
        dtype: of each.
    """
    made, at = empty(rows, dtype), 0
    for part in parts:
        made[at : at + len(part)] = part
        at += len(part)
    made.flags.writeable = False
    return made


def _write(descriptor: int, content: NDArray[Any], at: int) -> None:
    rest = memoryview(np.ascontiguousarray(content).view(np.uint8).reshape(-1).data)
    while len(rest):
        done = os.pwrite(descriptor, rest[:_CHUNK], at)
        rest, at = rest[done:], at + done


class KeptArrays:
    """Arrays that are put away one by one, in one file, and read when they are needed."""

    def __init__(self) -> None:
        self._descriptor: int | None = None
        self._size, self._room = 0, True

    def __del__(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)

    def put(self, values: NDArray[Any]) -> Callable[[], NDArray[Any]]:
        """What gives an array (n,) again; where there is no room in a file, it stays in memory."""
        try:
            if self._room and self._descriptor is None:
                self._descriptor = unnamed_file()
            if self._room and self._descriptor is not None:
                _write(self._descriptor, values, self._size)
        except OSError:
            self._room = False
        if not self._room:
            return lambda: values
        at, size, dtype = self._size, values.nbytes, values.dtype
        self._size += size

        def read() -> NDArray[Any]:
            assert self._descriptor is not None
            return np.frombuffer(os.pread(self._descriptor, size, at), dtype)

        return read


class GrowingColumns:
    """Columns of numbers that grow together; those of many rows go to a file that is mapped."""

    def __init__(self) -> None:
        self._parts: dict[str, list[NDArray[np.float64]]] = {}
        self._waiting, self._spills = 0, True
        self._file: ColumnFile | None = None

    def add(self, columns: Mapping[str, NDArray[np.float64]]) -> None:
        """Takes some more rows (n,) of all columns, and keeps the arrays."""
        for name, values in columns.items():
            self._parts.setdefault(name, []).append(values)
        self._waiting += len(next(iter(columns.values()), ()))
        if self._spills and self._waiting >= SPILL_ROWS:
            self._spill()

    def _spill(self) -> None:
        """Brings the rows that wait to the file; where there is no room, they stay here."""
        try:
            if self._file is None:
                self._file = ColumnFile(tuple(self._parts))
            self._file.append(self._parts)
        except OSError:
            self._spills = False
            return
        self._waiting = 0
        for parts in self._parts.values():
            parts.clear()

    def build(self) -> dict[str, NDArray[np.float64]]:
        """All rows so far. It takes them out column by column, so that none is there twice."""
        if self._file is not None and self._spills and self._waiting:
            self._spill()
        kept = self._file.columns() if self._file is not None else {}
        columns = {}
        for name in [*self._parts]:
            parts = self._parts.pop(name)
            before = [kept[name]] if name in kept else []
            whole = before + parts
            columns[name] = whole[0] if len(whole) == 1 and before else np.concatenate(whole)
        return columns


class ColumnFile:
    """Columns of numbers that grow together, each in one piece of a file."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """Makes the file.

        Raises:
            OSError: it cannot be made.
        """
        self._names, self._rows, self._room = names, 0, _FIRST_CAPACITY
        self._descriptor = unnamed_file()

    def append(self, columns: Mapping[str, Sequence[NDArray[np.float64]]]) -> None:
        """Puts some rows behind those that there are; all of them or none count.

        Args:
            columns: parts (n,) of each, one after the other.

        Raises:
            OSError: there is no room.
        """
        more = sum(map(len, next(iter(columns.values()))))
        while self._rows + more > self._room:
            self._widen()
        for number, name in enumerate(self._names):
            at = 8 * (number * self._room + self._rows)
            for part in columns[name]:
                _write(self._descriptor, part, at)
                at += part.nbytes
        self._rows += more

    def _widen(self) -> None:
        """Gives every column four times the room."""
        wider, room = unnamed_file(), 4 * self._room
        try:
            for number in range(len(self._names)):
                done, size = 0, 8 * self._rows
                while done < size:
                    at = 8 * number * self._room + done
                    part = os.pread(self._descriptor, min(_CHUNK, size - done), at)
                    _write(wider, np.frombuffer(part, np.uint8), 8 * number * room + done)
                    done += len(part)
        except BaseException:
            os.close(wider)
            raise
        os.close(self._descriptor)
        self._descriptor, self._room = wider, room

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """(rows,) each column, not to be written; the file takes no more rows then."""
        size = 8 * ((len(self._names) - 1) * self._room + self._rows)
        memory = mmap.mmap(self._descriptor, size, access=mmap.ACCESS_READ)
        PAGES.add(memory)
        os.close(self._descriptor)
        self._descriptor = -1
        return {
            name: np.frombuffer(memory, np.float64, self._rows, 8 * number * self._room).view(
                FileArray
            )
            for number, name in enumerate(self._names)
        }
