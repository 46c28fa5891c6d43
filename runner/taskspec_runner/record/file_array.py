"""Arrays in files that are mapped into memory, so that a long run needs no more of it.

The files have no name: they are gone with the process, however that ends. They lie in TMPDIR, else
in /var/tmp, which is on a disk where /tmp may not be. Without room there, arrays stay in memory.

What is computed from such an array lies in a file too: operations tick by tick, running sums and
extremes, choices by a mask or by rows. The same loops run over the same values as in memory, so
every number is the same bit by bit.

Pages that were read stay mapped, and count as memory of the process, until they are unmapped: that
happens after every so many bytes of work. The system still has the file, and maps them again.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from weakref import WeakSet, finalize

import numpy as np
from numpy.typing import NDArray

#: Rows that are worked on at a time.
BLOCK_ROWS = 1 << 15
#: Arrays of more bytes than this go to a file.
LARGE = 1 << 20
#: Sizes of files, so that those of arrays of some rows more fit too [bytes].
_STEP = 1 << 20
#: What is kept of files that nobody uses [bytes].
_FREE = 1 << 26
#: Pages of so many bytes are worked on before all are unmapped.
_MAPPED = 1 << 25
_FALLBACK_FOLDER = Path("/var/tmp")


def unnamed_file() -> int:
    """A file without a name, open to be written and mapped.

    Raises:
        OSError: it cannot be made.
    """
    folder = os.environ.get("TMPDIR")
    if not folder and os.access(_FALLBACK_FOLDER, os.W_OK):
        folder = str(_FALLBACK_FOLDER)
    with tempfile.TemporaryFile(dir=folder or None) as file:
        return os.dup(file.fileno())


def blocks(rows: int) -> Iterator[slice]:
    """Slices that together are so many rows."""
    for first in range(0, rows, BLOCK_ROWS):
        yield slice(first, min(first + BLOCK_ROWS, rows))


def empty(shape: int | tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """An array to be written, in a file if it is large and there is room for one."""
    shape, dtype = (shape,) if isinstance(shape, int) else shape, np.dtype(dtype)
    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    if size <= LARGE:
        return np.empty(shape, dtype)
    memory = _ROOMS.take(size)
    if memory is None:
        return np.empty(shape, dtype)
    whole = np.frombuffer(memory, dtype, size // dtype.itemsize)
    # Views hold this array, so that nobody has the room any more when it is gone.
    finalize(whole, _ROOMS.give, memory, _ROOMS.forks).atexit = False
    return whole.reshape(shape).view(FileArray)


class _MappedPages:
    """The pages of files whose arrays are in use, which are unmapped from time to time."""

    def __init__(self) -> None:
        self._files: WeakSet[mmap.mmap] = WeakSet()
        self._lock, self._touched = threading.Lock(), 0

    def add(self, memory: mmap.mmap) -> None:
        """A file that is shared, so that what was written to its pages is in it."""
        with self._lock:
            self._files.add(memory)

    def remove(self, memory: mmap.mmap) -> None:
        """One whose array is gone: the next one finds its pages where they are."""
        with self._lock:
            self._files.discard(memory)

    def touch(self, arrays: Iterable[Any]) -> None:
        """Arrays that are worked on."""
        with self._lock:
            self._touched += sum(a.nbytes for a in arrays if isinstance(a, FileArray))
            if self._touched < _MAPPED or not hasattr(mmap.mmap, "madvise"):
                return
            self._touched = 0
            for memory in self._files:
                memory.madvise(mmap.MADV_DONTNEED)


PAGES = _MappedPages()


class _Rooms:
    """Files that are mapped; those of arrays that are gone are used again.

    The pages of a new file take twenty times as long as an operation that fills them.

    Attributes:
        forks: how often the process has forked. What was mapped before is shared with the other
            process, which may still read it.
    """

    def __init__(self) -> None:
        #: By their size. Each step on a list is one of the interpreter's, for several threads.
        self._free: dict[int, list[mmap.mmap]] = {}
        self.forks = 0

    def take(self, size: int) -> mmap.mmap | None:
        """Room for so many bytes, of any content; None where there is none."""
        memory = self._found(-(-size // _STEP) * _STEP)
        if memory is not None:
            PAGES.add(memory)
        return memory

    def _found(self, size: int) -> mmap.mmap | None:
        with suppress(KeyError, IndexError):
            # Last in, first out: its pages are still in memory.
            return self._free[size].pop()
        try:
            descriptor = unnamed_file()
        except OSError:
            return None
        try:
            # Room on the disk now: a mapped page that finds none later ends the process.
            os.posix_fallocate(descriptor, 0, size)
            return mmap.mmap(descriptor, size)
        except (OSError, ValueError):
            return None
        finally:
            os.close(descriptor)

    def give(self, memory: mmap.mmap, forks: int) -> None:
        """Takes back the room of an array that is gone."""
        PAGES.remove(memory)
        if forks == self.forks:
            self._free.setdefault(len(memory), []).append(memory)
            if sum(size * len(kept) for size, kept in [*self._free.items()]) > _FREE:
                for kept in [*self._free.values()]:
                    with suppress(IndexError):
                        del kept[0]

    def fork(self) -> None:
        """Lets go of all that the other process maps too."""
        self.forks += 1
        self._free.clear()


_ROOMS = _Rooms()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_ROOMS.fork)


def full(rows: int, value: float) -> NDArray[Any]:
    """(rows,) the same value, in a file if there are many."""
    made = empty(rows, np.asarray(value).dtype)
    made[...] = value
    return made


def counted(rows: int, first: int = 0) -> NDArray[np.int64]:
    """(rows,) numbers from `first` on, in a file if there are many."""
    made = empty(rows, np.int64)
    for part in blocks(rows):
        made[part] = np.arange(first + part.start, first + part.stop)
    return made


def in_file(values: NDArray[Any]) -> NDArray[Any]:
    """The same values (n, ...), in a file if they are many; they are not to be written then."""
    if values.nbytes <= LARGE or isinstance(values, FileArray):
        return values
    made = empty(values.shape, values.dtype)
    for part in blocks(len(values)):
        made[part] = values[part]
    return _sealed(made)


class FileArray(np.ndarray[Any, np.dtype[Any]]):
    """An array in a file; large arrays that are computed from it are in files as well."""

    def __array_ufunc__(
        self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **options: Any
    ) -> Any:
        """An operation, with room in a file for a large result."""
        PAGES.touch(inputs)
        given = [_plain(each) for each in inputs]
        if out is not None:
            getattr(ufunc, method)(*given, out=tuple(map(_plain, out)), **options)
            return out[0] if len(out) == 1 else out
        by_element = ufunc.signature is None and ufunc.nout == 1
        if method in ("__call__", "accumulate") and by_element and not options:
            shape = np.broadcast_shapes(*map(np.shape, given))
            # The type of the result follows from an empty array.
            kind = getattr(ufunc, method)(*map(_none_of, given)).dtype
            made = empty(shape, kind)
            if isinstance(made, FileArray):
                getattr(ufunc, method)(*given, out=made.view(np.ndarray))
                return made
        return getattr(ufunc, method)(*given, **options)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        """A function of NumPy; those that would make large arrays have a version of their own."""
        PAGES.touch(args)
        own = _OWN.get(func)
        if own is not None:
            return own(*args, **kwargs)
        return super().__array_function__(func, types, args, kwargs)

    def __getitem__(self, key: Any) -> Any:
        """A part; a large one that a mask or numbers of rows choose is in a file."""
        if isinstance(key, np.ndarray) and key.ndim == self.ndim == 1:
            PAGES.touch((self, key))
            key = _plain(key)
            if key.dtype == np.bool_ and len(key) == len(self):
                return self._masked(key)
            if key.dtype.kind == "i" and key.nbytes > LARGE:
                made = empty(len(key), self.dtype)
                for part in blocks(len(key)):
                    made[part] = self.view(np.ndarray)[key[part]]
                return made
        part = super().__getitem__(key)
        PAGES.touch((part,))
        return part

    def astype(self, dtype: Any, *rest: Any, **options: Any) -> Any:
        """The values in another type, in a file if they are many."""
        made = empty(self.shape, dtype)
        for part in blocks(len(self)):
            made[part] = self.view(np.ndarray)[part].astype(dtype, *rest, **options)
        return made

    def _masked(self, mask: NDArray[np.bool_]) -> NDArray[Any]:
        """The values that a mask (n,) chooses; of rows that follow each other, the part itself."""
        values, count = self.view(np.ndarray), int(np.count_nonzero(mask))
        if count * self.itemsize <= LARGE:
            return np.asarray(values[mask])
        first, after = int(np.argmax(mask)), len(mask) - int(np.argmax(mask[::-1]))
        if after - first == count:
            return _sealed(self[first:after])
        made, at = empty(count, self.dtype), 0
        for part in blocks(len(mask)):
            chosen = values[part][mask[part]]
            made[at : at + len(chosen)] = chosen
            at += len(chosen)
        return made


def _sealed(values: NDArray[Any]) -> NDArray[Any]:
    """The same array, which is not to be written."""
    values.flags.writeable = False
    return values


def _plain(values: Any) -> Any:
    return values.view(np.ndarray) if isinstance(values, FileArray) else values


def _none_of(values: Any) -> Any:
    """No element of an array; a number as it is."""
    return values.reshape(-1)[:0] if isinstance(values, np.ndarray) else values


def _where(condition: Any, chosen: Any, other: Any) -> Any:
    condition, chosen, other = map(_plain, (condition, chosen, other))
    shape = np.broadcast_shapes(*map(np.shape, (condition, chosen, other)))
    made = empty(shape, np.where(*map(_none_of, (condition, chosen, other))).dtype)
    np.copyto(made.view(np.ndarray), other)
    np.copyto(made.view(np.ndarray), chosen, where=condition)
    return made


def _broadcast_to(values: Any, shape: Any, subok: bool = False) -> Any:
    if isinstance(values, FileArray) and values.shape == tuple(np.atleast_1d(shape)):
        return _sealed(values.view())
    return np.broadcast_to(_plain(values), shape, subok=subok)


def _flatnonzero(values: Any) -> Any:
    flat = _plain(values).reshape(-1)
    made, at = empty(int(np.count_nonzero(flat)), np.int64), 0
    for part in blocks(len(flat)):
        rows = np.flatnonzero(flat[part]) + part.start
        made[at : at + len(rows)] = rows
        at += len(rows)
    return made


def _median(values: Any) -> Any:
    made = empty(values.shape, values.dtype)
    made[...] = values
    return np.median(made.view(np.ndarray), overwrite_input=True)


def _nansum(values: Any) -> Any:
    return np.where(np.isnan(values), 0.0, values).sum()


def _nanmean(values: Any) -> Any:
    return np.true_divide(_nansum(values), len(values) - np.count_nonzero(np.isnan(values)))


def _nanargmax(values: Any) -> Any:
    unknown = np.isnan(values)
    if unknown.all():
        raise ValueError("All-NaN slice encountered")
    return np.argmax(np.where(unknown, -np.inf, values))


def _on_plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that copies arrays of classes that it does not know."""
    return lambda values, *rest, **options: function(_plain(values), *rest, **options)


_OWN: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.broadcast_to: _broadcast_to,
    np.flatnonzero: _flatnonzero,
    np.median: _median,
    np.cumsum: np.add.accumulate,
    np.nansum: _nansum,
    np.nanmean: _nanmean,
    np.nanargmax: _nanargmax,
    np.nanmax: _on_plain(np.nanmax),
    np.nanmin: _on_plain(np.nanmin),
}
