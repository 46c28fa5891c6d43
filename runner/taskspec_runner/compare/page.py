"""The page of a comparison: one HTML file that needs nothing beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from taskspec.text.units import FORCE
from taskspec_runner.compare.attempt import AS_WRITTEN
from taskspec_runner.compare.charts import charted
from taskspec_runner.compare.comparison import Comparison
from taskspec_runner.compare.folder import PAGE, PICTURE
from taskspec_runner.compare.overlay import CUT_SHORT, Overlay, overlay, role
from taskspec_runner.compare.picture import comparison_svg, counted, time_of
from taskspec_runner.compare.ranking import DESIGNED, EQUAL_BANDWIDTH, RANKED, compared_by
from taskspec_runner.compare.tracking import KINDS, best
from taskspec_runner.pages.document import (
    DASH,
    Cell,
    Cells,
    Heading,
    document,
    head,
    in_unit,
    mark,
    named,
    note,
    pairs,
    right,
    seconds,
    section,
    swatch,
    table,
    task_file,
)
from taskspec_runner.pages.html import element, joined, prose, small
from taskspec_runner.pages.numbers import quantity
from taskspec_runner.record.folder import RunFolder
from taskspec_runner.record.names import REPORT
from taskspec_runner.scene.page import arm_figure, beside, pictured

Json = Mapping[str, Any]

#: Ranks that the headline names.
_PODIUM = 3
_WORDS = {"rms_error": "RMS", "max_error": "peak", "final_error": "final"}
_LAW = Heading("Law", "law")


def write_comparison(comparison: Comparison, folder: Path) -> Path:
    """Writes `compare.html` and `compare.svg` into the folder of a comparison.

    Args:
        comparison: to write.
        folder: of it, with the runs below it.

    Returns:
        The path of the page.

    Raises:
        OutputError: the folder cannot be written.
    """
    into = RunFolder(folder)
    into.write(PICTURE, comparison_svg(comparison))
    return into.write(PAGE, render(comparison))


def render(comparison: Comparison) -> str:
    """The page of a comparison."""
    laid = overlay(comparison)
    summary, stages = comparison.summary, comparison.stages
    dashed = "Dashed laws have no force loop. " if laid and laid.dashed else ""
    data, drawn = charted(
        laid,
        ((law["law"], law["outcome"], law["reason"]) for law in comparison.laws),
        f"Force and motion, {time_of(laid)}" if laid else "",
        f"{dashed}A click on a law",
        lambda: comparison_svg(comparison),
    )
    return document(
        f"{summary['task']}: laws compared",
        head("taskspec compare", summary["task"], summary.get("about") or "", _ranking(comparison)),
        _laws(comparison),
        *(_stage(comparison, stage) for stage in stages),
        note(
            "Errors are reference − truth, the largest over the axes of a kind; bold: the least of "
            "the laws that went through the stage as planned, pale: the others. Motion counts the "
            "axes that no law gives a force." if stages else ""
        ),
        *(_gains(comparison, stage) for stage in stages),
        note(
            "Bold: another value than as written, or a gain that the law as written does not have; "
            "“file”: from the file, all others are designed." if stages else ""
        ),
        _expectations(comparison),
        _arms(comparison, laid) if data and laid else None,
        *drawn,
        task_file(laid.leading.task) if laid and laid.leading.task else "",
        data=data,
        scripts=("samples", "plot", "legend", "time", "scene"),
        facts=pairs(_facts(summary)),
    )  # fmt: skip


def _arms(comparison: Comparison, laid: Overlay) -> Markup:
    """The arm of the run that leads, and translucent in it that of the best other law."""
    shown = pictured(laid.leading)
    if shown is None:
        return Markup("")
    found = (law["law"] for law in comparison.laws)
    law = next((law for law in found if law in laid.runs and law != laid.lead), None)
    other = beside(laid.runs[law], law, role(law), laid.begins[law]) if law else None
    begin = laid.begins[laid.lead]
    shown_arm = arm_figure(shown, title=f"Arm {laid.under}", begin=begin, other=other)
    return section("Arms" if other else "Arm", shown_arm)


def _name(comparison: Comparison, law: str, *beside: object) -> Markup:
    """A law with how its lines are drawn."""
    dashed = any(each["law"] == law and not each["force_loop"] for each in comparison.laws)
    return joined(swatch(role(law), dashed=dashed), law, *beside)


def _ranking(comparison: Comparison) -> Markup | None:
    """The laws that came first, second and third, with their ranks."""
    ranked = sorted((x["rank"], x["law"]) for x in comparison.laws if x.get("rank"))
    shown = [element("span", element("b", r), f" {law}") for r, law in ranked if r <= _PODIUM]
    if not shown:
        return None
    kind = compared_by(comparison.summary["force_axes"])
    gains = EQUAL_BANDWIDTH if comparison.summary.get("equal") else DESIGNED
    return joined(
        element("p", *shown, class_="ranking"), note(RANKED.format(kind=kind), " ", gains)
    )


def _laws(comparison: Comparison) -> Markup:
    """What each law came to."""
    rows = []
    for law in comparison.laws:
        ran, outcome = "met" in law, law["outcome"]
        kind = small(law["kind"]) if law["kind"] != law["law"] else ""
        known = _name(comparison, law["law"], kind) if law["folder"] else law["law"] + kind
        bad = "bad" if outcome not in ("passed", "done", "missed") else outcome
        report = element("a", "report", href=f"{law['folder']}/{REPORT}") if ran else ""
        cells = [
            known,
            law.get("rank") or DASH,
            law["equations"],
            Cell(outcome, f"outcome {bad}"),
            f"{law['met']} of {law['expected']}" if ran else DASH,
            seconds(law.get("duration")),
            in_unit(quantity(law.get("peak_force"), FORCE)),
            prose(law["reason"]),
            report,
        ]
        rows.append(cells)
    numbers = map(right, ("Met", "Lasted", "Peak force"))
    others = len(rows) - 1
    outcomes = counted([law["outcome"] for law in comparison.laws])
    notes = [element("li", text) for text in comparison.summary["notes"]]
    return section(
        f"As written and {others} law{'s' if others != 1 else ''}: {outcomes}",
        table(
            [_LAW, right("Rank"), "Equations", "Outcome", *numbers, Heading("Why", "why"), ""],
            rows,
            "laws",
        ),
        element("ul", *notes, class_="notes") if notes else Markup(""),
    )


def _stage(comparison: Comparison, stage: str) -> Markup:
    """A table of a stage: one row a law, the least value of each column marked."""
    rows = comparison.rows(stage)
    columns = [
        (kind, statistic)
        for kind in KINDS
        if any(row and row[kind] for row in rows.values())
        for statistic in _WORDS
        # What is left of a motion error at the end says nothing that its peak does not.
        if statistic != "final_error" or kind in ("force", "torque")
    ]
    leaders = {column: best(rows, *column) for column in columns}
    shown = []
    for law, row in rows.items():
        cells = [_error(row, column, least=law in leaders[column]) for column in columns]
        lasted = seconds(row["duration"] if row else None)
        look = "" if row and row["planned"] else "broken"
        shown.append(Cells([_name(comparison, law), *cells, lasted], look))
    heads = (right(f"{kind} {_WORDS[statistic]}") for kind, statistic in columns)
    axes = comparison.summary["force_axes"].get(stage)
    forces = f": force on {', '.join(axes)}" if axes else ""
    return section(f"Stage {stage}{forces}", table([_LAW, *heads, right("Lasted")], shown, "laws"))


def _error(row: Json | None, column: tuple[str, str], *, least: bool = False) -> Cell:
    kind, statistic = column
    found = row[kind] if row else None
    value = quantity(found[statistic] if found else None, KINDS[kind].dimension)
    axis = f"RMS largest on {found['axis']}" if found else ""
    return Cell(in_unit(value), "least" if least else "", axis)


def _gains(comparison: Comparison, stage: str) -> Markup:
    """The gains of a stage beside what came of them; other values than those as written marked."""
    rows = comparison.rows(stage)
    gains = {law["law"]: law["gains"].get(stage, ()) for law in comparison.laws if law.get("gains")}
    own = {(g["name"], axis): g["value"] for g in gains.get(AS_WRITTEN, ()) for axis in g["axes"]}
    kind = next((k for k in KINDS if any(row and row[k] for row in rows.values())), "force")
    shown = []
    for law, found in gains.items():
        texts = []
        for gain in found:
            pairs_ = ((gain["name"], axis) for axis in gain["axes"])
            other = law != AS_WRITTEN and any(own.get(each) != gain["value"] for each in pairs_)
            origin = small("file") if gain["origin"] == "file" else None
            texts.append(
                element("span", gain["name"], small(", ".join(gain["axes"])), " ",
                        prose(gain["text"]), origin, class_=f"gain{' other' if other else ''}")
            )  # fmt: skip
        result = _error(rows.get(law), (kind, "rms_error"))
        shown.append([_name(comparison, law), result, element("span", *texts)])
    title = f"Gains in stage {stage}, and what came of them"
    return section(title, table([_LAW, right(f"{kind} RMS"), "Gains"], shown, "laws gains"))


def _expectations(comparison: Comparison) -> Markup:
    """Which law met what; what one that was cut short has met so far is pale."""
    ran = [law for law in comparison.laws if "met" in law]
    rows = []
    for each in comparison.summary["expectations"]:
        cells = []
        for law in ran:
            told = each["laws"][law["law"]]
            met = "so-far" if law["outcome"] in CUT_SHORT else "passed"
            sign = mark(bool(told["passed"]), ("met", "missed"))
            cells.append(Cell(sign, met if told["passed"] else "missed", told["explanation"]))
        rows.append([named(each.get("name") or "", each["text"]), *cells])
    return section("Expectations", table(["Expected", *(x["law"] for x in ran)], rows, "matrix"))


def _facts(summary: Json) -> Iterator[tuple[str, str]]:
    yield "task", str(summary["file"])
    yield "robot", str(summary.get("robot") or "")
    yield "seed", str(summary["seed"])
    yield "overrides", ", ".join(summary["overrides"]) or DASH
