"""`taskspec explain`: what a task makes of itself, or what a diagnostic code means."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import typer
from rich.console import RenderableType
from rich.markdown import Markdown
from rich.table import Table
from rich.text import Text

from taskspec.compiler import compile_task
from taskspec.text.codes import CODES
from taskspec.text.suggest import suggestion
from taskspec_runner.cli.account import StageAccount, frame_accounts, robot_account, stage_account
from taskspec_runner.cli.console import console, show, table
from taskspec_runner.cli.defaults import defaults_taken
from taskspec_runner.cli.findings import show_findings
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.objects import object_accounts
from taskspec_runner.cli.pages import page
from taskspec_runner.cli.poles import StabilityAccount, stability_account
from taskspec_runner.errors import InputError

_CODE = re.compile(r"TS\d{3}\Z", re.IGNORECASE)


def explain_what(what: str, sets: Sequence[str] = (), law: str | None = None) -> int:
    """Explains a task file under overrides, or a code if there is no such file."""
    if not Path(what).exists() and _CODE.match(what):
        _explain_code(what.upper())
    else:
        _explain_file(Path(what), sets, law)
    return 0


def _explain_code(code: str) -> None:
    """Shows the page of a diagnostic code: laid out on a terminal, as it is written elsewhere."""
    # By now the compiler's layers are imported, which register codes of their own.
    if code not in CODES:
        raise InputError(f"there is no diagnostic {code}; {suggestion(code, CODES)}".rstrip("; "))
    text = page(code) or f"# {code}: {CODES[code]}\n"
    out = console()
    if out.is_terminal:
        out.print(Markdown(text, code_theme="ansi_dark"))
    else:
        typer.echo(text, nl=False)


def _explain_file(path: Path, sets: Sequence[str], law: str | None) -> None:
    program = compile_task(load(path, sets, law))
    show_findings(program.warnings, program.context.loaded.sources, err=True)
    task = program.context.loaded.task
    about = [Text(task.about)] if task.about else []
    show(Text(task.name, style="bold"), *about, _pairs(robot_account(program)))
    if task.world:
        _section("world", _pairs(object_accounts(program)))
    frames = table("frame", "is", "task frame of")
    for frame in frame_accounts(program):
        frames.add_row(*_cells(frame.name, frame.described, ", ".join(frame.stages)))
    _section("frames", frames)
    for stage in program.stages:
        _show_stage(stage_account(program, stage))
        stability = stability_account(program, stage)
        if stability is not None:
            _show_stability(stability)
    if task.expect:
        _section("expected", *(Text(f"  {expectation.text}") for expectation in task.expect))
    _section("defaults taken", _pairs(defaults_taken(program)))


def _show_stage(stage: StageAccount) -> None:
    facts = (
        ("law", f"{stage.law}, equations {stage.equations}"),
        ("frame", stage.frame),
        ("contact", stage.contact),
        *([("null space", stage.null_space)] if stage.null_space else []),
        *stage.kept,
        *([("tare", "what the sensor shows here on average becomes its zero")] * stage.tare),
        *stage.ends,
    )
    axes = table("axis", "controlled by", "reference")
    for axis in stage.axes:
        axes.add_row(*_cells(axis.axis, axis.control, axis.reference))
    gains = table("gain", "on", "value", "from", right=("value",))
    for gain in stage.gains:
        gains.add_row(*_cells(gain.gain, " ".join(gain.axes), gain.value, gain.origin))
    _section(f"stage {stage.name}", _pairs(facts), "", axes, "", gains)


def _show_stability(stability: StabilityAccount) -> None:
    poles = table("poles of", "frequency", "damping", "time constant", "", right=("time constant",))
    for pole in stability.poles:
        poles.add_row(*_cells(pole.axis, pole.frequency, pole.damping, pole.time, pole.verdict))
    bounds = table("stable for", "is", "bound", "by", right=("is",))
    for bound in stability.bounds:
        bounds.add_row(*_cells(bound.what, bound.now, bound.bound, bound.source))
    show("", Text(f"  predicted with {stability.where}"), poles)
    if stability.bounds:
        show("", bounds)


def _section(heading: str, *things: RenderableType) -> None:
    show("", Text(heading, style="bold"), *things)


def _pairs(pairs: Iterable[tuple[str, str]]) -> Table:
    made = table("", "")
    made.show_header = False
    for key, value in pairs:
        made.add_row(*_cells(key, value))
    return made


def _cells(first: str, *others: str) -> list[Text]:
    return [Text(f"  {first}"), *map(Text, others)]
