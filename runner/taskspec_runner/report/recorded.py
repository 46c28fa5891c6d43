"""What was recorded of a log that came from elsewhere: its rate, its samples, its columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath

from markupsafe import Markup

from taskspec_runner.pages.document import DASH, fold, note, right, section, table
from taskspec_runner.pages.html import code
from taskspec_runner.pages.numbers import figure as digits
from taskspec_runner.record.folder import Json, mapping, mappings, number
from taskspec_runner.runs import Run

_STAGES = {
    "column": "by a column that names them",
    "times": "by times in the column map",
    "guards": "by the guards of the task file",
}
_REPEATED = {"last": "the last", "first": "the first", "mean": "the mean"}


def rates(run: Run) -> Iterator[str]:
    """What was recorded together, and how often, such as `2001 samples at 500 Hz`."""
    for each in mappings(mapping(run.summary.get("recorded")).get("clocks")):
        of = f"{each['of']}: " if each.get("of") else ""
        text = f"{of}{each['samples']} samples at {number(each['rate']) or 0.0:.4g} Hz"
        if each.get("repeated"):
            counts = _REPEATED[str(each["repeated"])]
            text += f", in {each['stamps']} stamps of which {counts} of each counts"
        yield text


def facts(run: Run) -> Iterator[tuple[str, str]]:
    """The facts at the top of the page: of the log, and of nothing that is only in the file."""
    said = mapping(run.summary.get("recorded"))
    duration = number(run.summary.get("duration"))
    yield "Log", f"{said.get('log')} ({said.get('form')})"
    yield "Recorded", "; ".join(rates(run))
    gap = number(said.get("gap")) or 0.0
    yield (
        "Resampled",
        f"to {1e3 * run.period:.4g} ms, linearly; gaps up to {1e3 * gap:.4g} ms are bridged",
    )
    if said.get("base_turned"):
        yield "Base", "turned by half a turn about z, as the recorded tip and joints show"
    yield "Stages", _STAGES.get(str(said.get("stages")), "")
    yield "Duration", f"{run.end if duration is None else duration:.3f} s"


def columns(run: Run) -> Markup:
    """Signals of a log, and the column that each was taken from."""
    said = mapping(mapping(run.manifest.get("recorded")).get("columns"))
    lacking = mapping(run.summary.get("recorded")).get("not_recorded")
    rows = []
    for signal, each in said.items():
        column = mapping(each)
        unit = str(column.get("unit") or "").replace("*", "·") or DASH
        rows.append([code(signal), code(str(column.get("column"))), unit, _applied(column)])
    shown = table(["Signal", "Column", "Unit", right("Applied")], rows)
    missing = f"{len(lacking)} signals of a run were not recorded." if lacking else ""
    title = "Columns of the log"
    if not rows:
        return Markup("")
    return section("", fold(title, len(rows), shown, note(missing), look="more"))


def _applied(column: Json) -> str:
    """What was applied to a column: factor, offset, sign, axes."""
    parts = []
    scale, offset = number(column.get("scale")), number(column.get("offset"))
    if scale is not None:
        parts.append(f"× {digits(scale, 6)}")
    if offset is not None:
        parts.append(f"− ({digits(offset, 4)} SI)")
    parts.append("sign −" if column.get("sign") == -1 else "sign +")
    frame = mapping(column.get("frame"))
    if frame:
        turned = ", turned" if frame.get("rpy") else ""
        parts.append(f"axes of the {frame.get('of')}{turned}")
    return ", ".join(parts)


def without_paths(manifest: Json) -> Json:
    """A manifest for the foot of a page: names of files, and no columns, which have a table."""
    data = dict(manifest)
    if data.get("file"):
        data["file"] = PurePath(str(data["file"])).name
    if "recorded" in data:
        shown = ("columns", "clocks", "not_recorded")
        data["recorded"] = {k: v for k, v in mapping(data["recorded"]).items() if k not in shown}
    return data
