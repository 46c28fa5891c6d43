"""`taskspec explain`: what a task makes of itself, or what a diagnostic code means."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import typer
from rich.console import RenderableType
from rich.markdown import Markdown
from rich.table import Table
from rich.text import Text

from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.program.program import Program
from taskspec.text.codes import CODES
from taskspec.text.suggest import suggestion
from taskspec_runner.cli.codes import page
from taskspec_runner.cli.console import console, show, table
from taskspec_runner.cli.diagnostics import record, show_diagnostics
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.sheet.at_rest import grouped
from taskspec_runner.cli.sheet.axes import LEGEND
from taskspec_runner.cli.sheet.sheet import as_data, sheet
from taskspec_runner.cli.sheet.stability import StabilitySheet
from taskspec_runner.cli.sheet.stage import StageSheet
from taskspec_runner.cli.sheet.terms import TermsSheet
from taskspec_runner.errors import InputError
from taskspec_runner.record.whole import write_whole
from taskspec_runner.trial.check import TRIAL_TICKS
from taskspec_runner.trial.trial import Trial, trial

_PICTURES = (".svg", ".png")
_STATIC = "left out: --static"
_CODE = re.compile(r"TS\d{3}\Z", re.IGNORECASE)
#: To another page; its text is kept.
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:)[^)]+\)")


def explain_what(
    what: str,
    sets: Sequence[str] = (),
    law: str | None = None,
    form: RunFormat = RunFormat.TEXT,
    *,
    static: bool = False,
    terms: bool = False,
) -> int:
    """Explains a task file under overrides, or a code if there is no such file.

    Args:
        what: the file, or the code.
        sets: overrides of the file, as `KEY=VALUE`.
        law: a law that replaces those of the file.
        form: of what is shown.
        static: whether to leave the trial out.
        terms: whether to show the terms of operational space.
    """
    as_json = form is RunFormat.JSON
    if not Path(what).exists() and _CODE.match(what):
        _explain_code(what.upper(), as_json=as_json)
    else:
        _explain_file(Path(what), sets, law, as_json=as_json, static=static, terms=terms)
    return 0


def draw_task(
    what: str,
    out: Path | None,
    sets: Sequence[str],
    law: str | None,
    form: RunFormat,
    *,
    wanted: bool,
    terms: bool,
) -> int:
    """Draws a task file under overrides as a picture, before anything runs.

    Args:
        what: the file.
        out: the picture's file, whose ending says its format; None for NAME.svg.
        sets, law, form: as for `explain_what`.
        wanted: whether `--picture` was given.
        terms: whether terms of operational space are wanted, which no picture has.

    Raises:
        InputError: the options do not go together, or the ending is neither .svg nor .png.
    """
    from taskspec_runner.preview import TaskPicture

    if out is not None and not wanted:
        raise InputError(f"{out} is one argument too many; to draw the task add --picture")
    if terms:
        raise InputError("--picture shows no terms of operational space: leave out --terms")
    if out is not None and Path(what).suffix.lower() in _PICTURES:
        what, out = str(out), Path(what)
    if _CODE.match(what) and not Path(what).exists():
        raise InputError(f"--picture draws task files; {what.upper()} is a code")
    if out is not None and out.suffix.lower() not in _PICTURES:
        raise InputError(f"{out} is not the name of a picture; it ends in {' or '.join(_PICTURES)}")
    examined = examine(load(Path(what), sets, law), stability=False)
    program = admit(examined)
    assert examined.plan is not None
    show_diagnostics(program.findings, program.context.loaded.sources, err=True)
    path = out or Path(f"{Path(program.context.loaded.task.name).name}.svg")
    picture = TaskPicture(examined.plan)
    write_whole(path, picture.png() if path.suffix.lower() == ".png" else picture.svg())
    if form is RunFormat.JSON:
        _print({"picture": str(path), "diagnostics": [record(d) for d in program.findings]})
    else:
        typer.echo(f"picture: {path}")
    return 0


def _explain_code(code: str, *, as_json: bool) -> None:
    """Shows the page of a diagnostic code: laid out on a terminal, as Markdown elsewhere."""
    # By now the compiler's layers are imported, which register codes of their own.
    if code not in CODES:
        raise InputError(f"there is no diagnostic {code}; {suggestion(code, CODES)}".rstrip("; "))
    # Other pages lie in the repository, not beside the command.
    text = _LINK.sub(r"\1", page(code) or f"# {code}: {CODES[code]}\n")
    out = console()
    if as_json:
        _print({"code": code, "title": CODES[code], "page": text})
    elif out.is_terminal:
        out.print(Markdown(text, code_theme="ansi_dark"))
    else:
        typer.echo(text, nl=False)


def _explain_file(
    path: Path,
    sets: Sequence[str],
    law: str | None,
    *,
    as_json: bool,
    static: bool,
    terms: bool,
) -> None:
    # Poles and bounds of the sheet come from the same analysis, so that it is made once.
    program = admit(examine(load(path, sets, law), stability=False))
    shown = sheet(program, *((None, _STATIC) if static else _trial(program)), terms=terms)
    if as_json:
        _print(as_data(shown) | {"diagnostics": [record(d) for d in program.findings]})
        return
    show_diagnostics(program.findings, program.context.loaded.sources, err=True)
    about = [Text(shown.about)] if shown.about else []
    show(Text(shown.name, style="bold"), *about, _pairs((*shown.robot, ("trial", shown.how))))
    if shown.world:
        _section("world", _pairs(shown.world))
    if shown.live:
        live = table("param", "begins with", "may be", "goes there")
        for row in shown.live:
            live.add_row(*_cells(row.name, row.value, row.interval, row.rate))
        _section("live params", live)
    frames = table("frame", "is", "task frame of")
    for frame in shown.frames:
        frames.add_row(*_cells(frame.name, frame.described, ", ".join(frame.stages)))
    _section("frames", frames)
    for stage, stability in shown.stages:
        _show_stage(stage)
        if stability is not None:
            _show_stability(stability)
    if shown.expected:
        expected = table("expected", "in the trial") if shown.trial else table("expected")
        for title, came_to in shown.expected:
            expected.add_row(*_cells(title, *([came_to] if shown.trial else [])))
        show("", expected)
    _section("defaults taken", _pairs(shown.defaults))
    show("", Text(LEGEND, style="dim"))


def _trial(program: Program) -> tuple[Trial | None, str]:
    """The trial of a program, or why there is none."""
    try:
        return trial(program, ticks=TRIAL_TICKS), ""
    except InputError as error:
        return None, f"cannot begin: {error}"


def _show_stage(stage: StageSheet) -> None:
    facts = (
        ("law", f"{stage.law}, equations {stage.equations}"),
        ("frame", stage.frame),
        ("contact", stage.contact),
        *([("null space", stage.null_space)] if stage.null_space else []),
        *stage.selection,
        *stage.kept,
        *stage.beside,
        *([("tare", "what the sensor shows here on average becomes its zero")] * stage.tare),
        *stage.ends,
        *([] if stage.trial is None else stage.trial.rows),
        *_terms(stage.terms),
    )
    axes = table("axis", "natural constraint", "artificial constraint", "by")
    for axis in stage.axes:
        axes.add_row(*_cells(axis.axis, axis.natural, axis.artificial, axis.by))
    gains = table("gain", "on", "value", "from", right=("value",))
    for gain in stage.gains:
        gains.add_row(*_cells(gain.gain, " ".join(gain.axes), gain.value, gain.origin))
    _section(f"stage {stage.name}", _pairs(facts), "", axes, *_at_rest(stage), "", gains)


def _terms(terms: TermsSheet | str | None) -> tuple[tuple[str, str], ...]:
    if isinstance(terms, TermsSheet):
        return terms.rows
    return () if terms is None else (("terms", f"none: {terms}"),)


def _at_rest(stage: StageSheet) -> tuple[RenderableType, ...]:
    """What its signals settle at; nothing of a stage without any."""
    if not stage.at_rest:
        return ()
    if stage.trial is None or not stage.trial.visits:
        shown = table("by the law", "is", "from")
        for signal, *_, value, source in grouped(stage.at_rest):
            shown.add_row(*_cells(signal, value, source))
    else:
        shown = table("at rest", "set point", "is", "overshoot", "settled in", "by the law", "from")
        for row in grouped(stage.at_rest):
            shown.add_row(*_cells(*row))
    return "", shown


def _show_stability(stability: StabilitySheet) -> None:
    poles = table("poles of", "frequency", "damping", "time constant", "", right=("time constant",))
    for pole in stability.poles:
        poles.add_row(*_cells(pole.axis, pole.frequency, pole.damping, pole.time, pole.verdict))
    bounds = table("stable for", "is", "bound", "by", right=("is",))
    for bound in stability.bounds:
        bounds.add_row(*_cells(bound.what, bound.now, bound.bound, bound.source))
    show("", Text(f"  closed loop with {stability.where}"), poles)
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


def _print(data: dict[str, Any]) -> None:
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
