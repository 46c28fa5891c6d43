"""Messages of a fixed layout in CDR, the encoding of ROS 2: a template with slots for numbers."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Little-endian CDR; sizes and alignment count from behind it.
_ENCAPSULATION = b"\x00\x01\x00\x00"


class Layout:
    """The bytes of a message, built from its first field to its last."""

    def __init__(self) -> None:
        self._template = bytearray()
        self._slots: list[tuple[int, int]] = []

    def text(self, value: str) -> Layout:
        """A string that is the same in all messages."""
        content = value.encode() + b"\x00"
        self.count(len(content))
        self._template += content
        return self

    def count(self, number: int) -> Layout:
        """A number of elements."""
        self._align(4)
        self._template += struct.pack("<I", number)
        return self

    def stamp(self) -> Layout:
        """A slot for a time: (n, 2) seconds and nanoseconds, as 32-bit numbers."""
        return self._slot(8, 4)

    def numbers(self, size: int) -> Layout:
        """A slot for (n, size) 64-bit floats."""
        return self._slot(8 * size, 8) if size else self

    def header(self, frame: str) -> Layout:
        """A `std_msgs/Header`."""
        return self.stamp().text(frame)

    def message(self) -> bytes:
        """A message without slots."""
        return _ENCAPSULATION + bytes(self._template)

    def messages(self, *slots: NDArray[Any]) -> Iterator[bytes]:
        """One message for each row of the arrays that fill the slots, in their order."""
        rows = len(slots[0])
        filled = np.empty((rows, len(self._template)), dtype=np.uint8)
        filled[:] = np.frombuffer(bytes(self._template), dtype=np.uint8)
        for (start, size), values in zip(self._slots, slots, strict=True):
            filled[:, start : start + size] = np.ascontiguousarray(values).view(np.uint8)
        for row in filled:
            yield _ENCAPSULATION + row.tobytes()

    def _slot(self, size: int, alignment: int) -> Layout:
        self._align(alignment)
        self._slots.append((len(self._template), size))
        self._template += bytes(size)
        return self

    def _align(self, to: int) -> None:
        self._template += bytes(-len(self._template) % to)


def stamps(clock: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
    """(n,) nanoseconds, and (n, 2) seconds and nanoseconds, of times [s]."""
    ticks = np.round(1e9 * clock).astype(np.int64)
    seconds, rest = np.divmod(ticks, 1_000_000_000)
    return ticks, np.column_stack([seconds, rest]).astype("<u4")
