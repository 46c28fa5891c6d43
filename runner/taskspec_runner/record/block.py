"""The ticks of a log's next batch, in a file that is mapped into memory.

What a process has put into such a file is there when the process is killed, without a call of the
system for each tick.

The file has sixteen numbers of 64 bit: a mark, fields of a tick, ticks there is room for, which of
two states holds, the states, and two that are zero. A state is the ticks and the SHA-256, four
numbers, that the log had when the batch began; the next one is written beside it. Checksums of
the ticks follow, 64 bit each, then the ticks. A tick is there when its checksum is.
"""

from __future__ import annotations

import mmap
import os
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.errors import OutputError
from taskspec_runner.record.whole import open_regular

Vector = NDArray[np.float64]

BLOCK = "log.block"
_MARK = int.from_bytes(b"TASKBLK1", "little")
#: Of the file's head: how long it is, which of its two states holds, and where those are.
_HEAD, _HOLDS, _STATES = 16, 3, (4, 9)
_WORD = (1 << 32) - 1
_EXCLUSIVE = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


class Block:
    """Ticks as they come.

    Attributes:
        rows: (room, fields) of them.
        sums: (room,) checksum of each, with its number in the log; see `checksum`.
    """

    def __init__(self, numbers: NDArray[np.int64], room: int, fields: int, path: Path | None):
        self._head, self._path = numbers[:_HEAD], path
        self.sums = numbers[_HEAD : _HEAD + room]
        self.rows: Vector = numbers[_HEAD + room :].view(np.float64).reshape(room, fields)
        self._head[:_HOLDS] = _MARK, fields, room

    @classmethod
    def memory(cls, room: int, fields: int) -> Block:
        """One that nothing is left of."""
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

    def advance(self, ticks: int, sha256: bytes) -> None:
        """Begins the next batch.

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
    """What a killed process has left in its block.

    Attributes:
        first: ticks that the log had when the batch began.
        rows: (n, fields) the complete ones, in order.
        sha256: of the log when the batch began; empty where it had none.
        damage: what is wrong with the file, empty if nothing is.
    """

    first: int
    rows: Vector
    sha256: str = ""
    damage: str = ""


def read_block(path: Path) -> LeftTicks | None:
    """The ticks in a block; None where there is no block.

    Complete are those at its front whose checksums are right. The next one may be half written;
    behind it lie those of the batch before, or nothing.
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
    sums, rows = numbers[:room].tolist(), numbers[room:].view(np.float64).reshape(room, fields)
    good = next((i for i in range(room) if checksum(rows[i], first + i) != sums[i]), room)
    # The one that was under way when the process ended may be anything.
    for i in range(good + 1, room):
        before = first - room + i
        if checksum(rows[i], before) != sums[i] if before >= 0 else sums[i] or rows[i].any():
            return altered
    return LeftTicks(first, rows[:good], digest.tobytes().hex() if first else "")


def checksum(row: Vector, tick: int) -> int:
    """CRC-32 of a tick's numbers, which begins with the tick's own number."""
    return zlib.crc32(row.data, tick & _WORD)
