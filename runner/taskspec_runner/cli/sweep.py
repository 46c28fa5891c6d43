"""`taskspec sweep`: a task in many worlds, from its file to how likely it succeeds."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.options import SweepOptions, TaskOptions, WatchOptions
from taskspec_runner.cli.parallel import processors
from taskspec_runner.cli.progress import described_line
from taskspec_runner.cli.run import admitted
from taskspec_runner.errors import InputError
from taskspec_runner.loop.interrupt import Termination
from taskspec_runner.record.names import TABLE
from taskspec_runner.sweep.executors import workers
from taskspec_runner.sweep.folder import PAGE, open_sweep, read_written
from taskspec_runner.sweep.kept import check as check_keep
from taskspec_runner.sweep.progress import describe
from taskspec_runner.sweep.result import SweepResult
from taskspec_runner.sweep.session import SweepGlimpse, Watch, merged, sweep
from taskspec_runner.sweep.worlds import Worlds

if TYPE_CHECKING:
    from taskspec.spec import Task
    from taskspec_runner.live.watched_sweep import WatchedSweep

#: Worlds where neither the file nor an option says how many.
WORLDS = 100


def sweep_task(file: Path, given: SweepOptions, watched: WatchOptions) -> int:
    """Runs a task file in many worlds and reports their statistics.

    With a page that shows it, the command ends when nobody watches that any more.
    """
    count, port = given.worlds, watched.place
    if sum((given.corners, given.grid is not None, count is not None)) > 1:
        raise InputError("--worlds, --corners and --grid each say which worlds: keep one of them")
    share = _share(given.shard)
    check_keep(given.keep)
    program = admitted(file, TaskOptions(given.sets), force=given.force)
    task = program.context.loaded.task
    if count is None:
        count = task.sweep.worlds if task.sweep is not None else WORLDS
    worlds = Worlds.of(
        program.context, given.seed, count, corners=given.corners, points=given.grid or 0
    )
    with _page(task, port) if watched.watch else nullcontext() as page:
        with (
            Termination(),
            workers(given.executor, given.jobs or processors()) as found,
            described_line(describe, shown=not given.quiet and sys.stderr.isatty()) as line,
        ):
            watches = [line, None if page is None else page.watch]
            result = sweep(
                program,
                worlds,
                given.out,
                workers=found,
                shard=share,
                keep=given.keep,
                watch=_together([watch for watch in watches if watch is not None]),
            )
        if page is not None:
            page.end()
        code = _told(result, quiet=given.quiet, form=given.form)
        if page is not None:
            page.server.wait()
    return code


def _page(task: Task, port: int) -> WatchedSweep:
    from taskspec_runner.live.server import announce
    from taskspec_runner.live.watched_sweep import WatchedSweep

    page = WatchedSweep(task, port)
    announce(page.server.url)
    return page


def _together(watches: Sequence[Watch]) -> Watch | None:
    if not watches:
        return None

    def watch(glimpse: SweepGlimpse) -> None:
        for each in watches:
            each(glimpse)

    return watch


def merge_parts(parts: Sequence[Path], given: SweepOptions) -> int:
    """Puts shares of a sweep together and reports their statistics."""
    read = [read_written(path) for path in parts]
    first = read[0]
    for path, part in zip(parts, read, strict=True):
        if part.said["identity"] != first.said["identity"]:
            raise InputError(f"{path} and {parts[0]} are of different sweeps")
    # Whatever else the task reads was read where its shares were run, but for what it includes.
    task = first.task.task
    said = {key: first.said[key] for key in first.said if key in _OPENING} | {"shard": [1, 1]}
    with open_sweep(given.out, task.name, said) as folder:
        folder.begin(first.content)
        result = merged(task, [part.rows for part in read], folder, first.count)
    return _told(result, quiet=given.quiet, form=given.form)


_OPENING = (
    "format",
    "task",
    "file",
    "overrides",
    "force",
    "worlds",
    "bundle",
    "inputs",
    "identity",
    "versions",
)


def _share(text: str | None) -> tuple[int, int]:
    """The share that `i/n` names."""
    if text is None:
        return 1, 1
    number, _, of = text.partition("/")
    if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
        raise InputError(f"--shard takes i/n with i from 1 to n, such as 2/8, not {text!r}")
    return int(number), int(of)


def _told(result: SweepResult, *, quiet: bool, form: RunFormat) -> int:
    from taskspec_runner.cli.sweep_outcome import show_sweep

    if form is RunFormat.JSON:
        files = {"table": TABLE, "page": PAGE} if result.shard == (1, 1) else {}
        where = {"folder": str(result.path)}
        where |= {what: str(result.path / name) for what, name in files.items()}
        typer.echo(json.dumps({**result.summary, **where}, indent=2, ensure_ascii=False))
    else:
        show_sweep(result, quiet=quiet)
    return int(result.summary["exit_code"])
