"""Libraries that only some exports need, and how to get them."""

from __future__ import annotations

import importlib
from typing import Any

from taskspec_runner.errors import InputError

DISTRIBUTION = "taskspec-robotics"


class MissingLibraryError(InputError):
    """An export needs a library that is not installed; the message names the command for it.

    Attributes:
        extra: of this distribution that brings the library.
    """

    def __init__(self, what: str, library: str, extra: str) -> None:
        command = f"pip install '{DISTRIBUTION}[{extra}]'"
        super().__init__(f"{what} needs the library {library}, which is not installed: {command}")
        self.extra = extra


def library(name: str, what: str, extra: str) -> Any:
    """A module of an optional library.

    Args:
        name: of the module.
        what: needs it.
        extra: that brings it.

    Raises:
        MissingLibraryError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingLibraryError(what, name.partition(".")[0], extra) from error
