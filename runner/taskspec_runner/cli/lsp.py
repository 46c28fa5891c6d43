"""`taskspec lsp`: the language server on standard input and output."""

from __future__ import annotations

from taskspec_runner.errors import InputError
from taskspec_runner.exit_codes import WELL


def serve() -> int:
    """Serves one editor until it goes.

    Raises:
        InputError: the extra that brings the server is not installed.
    """
    try:
        from taskspec_runner.editor.server import server
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("pygls", "lsprotocol"):
            raise
        raise InputError(
            "the language server needs pygls: pip install 'taskspec-robotics[editor]'"
        ) from error
    server().start_io()
    return WELL
