"""One writer: a folder is locked by its process, and by nothing once that has ended.

The lock is an flock, which the system takes back from a process that dies, however it dies. Its
file says who holds it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import socket
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import OutputError
from taskspec_runner.record.manifest import now

LOCK = ".taskspec-lock"
#: Room that the lock's file keeps for what has to be written when a disk is full [bytes].
RESERVE = 1 << 16
_LARGEST_LOCK = 4096


@dataclass(frozen=True, slots=True)
class Holder:
    """Who writes into a folder.

    Attributes:
        pid, host, since: process, machine, and UTC time; empty where they are not known.
    """

    pid: str
    host: str
    since: str

    @property
    def text(self) -> str:
        """In words."""
        if not self.pid:
            return "another process"
        return f"process {self.pid} on {self.host} since {self.since}"


class FolderLock:
    """A folder that no other process writes into, until it is closed."""

    def __init__(self, folder: Path) -> None:
        """Takes the lock of a folder.

        Raises:
            OutputError: another process has it; the message says which.
            OSError: the folder cannot be written, or its file system has no locks.
        """
        self._folder, self._path = folder, folder / LOCK
        self._descriptor = self._open()
        said = {"pid": os.getpid(), "host": socket.gethostname(), "since": now()}
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, json.dumps(said).encode(), 0)
        # A file system without room for this may still have enough for the run.
        with contextlib.suppress(OSError):
            os.posix_fallocate(self._descriptor, 0, RESERVE)

    def _open(self) -> int:
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        while True:
            descriptor = os.open(self._path, flags, 0o666)
            try:
                if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                    raise OutputError(self._path, "it is not a regular file")
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # Whoever held it before may have removed the file in between.
                if os.path.samestat(os.fstat(descriptor), os.lstat(self._path)):
                    return descriptor
            except BlockingIOError as error:
                text = _holder(descriptor).text
                os.close(descriptor)
                raise OutputError(self._folder, f"{text} writes into it") from error
            except FileNotFoundError:
                pass
            except BaseException:
                os.close(descriptor)
                raise
            os.close(descriptor)

    def make_room(self) -> None:
        """Gives up the room that the lock keeps on the disk."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._descriptor, 0)

    def close(self) -> None:
        """Gives the lock back, and removes its file."""
        with contextlib.suppress(OSError):
            self._path.unlink()
        os.close(self._descriptor)


def holder(folder: Path) -> Holder | None:
    """Who writes into a folder now; None if nobody does."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _holder(descriptor)
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return None


def _holder(descriptor: int) -> Holder:
    said: Any = None
    with contextlib.suppress(OSError, ValueError):
        said = json.loads(os.pread(descriptor, _LARGEST_LOCK, 0).rstrip(b"\0"))
    if not isinstance(said, Mapping):
        said = {}
    return Holder(*(str(said.get(key, "")) for key in ("pid", "host", "since")))
