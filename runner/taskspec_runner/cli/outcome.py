"""How a run went, as tables: what was expected, how well it was tracked, why it ended."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from taskspec_runner.cli.console import console, table
from taskspec_runner.session import RunResult

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

_STYLES = {0: "bold green", 1: "bold red", 4: "bold red", 130: "bold yellow"}
_WORDS = {"done": "done", "failed": "failed", "stopped": "stopped"}


def show_outcome(result: RunResult, *, quiet: bool) -> None:
    """Prints the outcome of a run; `quiet` leaves out all that went well."""
    from rich.text import Text

    out = console()
    missed = [e for e in result.summary["expectations"] if not e["passed"]]
    expectations = missed if quiet else result.summary["expectations"]
    if expectations:
        out.print(_expectations(expectations))
    if not quiet:
        if expectations:
            out.print()
        if result.summary["metrics"]:
            out.print(_metrics(result.summary))
            out.print()
    if not quiet or result.exit_code:
        out.print(Text(ending(result), style=_STYLES.get(result.exit_code, "")))
    if not quiet:
        out.print(Text(f"report: {result.report}"), soft_wrap=True)


def ending(result: RunResult) -> str:
    """Why and when a run ended, and whether it met what was expected, in one line."""
    summary = result.summary
    end, word = summary["ending"], _WORDS[summary["status"]]
    name = "" if end["reason"] in ("end", "interrupted") else f" ({end['reason']})"
    text = f"{summary['task']}: {word}{name} in stage {end['stage']} at {end['clock']:.3f} s"
    text += f": {end['text']}"
    total = len(summary["expectations"])
    passed = sum(e["passed"] for e in summary["expectations"])
    if total:
        text += f"; {passed} of {total} expectations met"
    return f"{text}; {result.real_time_factor:.3g} x real time"


def _expectations(expectations: list[Mapping[str, Any]]) -> Table:
    from rich.text import Text

    made = table("", "expected", "measured", indent=0)
    for entry in expectations:
        mark = Text("pass", "green") if entry["passed"] else Text("FAIL", "bold red")
        made.add_row(mark, Text(entry["text"]), Text(entry["explanation"]))
    return made


def _metrics(summary: Mapping[str, Any]) -> Table:
    from rich.text import Text

    numbers = ("force RMS error", "peak force", "motion RMS error")
    made = table("stage", *numbers, indent=0, right=numbers)
    for stage, signals in summary["metrics"].items():
        made.add_row(
            Text(stage),
            _worst(signals, "force.", 1.0, "N"),
            Text(f"{summary['peaks'][stage]['force']:.4g} N"),
            _worst(signals, "position.", 1e3, "mm"),
        )
    return made


def _worst(signals: Mapping[str, Mapping[str, float]], kind: str, scale: float, unit: str) -> Text:
    """The largest RMS error among the translations of a kind, and on which axis."""
    from rich.text import Text

    errors = {
        name.removeprefix(kind): values["rms_error"]
        for name, values in signals.items()
        if name.startswith(kind) and not name.startswith(f"{kind}r")
    }
    if not errors:
        return Text("-")
    axis = max(errors, key=lambda name: errors[name])
    return Text(f"{errors[axis] * scale:.3g} {unit} ({axis})")
