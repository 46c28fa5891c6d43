"""Exit codes: how every way in which a command can end is told to the shell.

0 well; 1 a task file is wrong, or a run missed what it expects; 2 usage, or a file that cannot be
read or written; 3 an internal error; 4 a safety stop; 130 interrupted.
"""

from __future__ import annotations

import functools
import os
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

import typer

from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.findings import show_findings
from taskspec_runner.errors import InputError, OutputError, RunCrashedError

P = ParamSpec("P")

WELL, WRONG, USAGE, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 130
#: What a shell reports of a command whose reader went away.
_PIPE = 141


def guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Ends the process with the code that a command returns, or that its exception stands for."""

    @functools.wraps(command)
    def inner(*args: P.args, **kwargs: P.kwargs) -> None:
        raise typer.Exit(_outcome(functools.partial(command, *args, **kwargs)))

    return inner


def _outcome(command: Callable[[], int]) -> int:
    try:
        return command()
    except (typer.Exit, typer.Abort, typer.BadParameter):
        raise
    except SpecError as error:
        show_findings(error.diagnostics, error.sources, err=True)
        return WRONG
    except (InputError, OutputError) as error:
        _say(str(error))
        return USAGE
    except BrokenPipeError:
        # Whatever is still buffered has no reader either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _PIPE
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED
    except RunCrashedError as error:
        _say(f"internal error: {error}")
        _say(f"what was logged is in {error.folder}; please report this with {error.trace}")
        return INTERNAL
    except Exception as error:
        _say(f"internal error: {type(error).__name__}: {error}")
        _say(f"please report this with {_keep_trace()}")
        return INTERNAL


def _say(text: str) -> None:
    typer.echo(f"taskspec: {text}", err=True)


def _keep_trace() -> Path:
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", prefix="taskspec-crash-", suffix=".txt", delete=False
    ) as file:
        file.write(traceback.format_exc())
    return Path(file.name)
