"""What can be made anew, kept under the user's cache folder by the key of what it is made of."""

from __future__ import annotations

import hashlib
import os
import stat
import sys
from contextlib import suppress
from pathlib import Path

from taskspec.regular_file import open_regular

VARIABLE = "TASKSPEC_CACHE"

_MAGIC = b"taskspec store 1\n"
_DIGEST = hashlib.sha256().digest_size
#: User id of the system itself.
_SYSTEM = 0
_LIMIT = 256 * 1024 * 1024
#: Share of the limit that is left when files are removed: else the next one that is put would have
#: the folder looked through again.
SHRUNK = 0.9


def cache_folder() -> Path | None:
    """Where taskspec keeps what it can make anew, None where nothing is to be kept.

    `TASKSPEC_CACHE` names the folder, and empty says that nothing is kept. Without it this is
    `taskspec` in the folder that the system has for caches: `$XDG_CACHE_HOME` or `~/.cache`,
    `~/Library/Caches`, `%LOCALAPPDATA%`.
    """
    named = os.environ.get(VARIABLE)
    if named is not None:
        return Path(named).expanduser().absolute() if named.strip() else None
    try:
        home = Path.home()
    except RuntimeError:
        return None
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA", "")
        return (Path(local) if local else home / "AppData" / "Local") / "taskspec" / "cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "taskspec"
    # The rule of XDG: a path that is not absolute counts as none.
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else home / ".cache") / "taskspec"


def sources(*folders: Path) -> str:
    """The SHA-256 of the modules right in some folders: what follows from their text goes by it."""
    found = hashlib.sha256()
    for folder in folders:
        for path in sorted(folder.glob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()


def digest_of(path: Path) -> str | None:
    """The SHA-256 of a regular file as it is now; None where there is none that can be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
    except (OSError, ValueError):
        return None


class Store:
    """Bytes by key. Whatever goes wrong with its files, `get` gives what was put, or nothing.

    A file begins with a checksum over its key and its bytes, so that one which is cut, damaged or
    of another key counts as none. It is written under another name and renamed, so that processes
    may share a folder. A folder that cannot be read or written is a store that keeps nothing.

    The bytes may be machine code. A folder that belongs to another user, or that others may write
    to, is left alone, and so is one below such a folder. What is no regular file, as a pipe, a
    device or a link, counts as none.
    """

    def __init__(self, folder: Path | None, *, limit: int = _LIMIT) -> None:
        """Takes the folder, None for a store that keeps nothing, and its largest size in bytes.

        Beyond that size the files that were not used for longest are removed.
        """
        self._folder, self._limit = folder, limit
        #: Bytes that may be put before the folder is looked through again.
        self._room = 0

    @classmethod
    def named(cls, name: str) -> Store:
        """The store of a name below the user's cache folder."""
        folder = cache_folder()
        return cls(None if folder is None else folder / name)

    def get(self, key: str) -> bytes | None:
        """What was put under a key, None where there is nothing or nothing sound."""
        if self._folder is None or not _is_ours(self._folder):
            return None
        path = self._path(self._folder, key)
        try:
            with open_regular(path, links=False) as file:
                whole = file.read()
        except OSError:
            return None
        start = len(_MAGIC) + _DIGEST
        data = whole[start:]
        if not whole.startswith(_MAGIC) or whole[len(_MAGIC) : start] != _checksum(key, data):
            return None
        with suppress(OSError):
            os.utime(path)
        return data

    def put(self, key: str, data: bytes) -> None:
        """Keeps bytes under a key, where the folder lets it."""
        folder = self._folder
        if folder is None or len(data) > self._limit:
            return
        # A full disk, a folder that is read-only: the next process makes the bytes anew.
        with suppress(OSError):
            missing = [each for each in (folder, *folder.parents) if not each.exists()]
            for each in reversed(missing):
                # `mkdir` gives the folders above the last one whatever the umask leaves.
                each.mkdir(mode=0o700, exist_ok=True)
            if _is_ours(folder):
                whole = _MAGIC + _checksum(key, data) + data
                _write(self._path(folder, key), whole)
                self._room -= len(whole)
                if self._room < 0:
                    self._shrink(folder)

    def _path(self, folder: Path, key: str) -> Path:
        return folder / hashlib.sha256(key.encode()).hexdigest()

    def _shrink(self, folder: Path) -> None:
        """Removes what was not used for longest, if they are more than the limit."""
        entries = []
        for entry in os.scandir(folder):
            # Another process may remove a file first.
            with suppress(OSError):
                if entry.is_file(follow_symlinks=False):
                    facts = entry.stat(follow_symlinks=False)
                    entries.append((facts.st_mtime_ns, facts.st_size, entry.path))
        size = sum(entry[1] for entry in entries)
        left = self._limit if size <= self._limit else SHRUNK * self._limit
        for _, length, path in sorted(entries):
            if size <= left:
                break
            with suppress(OSError):
                Path(path).unlink()
            size -= length
        # What other processes put meanwhile they look after themselves.
        self._room = self._limit - size


def _checksum(key: str, data: bytes) -> bytes:
    return hashlib.sha256(hashlib.sha256(key.encode()).digest() + data).digest()


def _is_ours(folder: Path) -> bool:
    """Whether no other user may write to a folder, or put another one in its place.

    It is this user's own, and each folder above it, by its name and with links followed, this
    user's or the system's. Others may write to one of these only where its sticky bit keeps them
    from renaming what is not theirs, as in /tmp. Windows has no such bits.
    """
    if sys.platform == "win32":
        return True
    user, others = os.getuid(), stat.S_IWGRP | stat.S_IWOTH
    try:
        facts = folder.stat()
        if facts.st_uid != user or facts.st_mode & others:
            return False
        for above in {*folder.absolute().parents, *folder.resolve().parents}:
            facts = above.stat()
            if facts.st_uid not in (user, _SYSTEM):
                return False
            if facts.st_mode & others and not facts.st_mode & stat.S_ISVTX:
                return False
    except (OSError, RuntimeError):
        return False
    return True


def _write(path: Path, data: bytes) -> None:
    """Writes a file whole or not at all."""
    from tempfile import NamedTemporaryFile

    with NamedTemporaryFile(dir=path.parent, prefix="new-", delete=False) as file:
        try:
            file.write(data)
            file.close()
            Path(file.name).replace(path)
        except BaseException:
            file.close()
            Path(file.name).unlink(missing_ok=True)
            raise
