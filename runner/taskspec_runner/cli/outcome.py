"""The outcome of a run as tables: expectations, tracking, why it ended."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

from taskspec.text.units import FORCE, LENGTH, MOMENT, Dimension, scaled
from taskspec_runner.cli.console import show, table
from taskspec_runner.exit_codes import FAILED, MISSED, STOPPED, UNDECIDED, WELL
from taskspec_runner.link.link import sentence
from taskspec_runner.loop.fixed_step import UNDECIDED as UNDECIDED_END
from taskspec_runner.record.fault_time import fault_times
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judged import title_of
from taskspec_runner.verdict.limit_effects import sentences
from taskspec_runner.verdict.outcome import is_measured, mirrored
from taskspec_runner.verdict.remarks import remarks

if TYPE_CHECKING:
    from rich.table import Table

_NOT_FINITE = "not finite"
_STYLES = {
    WELL: "bold green",
    **dict.fromkeys((MISSED, STOPPED, FAILED), "bold red"),
    **dict.fromkeys((UNDECIDED, 129, 130, 143), "bold yellow"),
}


def show_outcome(run: Run, *, quiet: bool) -> None:
    """Prints the outcome of a run; `quiet` leaves out all that went well."""
    from rich.text import Text

    missed = [e for e in run.summary["expectations"] if e["passed"] is not True]
    expectations = missed if quiet else run.summary["expectations"]
    if expectations:
        show(expectations_table(expectations, whole=run.summary["status"] == "done"))
    if run.summary["metrics"] and not quiet:
        show(*[""] * bool(expectations), _metrics(run.summary), "")
    if not quiet:
        for line in _truth(run.summary):
            show(line)
        if "link" in run.summary:
            show(sentence(run.summary["link"]))
        for line in (
            *mirrored(run),
            *_forced(run.summary),
            *sentences(run.summary),
            *_lost(run.summary),
            *remarks(run.summary),
        ):
            show(Text(line, style="yellow"))
    for fault in run.faults:
        show(Text(fault.line, style="red"))
    if not quiet or run.exit_code:
        show(Text(ending(run), style=_STYLES.get(run.exit_code, "")))
    if not quiet:
        # By itself in its line, so that a terminal makes a link of it.
        typer.echo(f"report: {run.report}")


def _truth(summary: Mapping[str, Any]) -> Iterator[str]:
    """Where the world or the robot differs from the nominal one, and what failed when."""
    world = summary.get("world") or {}
    parts = [f"{e['path']} {e['written'][1]} (nominal {e['written'][0]})" for e in world["differs"]]
    if parts:
        label = f"{world['label']}: " if world["label"] else ""
        yield f"{label}in truth {', '.join(parts)}"
    faults = [f"{each.text} ({each.when})" for each in fault_times(summary)]
    if faults:
        yield f"fault{'s' if len(faults) > 1 else ''} in truth: {', '.join(faults)}"


def ending(run: Run) -> str:
    """Why and when a run ended, and whether it met what was expected, in one line."""
    summary = run.summary
    end = summary["ending"]
    text = f"{summary['task']}: {summary['status']} at {end['clock']:.3f} s"
    if summary["status"] != "done":
        text += f" in stage {end['stage']}: {end['text']}"
    total = len(summary["expectations"])
    if total:
        passed = sum(e["passed"] is True for e in summary["expectations"])
        unjudged = sum(e["passed"] is None for e in summary["expectations"])
        sentences = f"{passed} of {total} expectations met"
        if unjudged:
            sentences += f", {unjudged} cannot be judged"
        broken = [e["broken"]["clock"] for e in summary["expectations"] if e["broken"]]
        if summary["status"] != "done":
            until = (
                "the log ends" if summary["status"] == UNDECIDED_END else f"it {summary['status']}"
            )
            sentences = f"so far: {sentences} until {until}"
        elif broken:
            sentences += f", the first broken at {min(broken):.3f} s"
        text += f"; {sentences}"
    if faults := len(run.faults):
        text += f"; {faults} finding{'s' if faults > 1 else ''} beside"
    if is_measured(run):
        return f"{text}; as measured"
    return f"{text}; {run.manifest['real_time_factor']:.3g} x real time"


def expectations_table(expectations: Sequence[Mapping[str, Any]], *, whole: bool) -> Table:
    """Expectations and what was measured; of a run that broke off, so far."""
    from rich.text import Text

    made = table("", "expected", "measured", indent=0)
    for entry in expectations:
        good = Text("pass", "green") if whole else Text("so far", "dim")
        mark = good if entry["passed"] else Text("FAIL", "bold red")
        if entry["passed"] is None:
            mark = Text("not recorded", "yellow")
        made.add_row(mark, Text(title_of(entry)), Text(entry["explanation"]))
    return made


def _metrics(summary: Mapping[str, Any]) -> Table:
    from rich.text import Text

    numbers = ["force RMS error", "peak force", "motion RMS error"]
    # No stage has a response where no force comes to rest.
    if summary["responses"]:
        numbers += ["overshoot", "settled after"]
    made = table("stage", *numbers, indent=0, right=tuple(numbers))
    # Of a log from elsewhere, a peak may be of what was not recorded.
    none = "-" if summary.get("recorded") or "link" in summary else _NOT_FINITE
    for stage, signals in summary["metrics"].items():
        cells = [
            stage,
            _worst(signals, "force.", FORCE),
            _readable(summary["peaks"][stage]["force"], FORCE, none),
            _worst(signals, "position.", LENGTH),
        ]
        if summary["responses"]:
            cells += _response(summary["responses"].get(stage, {}))
        made.add_row(*map(Text, cells))
    return made


def _response(signals: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Overshoot and settling time of the force that settled last, and on which axis.

    Of moments, where there are no forces. What a mechanism bears is not what a loop settles at.
    """
    own = {
        name: found
        for name, found in signals.items()
        if found["target"] == "set point" or name.split(".")[0] in ("force", "torque")
    }
    moments = {name: found for name, found in own.items() if "torque" in name.split(".")}
    forces = {name: found for name, found in own.items() if name not in moments} or moments
    if not forces:
        return ["-", "-"]

    def time(name: str) -> float:
        settled = forces[name]["settling_time"]
        return math.inf if settled is None else float(settled)

    last = max(forces, key=time)
    overshoot = forces[last]["overshoot"]
    kind, _, rest = last.partition(".")
    where = f" ({rest if kind in ('force', 'torque') else kind})"
    dimension = MOMENT if last in moments else FORCE
    settled = "never" if time(last) == math.inf else f"{time(last):.3f} s"
    return ["-" if overshoot is None else scaled(overshoot, dimension, 3), settled + where]


