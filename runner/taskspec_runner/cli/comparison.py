"""How laws compare, as tables: one of the laws, and one for each stage with a force to reach."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from taskspec.text.units import FORCE, LENGTH, MOMENT, scaled
from taskspec.text.units import show as show_in
from taskspec_runner.cli.console import show, table
from taskspec_runner.compare.attempt import AS_WRITTEN
from taskspec_runner.compare.comparison import Comparison
from taskspec_runner.compare.tracking import best

if TYPE_CHECKING:
    from rich.table import Table

_STYLES = {
    "passed": "bold green",
    "done": "bold",
    "missed": "yellow",
    "interrupted": "bold yellow",
    "not run": "dim",
}
_force = partial(scaled, dimension=FORCE, digits=3)
_moment = partial(show_in, unit=MOMENT, digits=3)
_length = partial(scaled, dimension=LENGTH, digits=3)
#: Heading -> the value it stands for, and how that is written; the first of a kind has its axis.
_COLUMNS: dict[str, tuple[tuple[str, str], Callable[[float], str]]] = {
    "force RMS": (("force", "rms_error"), _force),
    "force peak": (("force", "max_error"), _force),
    "force final": (("force", "final_error"), _force),
    "moment RMS": (("torque", "rms_error"), _moment),
    "moment final": (("torque", "final_error"), _moment),
    "motion RMS": (("motion", "rms_error"), _length),
    "motion peak": (("motion", "max_error"), _length),
}


def show_comparison(summary: Mapping[str, Any], *, quiet: bool) -> None:
    """Prints a comparison; `quiet` leaves out all but the laws that missed an expectation."""
    from rich.text import Text

    comparison = Comparison(summary, {})
    laws = [law for law in comparison.laws if not quiet or law["outcome"] not in ("passed", "done")]
    if laws:
        show(_laws(laws))
    if not quiet:
        for stage in comparison.stages:
            show("", Text(f"stage {stage}: errors", style="bold"), _stage(comparison, stage))
        show("", *(Text(f"note: {note}", style="dim") for note in summary["notes"]))
    if not summary["comparable"]:
        ran = [law["law"] for law in comparison.laws if "met" in law and law["law"] != AS_WRITTEN]
        sentence = (
            f"only {ran[0]} can do this task" if ran else "none of these laws can do this task"
        )
        show(Text(f"{sentence}, so there is nothing to compare", "bold red"))


def _laws(laws: list[Mapping[str, Any]]) -> Table:
    from rich.text import Text

    made = table("law", "rank", "outcome", "met", "lasted", "peak force", "why", indent=0,
                 right=("rank", "lasted", "peak force"))  # fmt: skip
    for law in laws:
        ran = "met" in law
        made.add_row(
            Text(law["law"], "bold" if law["law"] == AS_WRITTEN else ""),
            Text(str(law["rank"] or "-")),
            Text(law["outcome"], _STYLES.get(law["outcome"], "bold red")),
            Text(f"{law['met']} of {law['expected']}" if ran else "-"),
            Text(f"{law['duration']:.3f} s" if ran else "-"),
            Text(_peak(law["peak_force"]) if ran else "-"),
            Text(law["reason"]),
        )
    return made


def _peak(force: float | None) -> str:
    return "not finite" if force is None else _force(force)


def _stage(comparison: Comparison, stage: str) -> Table:
    """A row for each run; the least value of a column is bold, a stage broken off is dim."""
    from rich.text import Text

    rows = comparison.rows(stage)
    columns = {
        heading: (path, said)
        for heading, (path, said) in _COLUMNS.items()
        if any(row and row[path[0]] for row in rows.values())
    }
    headings = (*columns, "lasted")
    made = table("law", *headings, indent=0, right=headings)
    least = {heading: best(rows, *path) for heading, (path, _) in columns.items()}
    for law, row in rows.items():
        broken = "dim" if row is None or not row["planned"] else ""
        cells = [
            Text(_cell(row, path, said), "bold green" if law in least[heading] else broken)
            for heading, (path, said) in columns.items()
        ]
        lasted = f"{row['duration']:.3f} s" if row else "-"
        made.add_row(Text(law, broken), *cells, Text(lasted, broken))
    return made


def _cell(
    row: Mapping[str, Any] | None, path: tuple[str, str], said: Callable[[float], str]
) -> str:
    kind, statistic = path
    found = row[kind] if row else None
    if not found:
        return "-"
    text = said(found[statistic])
    return f"{text} ({found['axis']})" if statistic == "rms_error" else text
