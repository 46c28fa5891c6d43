"""Exit codes: how every end of a command is reported to the shell.

Those of `taskspec_runner.exit_codes`; 130 interrupted, 143 and 129 terminated by SIGTERM and
SIGHUP.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

import typer

from taskspec.missing import MissingLibraryError, require
from taskspec.text.characters import escaped
from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.diagnostics import show_diagnostics
from taskspec_runner.errors import InputError, OutputError, RunCrashedError
from taskspec_runner.exit_codes import INTERNAL, WRONG
from taskspec_runner.loop.interrupt import BY_SIGNAL, signal_of

P = ParamSpec("P")

#: What a shell reports of a command whose reader went away.
_PIPE = 141
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


def guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Ends the process with the code that a command returns, or that its exception stands for."""

    @functools.wraps(command)
    def inner(*args: P.args, **kwargs: P.kwargs) -> None:
        raise typer.Exit(_outcome(functools.partial(command, *args, **kwargs)))

    return inner


def _outcome(command: Callable[[], int]) -> int:
    try:
        # What a command has found is shown with it, at its end.
        require("rich", "this command")
        code = command()
        sys.stdout.flush()
        return code
    except (typer.Exit, typer.Abort, typer.BadParameter):
        raise
    except SpecError as error:
        show_diagnostics(error.diagnostics, error.sources, err=True)
        return WRONG
    except (InputError, OutputError, MissingLibraryError) as error:
        _say(str(error))
        return WRONG
    except ImportError as error:
        # Of a project's own module it is a mistake in the project.
        name = (error.name or "").partition(".")[0]
        if not name or name.startswith("taskspec"):
            return _internal(error)
        _say(str(MissingLibraryError("this command", name)))
        return WRONG
    except KeyboardInterrupt as error:
        _say(str(error) or "interrupted")
        return BY_SIGNAL + signal_of(error)
    except RunCrashedError as error:
        _say(f"internal error: {error}")
        _say(f"what was logged is in {error.folder}; please report this with {error.trace}")
        return INTERNAL
    except OSError as error:
        return lost(error) if is_lost(error) else _internal(error)
    except Exception as error:
        return _internal(error)


def _internal(error: Exception) -> int:
    _say(f"internal error: {type(error).__name__}: {error}")
    _say(f"please report this with {keep_trace(error)}")
    return INTERNAL


def is_lost(error: OSError) -> bool:
    """Whether an error says that standard output takes nothing more."""
    return isinstance(error, BrokenPipeError) or error.errno in _FULL


def lost(error: OSError) -> int:
    """Gives up standard output; the exit code of that."""
    # Whatever is still buffered has no place either.
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        return _PIPE
    _say(f"cannot write to standard output: {error.strerror}")
    return WRONG


def _say(text: str) -> None:
    # A terminal that has hung up takes no message, and the exit code still counts.
    with contextlib.suppress(OSError):
        typer.echo(f"taskspec: {chr(10).join(map(escaped, text.splitlines()))}", err=True)


def keep_trace(error: BaseException) -> Path:
    """Writes the traceback of an internal error to a file of its own."""
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", prefix="taskspec-crash-", suffix=".txt", delete=False
    ) as file:
        file.write("".join(traceback.format_exception(error)))
    return Path(file.name)
