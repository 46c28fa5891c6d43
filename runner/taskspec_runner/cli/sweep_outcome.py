"""What a sweep came to, on the console."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import typer
from rich.text import Text

from taskspec.text.units import scaled
from taskspec_runner.cli.console import show, table
from taskspec_runner.sweep.folder import TABLE
from taskspec_runner.sweep.session import SweepResult
from taskspec_runner.sweep.summary import MET, UNDECIDED, dimension_of

_STYLES = {MET: "bold green", UNDECIDED: "bold yellow"}
#: Influences that are told, at most; and of how likely chance is at the most.
_MOST, _CHANCE = 6, 0.01


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


def rate_text(rate: Mapping[str, Any]) -> str:
    """Such as `987 of 1000 worlds, 98.7 % (97.8 to 99.2 %)`."""
    low, high = (100 * each for each in rate["interval"])
    share = 100 * rate["share"] if rate["of"] else 0.0
    return f"{rate['good']} of {rate['of']} worlds, {share:.4g} % ({low:.4g} to {high:.4g} %)"


def _rates(summary: Mapping[str, Any]) -> Any:
    made = table("expectation", "met in", "at 95 %", right=("met in",))
    for each in summary["expectations"]:
        low, high = (100 * end for end in each["interval"])
        share = 100 * each["share"] if each["of"] else 0.0
        made.add_row(f"  {each['text']}", f"{share:.4g} %", f"{low:.4g} to {high:.4g} %")
    return made


def _depends(result: SweepResult) -> Iterator[str]:
    summary, task = result.summary, result.task
    told = [e for e in summary["influences"] if e["chance"] < _CHANCE][:_MOST]
    if told:
        parts = [f"{each['parameter']} {each['correlation']:+.2f}" for each in told]
        yield f"what matters (rank correlation with the margin): {', '.join(parts)}"
    for each in summary["regions"]:
        yield each["text"]
    if looked_at := summary.get("foretold"):
        yield foretold_text(looked_at)
    worst = summary["worst"]
    if worst is not None:
        row = result.rows[worst["world"]]
        values = [
            f"{name} = {scaled(value, dimension_of(task, name), 3)}"
            for name, value in row.items()
            if name.startswith(("world.", "robot.")) and value is not None
        ]
        yield f"worst: world {worst['world']}, margin {100 * worst['margin']:.3g} %: " + ", ".join(
            values
        )


def foretold_text(told: Mapping[str, Any]) -> str:
    """How validate's findings about single worlds compare with what became of them."""
    parts = []
    for kind in ("failed", "good"):
        found = told[kind]
        if found["of"]:
            codes = f" ({', '.join(found['codes'])})" if found["codes"] else ""
            parts.append(f"{found['announced']} of {found['of']} {kind} ones{codes}")
    return f"validate warns of trouble in {' and '.join(parts)} that were looked at"


def _rounded(count: int) -> str:
    """A count to two digits."""
    digits = max(len(str(count)) - 2, 0)
    return str(round(count, -digits))
