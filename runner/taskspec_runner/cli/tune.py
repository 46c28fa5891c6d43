"""`taskspec tune`: gains that succeed in all worlds that a task allows."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taskspec.compiler import compile_unchecked
from taskspec.spec.patch import PatchError, patched
from taskspec.text.units import number
from taskspec_runner import exit_codes
from taskspec_runner.cli.console import show, table
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.options import TuneOptions
from taskspec_runner.cli.parallel import processors
from taskspec_runner.cli.progress import described_line
from taskspec_runner.errors import InputError
from taskspec_runner.record.whole import write_whole
from taskspec_runner.sweep.statistics import Rate
from taskspec_runner.sweep.summary import rate_text
from taskspec_runner.tune.obstacles import failures
from taskspec_runner.tune.search import SearchGlimpse
from taskspec_runner.tune.tuned import Tuned, Wanted, tune

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

#: Failures that are shown, at most.
_MOST_FAILURES = 4


def tune_task(file: Path, given: TuneOptions) -> int:
    """Looks for gains of a task file, shows them, and writes them where that is wanted.

    Raises:
        InputError: the file expects nothing, has no gain to move, or cannot be patched.
        SpecError: the task is wrong.
    """
    for text in given.vary:
        if "=" not in text:
            raise InputError(
                "--vary needs PATH=INTERVAL, such as 'world.table.stiffness=8..90 N/mm', not "
                f"{text!r}"
            )
    loaded = load(file, given.changes)
    program = compile_unchecked(loaded)
    wanted = Wanted(
        given.gains,
        given.worlds,
        given.verify,
        given.budget,
        given.seed,
        given.jobs or processors(),
    )
    with described_line(_glimpse, shown=not given.quiet and sys.stderr.isatty()) as watch:
        found = tune(program, wanted, watch)
    if given.patch is not None and found.after.good:
        written = {**loaded.overrides, **found.overrides}
        try:
            write_whole(given.patch, patched(loaded.source.text, written))
        except PatchError as error:
            raise InputError(f"{given.patch} was not written: {error}") from error
    if given.form is RunFormat.JSON:
        data = found.as_data() | {"patch": None if given.patch is None else str(given.patch)}
        typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
    else:
        _show(found, given)
    return exit_codes.WELL if found.good else exit_codes.MISSED


def _show(found: Tuned, given: TuneOptions) -> None:
    show(_verdict(found))
    if given.quiet:
        return
    if found.moved:
        show(_gains(found))
    show(_margins(found))
    for line in _remarks(found):
        typer.echo(line)
    if found.obstacles:
        show(_intervals(found))
    if found.overrides and found.after.good:
        typer.echo("")
        for key, value in found.overrides.items():
            typer.echo(f"--set {shlex.quote(f'{key}={value}')}")
    if given.patch is not None and found.after.good:
        typer.echo(f"wrote {given.patch}")


def _verdict(found: Tuned) -> Text:
    from rich.text import Text

    good, of = _rate(found)
    if not found.after.good:
        line = Text("NOT FOUND", style="bold red")
        text = " gains that succeed in all worlds"
    else:
        line = Text("FOUND" if found.good else "NOT IN ALL", style="bold")
        line.stylize("green" if found.good else "yellow")
        text = f" gains that succeed in {good} of {of} worlds of the search"
        if found.before.good and not found.moved:
            text = f" no better gains than those of the file: {good} of {of} worlds succeed"
    line.append(text, style="not bold default")
    if found.verified is not None:
        line.append(f", and in {_of(found.verified[1])} fresh ones", style="not bold default")
    return line


def _of(rate: Rate) -> str:
    return f"{rate.good} of {rate.of}"


def _rate(found: Tuned) -> tuple[int, int]:
    return sum(row["success"] for row in found.after.rows.values()), len(found.after.rows)


def _gains(found: Tuned) -> Table:
    made = table("gain", "before", "after", indent=0)
    for each in found.moved:
        texts = (each.knob.text(values) for values in (each.before, each.after))
        made.add_row(each.knob.name, *texts)
    return made


def _margins(found: Tuned) -> Table:
    made = table("expectation", "least margin before", "after", indent=0,
                 right=("least margin before", "after"))  # fmt: skip
    for text, before, after in found.margins():
        made.add_row(text, _percent(before), _percent(after))
    return made


def _percent(margin: float | None) -> str:
    return "not run" if margin is None else f"{number(100 * margin, 3)} %"


def _remarks(found: Tuned) -> Iterator[str]:
    """What was wrong before, and what still is."""
    task = found.program.context.loaded.task
    before = failures(task, found.before)
    if before:
        yield f"before: {'; '.join(before[:_MOST_FAILURES])}"
    for text in found.before.weak:
        if text not in found.after.weak:
            yield f"margin before: {text}"
    after = failures(task, found.after) if not found.after.good else found.worst_fresh
    if after:
        yield f"after: {'; '.join(after[:_MOST_FAILURES])}"
    for text in found.after.weak:
        yield f"margin: {text}"
    if found.verified is not None:
        rates = [rate_text(rate.as_data()) for rate in found.verified]
        yield f"fresh worlds: {rates[0]} before; {rates[1]} after"
    yield f"{found.tried} settings were tried"


def _intervals(found: Tuned) -> Table:
    made = table("varies", "from .. to", "works", "beyond that", indent=0)
    for each in found.obstacles:
        interval = each.interval
        whole = (interval.draw.low, interval.draw.high)
        works = "not even if it is known"
        if each.works == whole:
            works = "all of it, with other gains"
        elif each.works is not None:
            works = interval.text(each.works)
        made.add_row(interval.name, interval.text(whole), works, "; ".join(each.fails[:2]))
    return made


def _glimpse(glimpse: SearchGlimpse) -> str:
    text = f"{glimpse.what}: {glimpse.tried} of up to {glimpse.most} settings"
    if glimpse.best is None:
        return text
    good = sum(row["success"] for row in glimpse.best.rows.values())
    margin = f", least margin {_percent(glimpse.best.key.worst)}" if glimpse.best.good else ""
    return f"{text}, best {good} of {len(glimpse.best.rows)} worlds well{margin}"
