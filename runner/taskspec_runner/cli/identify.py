"""`taskspec identify`: values of a task's world and arm from logs, with intervals."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taskspec.spec import load_text
from taskspec.spec.patch import PatchError, patched
from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.console import console, show, table
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.given import STDIN
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.options import IdentifyOptions
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.exit_codes import WELL
from taskspec_runner.identify.identification import Identification, identify
from taskspec_runner.identify.residual import ChannelResidual, surprises
from taskspec_runner.identify.written import file_values, set_lines, shown, unit_of
from taskspec_runner.record.folder import plain
from taskspec_runner.record.whole import check_writable

if TYPE_CHECKING:
    from rich.table import Table


def identify_task(file: Path, logs: list[Path], chosen: IdentifyOptions) -> int:
    """Identifies values of a task from logs, and shows them."""
    target, page = _target(file, chosen), _page(chosen)
    loaded = load(file, chosen.sets)
    with console(err=True).status("identify") as status:
        found = identify(
            loaded,
            logs,
            chosen.paths,
            chosen.level / 100,
            chosen.columns,
            lambda doing: status.update(f"identify: {doing}"),
            chosen.held_out or (),
        )
    if target is not None:
        _write(found, target)
    if page is not None:
        _write_page(found, page)
    if chosen.form is RunFormat.JSON:
        typer.echo(json.dumps(plain(found.as_data()), indent=2, ensure_ascii=False))
    else:
        _show(found)
    if target is not None:
        typer.echo(f"file: {target}", err=chosen.form is RunFormat.JSON)
    if page is not None:
        typer.echo(f"page: {page}", err=chosen.form is RunFormat.JSON)
    return WELL


def _target(file: Path, chosen: IdentifyOptions) -> Path | None:
    """Where the file with the identified values goes, if anywhere.

    Raises:
        InputError: it cannot be written there.
    """
    if chosen.write and chosen.patch is not None:
        raise InputError("--patch writes another file, and --write the task file itself; give one")
    if not chosen.write and chosen.patch is None:
        return None
    if chosen.sets:
        raise InputError("a file is patched as it stands; give --patch or --write without --set")
    if file == STDIN and chosen.write:
        raise InputError("standard input cannot be written; give --patch OUT.YAML")
    return file if chosen.write else chosen.patch


def _page(chosen: IdentifyOptions) -> Path | None:
    """Where the page goes, if anywhere.

    Raises:
        InputError: it has not the name of a page.
        OutputError: it cannot be written.
    """
    page = chosen.page
    if page is None:
        return None
    if page.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--page writes HTML, not '{page.name}'; give it a name such as page.html")
    check_writable(page)
    return page


def _write_page(found: Identification, page: Path) -> None:
    """Writes the page.

    Raises:
        OutputError: it cannot be written.
    """
    from taskspec_runner.identify.page import write_page

    write_page(found, page)


def _write(found: Identification, target: Path) -> None:
    """Writes the file with the identified values.

    Raises:
        InputError: it would not say what was identified.
        OutputError: it cannot be written.
    """
    try:
        text = patched(found.loaded.source.text, file_values(found))
    except PatchError as error:
        raise InputError(f"{error}; give the identified values by --set") from error
    try:
        load_text(text, str(target), base=found.loaded.base)
    except SpecError as error:
        first = error.diagnostics[0]
        raise InputError(
            f"the file cannot take the identified values ({first.code}: {first.message}); give "
            "them by --set"
        ) from error
    try:
        target.write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise OutputError(target, str(error.strerror or error)) from error


def _show(found: Identification) -> None:
    from rich.text import Text

    show(_table(found))
    for line in _untold(found):
        show(Text(line, "yellow"))
    typer.echo(_left(found))
    for line in surprises(found.residuals):
        show(Text(f"warning: {line}", "yellow"))
    for each in found.held_out:
        typer.echo(_held_out(each))
    if found.estimates:
        show("", Text("in the file, or on the command line", "bold"))
        for line in set_lines(found):
            typer.echo(line)


def _table(found: Identification) -> Table:
    from rich.text import Text

    made = table("value", "identified", f"{100 * found.level:g} % interval", "in the file", "",
                 indent=0, right=("identified",))  # fmt: skip
    for each in found.estimates:
        unit = unit_of(each)
        low, high = (shown(x, unit, each.deviation) for x in (each.low, each.high))
        cells = (each.name, shown(each.value, unit, each.deviation),
                 f"{low} .. {high}", shown(each.declared, unit, 0.0))  # fmt: skip
        mark = Text("inside") if each.declared_inside else Text("outside", "yellow")
        made.add_row(*map(Text, cells), mark)
    return made


def _untold(found: Identification) -> Iterator[str]:
    """What the logs do not tell, a line each."""
    for group in found.confounded:
        yield f"not told apart: {', '.join(group.names)}"
        for each in group.known:
            ends = f"{each.low:.6g} .. {each.high:.6g}"
            yield f"  known is {each.text} = {each.value:.6g} ({ends}), in SI"
    if found.unseen:
        yield f"the logs show nothing of: {', '.join(found.unseen)}"


def _held_out(found: ChannelResidual) -> str:
    """What is predicted of a channel of a log that nothing was identified from."""
    return (
        f"held out, {found.log}: {found.channel} is predicted to {found.rms:.3g} {found.unit} rms, "
        f"{found.share:.1%} of its peak of {found.peak:.3g} {found.unit}, where "
        f"{found.at_peak:.3g} {found.unit} is predicted"
    )


def _left(found: Identification) -> str:
    parts = [
        f"{each.channel} {each.rms:.3g} of {each.size:.3g} {each.unit}"
        for each in found.residuals
        if each.size > 0
    ]
    return f"left unexplained, rms: {', '.join(parts)}"
