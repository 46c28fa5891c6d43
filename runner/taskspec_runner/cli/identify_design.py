"""`taskspec identify --design`: a task that would tell what the logs do not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taskspec.text.units import number
from taskspec_runner.cli.console import console, show, table
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.options import IdentifyOptions
from taskspec_runner.errors import InputError
from taskspec_runner.exit_codes import MISSED, WELL
from taskspec_runner.identify.design import DesignedTask, design
from taskspec_runner.identify.identification import Identification, identify
from taskspec_runner.identify.written import shown, unit_of
from taskspec_runner.record.folder import plain
from taskspec_runner.record.whole import write_whole

if TYPE_CHECKING:
    from rich.table import Table


def design_task(file: Path, logs: list[Path], chosen: IdentifyOptions) -> int:
    """Designs a task that identifies what is wanted, by default what the logs do not tell."""
    assert chosen.design is not None
    if chosen.page is not None:
        raise InputError("--page shows what logs say; give it without --design")
    loaded = load(file, chosen.sets)
    level, what = chosen.level / 100, chosen.paths
    with console(err=True).status("design") as status:
        known: Identification | None = None
        if logs:
            known = identify(loaded, logs, None, level, chosen.columns)
            if what is None:
                what = _unidentified(known)
        made = design(
            loaded,
            what,
            chosen.width / 100,
            level,
            known,
            lambda doing: status.update(f"design: {doing}"),
        )
    write_whole(chosen.design, made.text)
    if chosen.form is RunFormat.JSON:
        data = made.as_data() | {"file": str(chosen.design)}
        typer.echo(json.dumps(plain(data), indent=2, ensure_ascii=False))
    else:
        _show(made, chosen)
    return WELL if made.met else MISSED


def _unidentified(known: Identification) -> list[str] | None:
    """Paths of values that logs do not identify; all where they identify everything."""
    names = [*known.unseen, *(name for group in known.confounded for name in group.names)]
    paths = [name.split(" ")[0] for name in names]
    return [*dict.fromkeys(paths)] or None


def _show(made: DesignedTask, chosen: IdentifyOptions) -> None:
    from rich.text import Text

    show(_table(made, chosen))
    for name in made.unidentified:
        show(Text(f"it does not identify {name}", "yellow"))
    for remark in made.remarks:
        typer.echo(remark)
    typer.echo(
        f"{number(made.duration, 3)} s, at most {number(made.peak, 3)} N of "
        f"{number(made.limit, 3)} N in trials, its contact half and twice as stiff among them"
    )
    typer.echo(f"file: {chosen.design}")


def _table(made: DesignedTask, chosen: IdentifyOptions) -> Table:
    from rich.text import Text

    half = f"half of the {chosen.level:g} % interval"
    lines = table("value", "expected", half, "wanted", "", indent=0, right=("expected",))
    for each in made.predicted:
        of, unit = each.estimate, unit_of(each.estimate)
        cells = (
            of.name,
            shown(of.value, unit, of.deviation),
            shown(each.half, unit, each.half / 10),
            shown(each.wanted, unit, each.wanted / 10),
        )
        mark = Text("met") if each.met else Text("not met", "yellow")
        lines.add_row(*map(Text, cells), mark)
    return lines
