"""Libraries that only some tasks or commands need, and how to get them."""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from typing import Any

DISTRIBUTION = "taskspec-robotics"
#: Extras of the distribution by the libraries that they bring; it always brings the others.
EXTRAS = {
    "distributed": "dask",
    "fmpy": "fmu",
    "gymnasium": "gym",
    "imageio_ffmpeg": "video",
    "mcap": "mcap",
    "osqp": "osqp",
    "pygls": "editor",
    "rerun": "rerun",
    "rosbags": "mcap",
    "scipy": "mesh",
    "trimesh": "mesh",
    "zstandard": "mcap",
}


class MissingLibraryError(Exception):
    """Something needs a library that is not installed; the message names the command for it.

    Attributes:
        extra: of this distribution that brings the library; empty where all of it does.
    """

    def __init__(self, what: str, library: str) -> None:
        message = f"{what} needs the library {library}, which is not installed"
        super().__init__(f"{message}: {command_for(library)}")
        self.extra = EXTRAS.get(library, "")


def command_for(library: str) -> str:
    """What installs a library together with this distribution."""
    extra = EXTRAS.get(library)
    return f"pip install '{DISTRIBUTION}[{extra}]'" if extra else f"pip install {DISTRIBUTION}"


def library(name: str, what: str) -> Any:
    """A module of a library that may not be installed.

    Args:
        name: of the module.
        what: needs it.

    Raises:
        MissingLibraryError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingLibraryError(what, name.partition(".")[0]) from error


def require(name: str, what: str, *others: str) -> None:
    """Finds out whether a library is installed, and others that it needs, without importing them.

    Raises:
        MissingLibraryError: one is not.
    """
    for each in (name, *others):
        try:
            found = find_spec(each)
        except ImportError:
            found = None
        if found is None:
            raise MissingLibraryError(what, name)
