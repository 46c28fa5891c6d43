"""Long columns in files that are mapped into memory, so that a long run needs no more of it.

The files have no name: they are gone with the process, however that ends. They lie in TMPDIR, else
in /var/tmp, which is on a disk where /tmp may not be. Without room there, columns stay in memory.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Rows of a log that are in memory before they go to a file.
SPILL_ROWS = 1 << 15
#: Arrays of more bytes than this go to a file.
LARGE = 1 << 20
#: Rows that a file has room for at first; the room is made of holes.
_ROOM = 1 << 20
_CHUNK = 1 << 22
_ELSEWHERE = Path("/var/tmp")


def _file() -> int:
    """A file without a name, open to be written and mapped.

    Raises:
        OSError: it cannot be made.
    """
    folder = os.environ.get("TMPDIR")
    if not folder and os.access(_ELSEWHERE, os.W_OK):
        folder = str(_ELSEWHERE)
    with tempfile.TemporaryFile(dir=folder or None) as file:
        return os.dup(file.fileno())


def gathered(parts: Iterable[NDArray[Any]], rows: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Parts (n,) one after the other, in a file; in memory where there is no room for one.

    Args:
        parts: of any length, made one by one.
        rows: of all of them.
        dtype: of each.
    """
    parts = iter(parts)
    try:
        descriptor = _file()
    except OSError:
        return np.concatenate([*parts])
    done: list[NDArray[Any]] = []
    at = 0
    try:
        for part in parts:
            done = [part]
            _write(descriptor, part, at)
            at, done = at + part.nbytes, []
        memory = mmap.mmap(descriptor, rows * dtype.itemsize, access=mmap.ACCESS_READ)
        return np.frombuffer(memory, dtype=dtype)
    except OSError:
        held = np.frombuffer(os.pread(descriptor, at, 0), dtype=dtype)
        return np.concatenate([held, *done, *parts])
    finally:
        os.close(descriptor)


def _write(descriptor: int, content: NDArray[Any], at: int) -> None:
    rest = memoryview(np.ascontiguousarray(content).view(np.uint8).reshape(-1).data)
    while len(rest):
        done = os.pwrite(descriptor, rest[:_CHUNK], at)
        rest, at = rest[done:], at + done


def mapped(values: NDArray[Any]) -> NDArray[Any]:
    """The same values, in a file if they are many; they are not to be written then.

    Args:
        values: of any shape.
    """
    if values.nbytes <= LARGE or not values.flags.writeable:
        return values
    try:
        descriptor = _file()
    except OSError:
        return values
    try:
        _write(descriptor, values, 0)
        memory = mmap.mmap(descriptor, values.nbytes, access=mmap.ACCESS_READ)
    except (OSError, ValueError):
        return values
    finally:
        os.close(descriptor)
    return np.frombuffer(memory, dtype=values.dtype).reshape(values.shape)


class ColumnFile:
    """Columns of numbers that grow together, each in one piece of a file."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """Makes the file.

        Raises:
            OSError: it cannot be made.
        """
        self._names, self._rows, self._room = names, 0, _ROOM
        self._descriptor = _file()

    def append(self, columns: Mapping[str, NDArray[np.float64]]) -> None:
        """Puts some rows behind those that there are; all of them or none count.

        Raises:
            OSError: there is no room.
        """
        more = len(next(iter(columns.values())))
        while self._rows + more > self._room:
            self._widen()
        for number, name in enumerate(self._names):
            _write(self._descriptor, columns[name], 8 * (number * self._room + self._rows))
        self._rows += more

    def _widen(self) -> None:
        """Gives every column four times the room."""
        wider, room = _file(), 4 * self._room
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
        os.close(self._descriptor)
        self._descriptor = -1
        return {
            name: np.frombuffer(memory, np.float64, self._rows, 8 * number * self._room)
            for number, name in enumerate(self._names)
        }
