"""How the command line begins and ends as a process."""

from __future__ import annotations

import atexit
import os
import sys
import threading
from io import TextIOWrapper

from taskspec_runner import headless
from taskspec_runner.cli.app import app
from taskspec_runner.cli.guard import is_lost, lost
from taskspec_runner.cli.parallel import collect_rarely


def main() -> None:
    """The command line as a process."""
    try:
        run()
    except SystemExit as end:
        _leave(end.code)
        raise


def _leave(code: object) -> None:
    """Ends the process where nothing is left to do but to free its memory, which the system does.

    Python would take every object down by itself, an eighth of the time of validating a file.
    """
    finish = getattr(atexit, "_run_exitfuncs", None)
    hosted = sys.stdout is not sys.__stdout__ or threading.active_count() > 1
    if finish is None or hosted or not isinstance(code, int | None):
        return
    finish()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        return
    os._exit(code or 0)


def run() -> None:
    """The command line in a process that is the caller's; it ends with `SystemExit`."""
    headless.set_aside()
    # Threads for matrices as small as these take longer to begin than all products of them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Nor has a plugin of pydantic a part in a task file: to look for some in all that is installed
    # takes longer than to read one.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    collect_rarely()
    # Python has no stream where the shell has closed it; what is written there is lost anyway.
    sys.stdout = sys.stdout or os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    sys.stderr = sys.stderr or os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:
        # The help is printed where no command guards it.
        if not is_lost(error):
            raise
        sys.exit(lost(error))
