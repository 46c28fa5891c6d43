"""The newest ticks of a run, those that its log does not have yet among them, in a mapped file.

What a process has put into such a file is there when the process is killed, without a call of the
system for each tick.

The file has sixteen numbers of 64 bit: a mark, fields of a tick, ticks there is room for, which of
two states holds, the states, and two that are zero. A state is the ticks and the SHA-256, four
numbers, that the log had; the next one is written beside it. Checksums of the ticks follow, 64 bit
each, then the ticks, in a ring: tick k is row k modulo the room. A tick is there when its checksum
is.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.native.kernel import Words
from taskspec.regular_file import open_regular
from taskspec_runner.errors import OutputError

Vector = NDArray[np.float64]

_MARK = int.from_bytes(b"TASKBLK2", "little")
#: Of the file's head: how long it is, which of its two states holds, and where those are.
_HEAD, _HOLDS, _STATES = 16, 3, (4, 9)
_EXCLUSIVE = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


class Block:
    """Ticks as they come, in a ring.

    Attributes:
        rows: (room, fields) of them.
        sums: (room,) checksum of each, with its number in the log; see `checksum`.
        in_file: whether others may read it, by the checksums.
    """

    def __init__(self, numbers: NDArray[np.int64], room: int, fields: int, path: Path | None):
        self._head, self._path, self.in_file = numbers[:_HEAD], path, path is not None
        self.sums = numbers[_HEAD : _HEAD + room]
        self.rows: Vector = numbers[_HEAD + room :].view(np.float64).reshape(room, fields)
        self._head[:_HOLDS] = _MARK, fields, room

    @classmethod
    def memory(cls, room: int, fields: int) -> Block:
        """One that is in no file."""
        return cls(np.zeros(_HEAD + room * (fields + 1), dtype=np.int64), room, fields, None)

    @classmethod
    def file(cls, path: Path, room: int, fields: int) -> Block:
        """One in a new file.

        Raises:
            OutputError: it cannot be made.
        """
        size = 8 * (_HEAD + room * (fields + 1))
        try:
            descriptor = os.open(path, _EXCLUSIVE, 0o666)
            try:
                # Room on the disk now: a mapped page that finds none later ends the process.
                os.posix_fallocate(descriptor, 0, size)
                mapped = mmap.mmap(descriptor, size)
            except BaseException:
                path.unlink(missing_ok=True)
                raise
            finally:
                os.close(descriptor)
        except OSError as error:
            raise OutputError.of(path, error) from error
        return cls(np.frombuffer(mapped, dtype=np.int64), room, fields, path)

    def taking(self, array: Vector) -> Callable[[int], None]:
        """Puts what is in an array (fields,) into the ring: as the tick of a number from 0 on."""
        room, fields = self.rows.shape
        # A slice of memory is copied in a third of the time that a row of an array takes.
        row_bytes, row = array.data, self.rows.reshape(-1).data
        by, sums = weights(fields), self.sums.view(np.uint64).data
        # Nor is an integer made of an array's number, which takes as long.
        total = np.zeros((), dtype=np.int64)
        dot, summed = array.view(np.int64).dot, total.data

        def take(tick: int) -> None:
            at = tick % room
            row[at * fields : (at + 1) * fields] = row_bytes
            # With its checksum the tick is there, whatever happens to this process.
            dot(by, total)
            sums[at] = (summed[()] + (tick + 1) * TICK_WEIGHT) & _WORD

        return take

    def advance(self, ticks: int, sha256: bytes) -> None:
        """Notes that the log has more ticks; their rows may be overwritten.

        Args:
            ticks: that the log has now.
            sha256: of the log now.
        """
        new = 1 - int(self._head[_HOLDS])
        at = _STATES[new]
        self._head[at] = ticks
        self._head[at + 1 : at + 5] = np.frombuffer(sha256, dtype=np.int64)
        # All of it at once, so that a process that is killed leaves one or the other.
        self._head[_HOLDS] = new


@dataclass(frozen=True, slots=True)
class LeftTicks:
    """The ticks that a killed process has left in its block.

    Attributes:
        first: ticks that the log had when that was last noted.
        rows: (n, fields) the complete ones from there on, in order.
        sha256: of the log then; empty where it had none.
        damage: what is wrong with the file, empty if nothing is.
    """

    first: int
    rows: Vector
    sha256: str = ""
    damage: str = ""


def read_block(path: Path) -> LeftTicks | None:
    """The ticks in a block; None where there is no block.

    Complete are those whose checksums are right, up to the first whose is not. That one may be half
    written; behind it lie those of the round before, or nothing.
    """
    nothing = np.zeros((0, 0))
    altered = LeftTicks(0, nothing, "", f"{path.name} was altered: it is not as the run left it")
    try:
        with open_regular(path) as file:
            head = np.frombuffer(file.read(8 * _HEAD).ljust(8 * _HEAD, b"\0"), dtype=np.int64)
            if not head.any():
                # Its process ended before the first tick.
                return LeftTicks(0, nothing)
            mark, fields, room, holds = head[: _HOLDS + 1].tolist()
            size = os.fstat(file.fileno()).st_size
            sane = mark == _MARK and min(fields, room) > 0 and holds in (0, 1)
            if not sane or size != 8 * (_HEAD + room * (fields + 1)):
                return altered
            numbers = np.frombuffer(file.read(size), dtype=np.int64)
    except FileNotFoundError:
        return None
    except OSError as error:
        return LeftTicks(0, nothing, "", f"{path.name} cannot be read: {error.strerror or error}")
    first, digest = int(head[_STATES[holds]]), head[_STATES[holds] + 1 : _STATES[holds] + 5]
    if first < 0:
        return altered
    sums, rows = numbers[:room], numbers[room:].view(np.float64).reshape(room, fields)
    turned = np.roll(rows, -(first % room), axis=0)
    expected = np.roll(sums, -(first % room))
    ticks = first + np.arange(room)
    right = checksums(turned, ticks) == expected
    good = room if right.all() else int(np.argmin(right))
    # The one that was under way when the process ended may be anything.
    old, there = turned[good + 1 :], expected[good + 1 :]
    before = ticks[good + 1 :] - room
    empty = (there == 0) & ~old.view(np.int64).any(axis=1)
    if not np.where(before < 0, empty, checksums(old, before) == there).all():
        return altered
    return LeftTicks(first, turned[:good], digest.tobytes().hex() if first else "")


#: What a tick's own number counts in its checksum; odd, so that every bit of it counts.
TICK_WEIGHT = 0x1B873593CC9E2D51
#: Checksums are modulo 2^64.
_WORD = (1 << 64) - 1


def weights(fields: int) -> NDArray[np.int64]:
    """(fields,) what each of a tick's numbers counts in its checksum: odd, and each another."""
    numbers = np.arange(1, fields + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return (numbers | np.uint64(1)).view(np.int64)


def checksums(rows: Vector, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) checksums of ticks: of rows (n, fields), the numbers (n,) of which are `ticks`.

    The sum of a tick's words of 64 bit, each times its weight, and of its number from 1 on times
    `TICK_WEIGHT`, modulo 2^64. A change of a single word always shows, and changes of more at
    random with all but one chance in 2^64; and it is a few instructions in machine code.
    """
    words = np.ascontiguousarray(rows).view(np.int64)
    return words @ weights(rows.shape[1]) + (ticks + 1) * np.int64(TICK_WEIGHT)


def checksum(words: Words, by: Words, fields: int, tick: int) -> int:
    """`checksums` of one tick, for the loop in machine code, whose integers have 64 bit.

    Args:
        words: of the tick.
        by: its `weights`.
        fields: how many words there are.
        tick: its number, from 0 on.
    """
    total = (tick + 1) * TICK_WEIGHT
    for i in range(fields):
        total += words[i] * by[i]
    return total
