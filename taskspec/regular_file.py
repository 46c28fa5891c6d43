"""Opening files that others may have put in place: what is none is not waited for."""

from __future__ import annotations

import os
import stat
from io import BufferedReader
from pathlib import Path

#: Windows has none of these, but opens a file as text by default.
_FLAGS = ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY")


def open_regular(path: Path, *, links: bool = True) -> BufferedReader:
    """Opens a file to be read. Nothing is waited for, as the other end of a pipe would be.

    Args:
        path: of the file.
        links: whether a link to it is followed.

    Raises:
        OSError: there is none, or it is no regular file.
    """
    flags = _FLAGS if links else (*_FLAGS, "O_NOFOLLOW")
    descriptor = os.open(path, os.O_RDONLY | sum(getattr(os, name, 0) for name in flags))
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    raise OSError(None, "it is not a regular file")
