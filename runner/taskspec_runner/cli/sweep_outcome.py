"""The result of a sweep on the console."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import typer
from rich.text import Text

from taskspec.text.units import number
from taskspec_runner.cli.console import show, table
from taskspec_runner.record.names import TABLE
from taskspec_runner.sweep.folder import PAGE
from taskspec_runner.sweep.result import SweepResult
from taskspec_runner.sweep.summary import (
    MET,
    UNDECIDED,
    drawn_text,
    interval_text,
    rate_text,
    so_far_text,
)

_STYLES = {MET: "bold green", UNDECIDED: "bold yellow"}
#: Influences that are shown, at most; and of how likely chance is at the most.
_MOST_INFLUENCES, _LARGEST_CHANCE = 6, 0.01


def show_sweep(result: SweepResult, *, quiet: bool) -> None:
    """Prints the verdicts, and what success depends on."""
    summary = result.summary
    if result.shard != (1, 1):
        number, of = result.shard
        typer.echo(f"share {number} of {of}: {summary['good']} of {summary['done']} worlds well")
        typer.echo(f"folder: {result.path}")
        return
    show(*verdict_lines(summary))
    if quiet:
        return
    show(_rates(summary))
    ends = ", ".join(f"{count} {how}" for how, count in summary["ends"].items())
    typer.echo(f"ends: {ends}")
    for line in _depends(result):
        typer.echo(line)
    if result.continued:
        typer.echo(f"{result.continued} worlds were there already")
    typer.echo(f"table: {result.path / TABLE}")
    # By itself in its line, so that a terminal makes a link of it.
    typer.echo(f"page: {result.path / PAGE}")


def verdict_lines(summary: Mapping[str, Any]) -> Iterator[Text]:
    """A line for each expectation of the sweep; without one, how likely success is."""
    for each in summary["judged"]:
        line = Text(each["verdict"].upper(), style=_STYLES.get(each["verdict"], "bold red"))
        line.append(f" {each['text']}: {rate_text(each)}", style="not bold default")
        if each["needed"] is not None:
            line.append(f"; some {_rounded(each['needed'])} more worlds would decide it",
                        style="not bold default")  # fmt: skip
        yield line
    if not summary["judged"]:
        yield Text(f"success in {rate_text(summary['success'])}")


def _rates(summary: Mapping[str, Any]) -> Any:
    sampled = summary["success"]["interval"] is not None
    broken_off = any(each["so_far"] for each in summary["expectations"])
    more = ["at 95 %"] * sampled + ["ended before"] * broken_off
    made = table("expectation", "met in", *more, right=("met in",))
    for each in summary["expectations"]:
        share = 100 * each["share"] if each["of"] else 0.0
        label = each["text"] if each["name"].isdecimal() else f"{each['name']}: {each['text']}"
        cells = [interval_text(each)] * sampled + [so_far_text(each)] * broken_off
        made.add_row(f"  {label}", f"{share:.4g} %", *cells)
    return made


def _depends(result: SweepResult) -> Iterator[str]:
    summary, task = result.summary, result.task
    shown = [e for e in summary["influences"] if e["chance"] < _LARGEST_CHANCE][:_MOST_INFLUENCES]
    if shown:
        parts = [
            f"{each['parameter']} {100 * each['explained']:.0f} % ({each['correlation']:+.2f})"
            for each in shown
        ]
        told_of = "share of the margin that it explains, rank correlation"
        yield f"what matters ({told_of}): {', '.join(parts)}"
    for each in summary["regions"]:
        yield each["text"]
    for worst in summary["worst"]:
        row = result.rows[worst["world"]]
        known = worst["margin"] is not None
        margin = f", margin {number(100 * worst['margin'], 3)} %" if known else ""
        so_far = " so far" if known and row["status"] != "done" else ""
        which = f"({summary['ends'][worst['end']]} {worst['end']})"
        world = f"world {worst['world']}{margin}{so_far}"
        yield f"worst {which}: {world}: {drawn_text(task, row)}"


def _worlds(numbers: Sequence[int]) -> str:
    """Numbers of worlds in words, such as `worlds 3, 17`."""
    return f"world{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def _rounded(count: int) -> str:
    """A count to two digits."""
    digits = max(len(str(count)) - 2, 0)
    return str(round(count, -digits))
