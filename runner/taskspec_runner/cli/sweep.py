"""`taskspec sweep`: a task in many worlds, from its file to how likely it succeeds."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer

from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.run import admitted
from taskspec_runner.errors import InputError
from taskspec_runner.loop.interrupt import Termination
from taskspec_runner.sweep.folder import TABLE
from taskspec_runner.sweep.session import SweepGlimpse, SweepResult, Watch, sweep
from taskspec_runner.sweep.worlds import Worlds

#: Worlds where neither the file nor an option says how many.
WORLDS = 100
#: Seconds between two looks.
_PAUSE = 0.2


def sweep_task(
    file: Path,
    sets: Sequence[str],
    seed: int,
    count: int | None,
    out: Path | None,
    *,
    corners: bool,
    grid: int | None,
    jobs: int | None,
    quiet: bool,
    form: RunFormat,
    force: bool,
) -> int:
    """Runs a task file in many worlds and tells what they say together."""
    from taskspec_runner.cli.sweep_outcome import show_sweep

    if sum((corners, grid is not None, count is not None)) > 1:
        raise InputError("--worlds, --corners and --grid each say which worlds: keep one of them")
    program = admitted(file, sets, None, force=force)
    task = program.context.loaded.task
    if count is None:
        count = task.sweep.worlds if task.sweep is not None else WORLDS
    worlds = Worlds.of(program.context, seed, count, corners=corners, points=grid or 0)
    with Termination(), _progress(shown=not quiet and sys.stderr.isatty()) as watch:
        result = sweep(program, worlds, out, jobs=jobs or _processors(), watch=watch)
    if form is RunFormat.JSON:
        where = {"folder": str(result.path), "table": str(result.path / TABLE)}
        typer.echo(json.dumps({**result.summary, **where}, indent=2, ensure_ascii=False))
    else:
        show_sweep(result, quiet=quiet)
    return int(result.summary["exit_code"])


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _progress(*, shown: bool) -> Iterator[Watch | None]:
    """Shows on standard error how far a sweep is."""
    if not shown:
        yield None
        return
    from rich.live import Live
    from rich.text import Text

    from taskspec_runner.cli.console import console

    last = 0.0
    with Live(console=console(err=True), auto_refresh=False, transient=True) as live:

        def watch(glimpse: SweepGlimpse) -> None:
            nonlocal last
            if time.monotonic() - last >= _PAUSE:
                last = time.monotonic()
                live.update(Text(describe(glimpse), no_wrap=True), refresh=True)

        yield watch


def describe(glimpse: SweepGlimpse) -> str:
    """A glimpse in one line."""
    share = 100 * glimpse.good / glimpse.done if glimpse.done else 0.0
    text = f"{glimpse.done} of {glimpse.of} worlds, {share:.1f} % well, {glimpse.rate:.1f} a second"
    return text if glimpse.left is None else f"{text}, {_span(glimpse.left)} left"


def _span(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


__all__ = ["SweepResult", "describe", "sweep_task"]