def _forced(summary: Mapping[str, Any]) -> Iterator[str]:
    """The errors in spite of which it was run; nothing without any."""
    if summary["forced"]:
        yield f"run in spite of {', '.join(summary['forced'])}"


def _lost(summary: Mapping[str, Any]) -> Iterator[str]:
    """Contacts that stages lost, a line each; nothing where none was lost."""
    for stage, contact in summary["contact"].items():
        if contact["losses"]:
            times = "once" if contact["losses"] == 1 else f"{contact['losses']} times"
            yield f"{stage}: contact was lost {times}, for {1e3 * contact['time']:.0f} ms in all"


def _worst(signals: Mapping[str, Mapping[str, float]], kind: str, dimension: Dimension) -> str:
    """The largest RMS error among the translations of a kind, and on which axis or equation."""
    equation = f".{kind.rstrip('.')}"
    errors = {
        name.removeprefix(kind).removesuffix(equation): values["rms_error"]
        for name, values in signals.items()
        if (name.startswith(kind) and not name.startswith(f"{kind}r")) or name.endswith(equation)
    }
    if not errors:
        return "-"
    axis = max(errors, key=lambda name: math.inf if errors[name] is None else errors[name])
    return f"{_readable(errors[axis], dimension)} ({axis})"


def _readable(value: float | None, dimension: Dimension, none: str = _NOT_FINITE) -> str:
    """A number of a summary, in which those that are not finite are null."""
    return none if value is None else scaled(value, dimension, 3)
