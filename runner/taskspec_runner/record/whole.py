"""Files that are whole or not there: how every file is written.

A file is written beside its place, brought to the disk and renamed. What a killed process leaves
is a file that begins with `PARTIAL`, beside the untouched old one.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from taskspec_runner.errors import OutputError

#: What the name of a file begins with that is not complete.
PARTIAL = ".taskspec-partial-"
_EXCLUSIVE = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Gives the path of a new, empty file; when it has been written, it takes the place of `path`.

    The new file lies in the same folder and has the same suffix. It is made exclusively, so no
    link is followed. If anything fails, it is removed and `path` is as it was.

    Raises:
        OutputError: it cannot be written; `path` is something else than a file; or the new file was
            replaced while it was written.
    """
    partial, descriptor = _begun(path)
    try:
        yield partial
        os.fsync(descriptor)
        if not os.path.samestat(os.fstat(descriptor), os.lstat(partial)):
            raise OutputError(path, "its new file was replaced while it was written")
        partial.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise OutputError.of(path, error) from error
    finally:
        os.close(descriptor)
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def _begun(path: Path) -> tuple[Path, int]:
    """A new, empty file beside a path, and the descriptor that it is open by.

    Raises:
        OutputError: there is none, or `path` is something else than a file.
    """
    partial = path.with_name(f"{PARTIAL}{secrets.token_hex(6)}{path.suffix}")
    try:
        if path.exists() and not path.is_file():
            raise OutputError(path, "it is not a regular file")
        return partial, os.open(partial, _EXCLUSIVE, 0o666)
    except OSError as error:
        raise OutputError.of(path, error) from error


def check_writable(path: Path) -> None:
    """Finds out whether a file can be written, before what it is to hold is made; leaves nothing.

    Raises:
        OutputError: it cannot.
    """
    partial, descriptor = _begun(path)
    os.close(descriptor)
    partial.unlink()


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Gives the path of a new, empty folder; when it has been written, it becomes `path`.

    If anything fails, it is removed with all that is in it.

    Raises:
        OutputError: it cannot be written, or `path` is there and is no empty folder.
    """
    partial = path.absolute().with_name(f"{PARTIAL}{secrets.token_hex(6)}")
    try:
        partial.parent.mkdir(parents=True, exist_ok=True)
        partial.mkdir()
        try:
            yield partial
            # The system refuses where there is anything in it.
            partial.rename(path)
            sync_folder(partial.parent)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise OutputError.of(path, error) from error


def write_whole(path: Path, content: bytes | str) -> Path:
    """Writes a file, a text in UTF-8; see `whole`.

    Raises:
        OutputError: it cannot be written.
    """
    with whole(path) as partial:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def sync_folder(path: Path) -> None:
    """Brings the names in a folder to the disk.

    Raises:
        OSError: the disk does not take them.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
