"""Messages of a fixed layout in CDR, the encoding of ROS 2: a template with slots for numbers."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Little-endian CDR; sizes and alignment count from behind it.
_ENCAPSULATION = b"\x00\x01\x00\x00"

Bytes = NDArray[np.uint8]


class MessageForm:
    """The bytes of a message, built from its first field to its last."""

    def __init__(self) -> None:
        self._template = bytearray()
        self._slots: list[tuple[int, int]] = []

    def text(self, value: str) -> MessageForm:
        """A string that is the same in all messages."""
        content = value.encode() + b"\x00"
        self.count(len(content))
        self._template += content
        return self

    def count(self, number: int) -> MessageForm:
        """A number of elements."""
        self._align(4)
        self._template += struct.pack("<I", number)
        return self

    def integer(self, number: int) -> MessageForm:
        """A 32-bit number that is the same in all messages."""
        self._align(4)
        self._template += struct.pack("<i", number)
        return self

    def byte(self, number: int) -> MessageForm:
        """A number of 8 bits, or whether something holds, the same in all messages."""
        self._template.append(number)
        return self

    def constant(self, values: NDArray[Any]) -> MessageForm:
        """Numbers that are the same in all messages; 32-bit floats stay such."""
        if values.size:
            self._align(values.itemsize)
            self._template += np.ascontiguousarray(values).tobytes()
        return self

    def integers(self, size: int) -> MessageForm:
        """A slot for (n, size) 32-bit numbers."""
        return self._slot(4 * size, 4)

    def floats(self, size: int) -> MessageForm:
        """A slot for (n, size) 32-bit floats."""
        return self._slot(4 * size, 4)

    def stamp(self) -> MessageForm:
        """A slot for a time: (n, 2) seconds and nanoseconds, as 32-bit numbers."""
        return self._slot(8, 4)

    def numbers(self, size: int) -> MessageForm:
        """A slot for (n, size) 64-bit floats."""
        return self._slot(8 * size, 8) if size else self

    def header(self, frame: str) -> MessageForm:
        """A `std_msgs/Header`."""
        return self.stamp().text(frame)

    @property
    def template(self) -> bytes:
        """A message with zeros in its slots."""
        return _ENCAPSULATION + bytes(self._template)

    def fill(self, messages: Bytes, slots: Sequence[NDArray[Any]]) -> None:
        """Writes the slots of messages (n, size), a row each, from arrays (n, ...) in order."""
        for (start, size), values in zip(self._slots, slots, strict=True):
            at = len(_ENCAPSULATION) + start
            messages[:, at : at + size] = bytes_of(values)

    def _slot(self, size: int, alignment: int) -> MessageForm:
        self._align(alignment)
        self._slots.append((len(self._template), size))
        self._template += bytes(size)
        return self

    def _align(self, to: int) -> None:
        self._template += bytes(-len(self._template) % to)


def bytes_of(values: NDArray[Any]) -> Bytes:
    """(n, size) bytes of an array (n, ...)."""
    return np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)


def stamps(clock: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
    """(n,) nanoseconds, and (n, 2) seconds and nanoseconds, of times [s]."""
    ticks = np.round(1e9 * clock).astype(np.int64)
    seconds, rest = np.divmod(ticks, 1_000_000_000)
    return ticks, np.column_stack([seconds, rest]).astype("<u4")
