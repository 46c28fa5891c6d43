"""The page of a folder of runs: how each task went over time, and all folders, newest first."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from taskspec_runner.listing.kept import KeptFolder, TaskHistory, histories
from taskspec_runner.pages.document import (
    DASH,
    Cell,
    Cells,
    document,
    head,
    mark,
    note,
    right,
    section,
    table,
)
from taskspec_runner.pages.html import code, element, joined, prose
from taskspec_runner.record.whole import write_whole

#: Of a trend [px]: height, edges, the step from run to run, and the radius of a point.
_HEIGHT, _EDGE, _STEP, _RADIUS = 44.0, 7.0, 14.0, 4.0
_LOOKS = {True: "passed", False: "missed", None: "unfinished"}
#: Runs that a trend shows: the newest.
TREND = 40


def write_listing(root: Path, folders: Sequence[KeptFolder], path: Path) -> Path:
    """Writes the page of the folders below `root`, newest first.

    Raises:
        OutputError: it cannot be written.
    """
    return write_whole(path, render(root, folders, path.parent))


def render(root: Path, folders: Sequence[KeptFolder], beside: Path) -> str:
    """The page as text; its links count from the folder `beside`."""
    found = histories(folders)
    missing = sum(1 for each in found if each.misses_since)
    counted = f"{len(folders)} folder{'s' if len(folders) != 1 else ''}"
    about = f"{counted}, {len(found)} tasks and variants, {missing} of which miss now."
    return document(
        f"{root}: runs",
        head("taskspec runs", str(root), about),
        section("Tasks", table(
            ["", "Task", "Now", right("Margin"), "Misses since", f"Margin of the last {TREND}"],
            [_task(each, beside) for each in found], "judged",
        ) if found else Markup("")),
        note(
            "Margin: the least share of what the expectations allow that was left; of a sweep the "
            "share of worlds that succeeded. A trend ends on the right with the newest; what did "
            "not succeed lies on its line or below. A click on a point opens its report."
            if found else ""
        ),
        section("Folders, newest first", table(
            ["Started", "Task", "Verdict", right("Margin"), "Folder", "Why"],
            [_folder(each, beside) for each in folders], "laws",
        ) if folders else Markup("")),
        data=None,
        scripts=(),
        facts=Markup(""),
    )  # fmt: skip


def _task(history: TaskHistory, beside: Path) -> Cells:
    last, since = history.last, history.misses_since
    kind = "" if history.kind == "run" else f" ({history.kind})"
    when = DASH if since is None else _linked(since, since.when, beside)
    return Cells([
        DASH if last.good is None else mark(last.good),
        joined(element("b", last.task), f" {last.variant}" if last.variant else "", kind),
        last.verdict,
        margin_text(last.margin),
        Cell(when, "whole"),
        _trend(history.folders[-TREND:], beside),
    ], "open" if last.good is None else "good" if last.good else "bad")  # fmt: skip


def _folder(each: KeptFolder, beside: Path) -> Cells:
    label = joined(element("b", each.task), f" {each.variant}" if each.variant else "")
    return Cells([
        Cell(each.when, "whole"),
        label,
        Cell(each.verdict, f"outcome {_LOOKS[each.good]}"),
        margin_text(each.margin),
        _linked(each, code(str(each.path)), beside),
        prose(each.why),
    ])  # fmt: skip


def margin_text(margin: float | None) -> str:
    """A margin as a share, such as `37 %`."""
    if margin is None:
        return DASH
    return "< −100 %" if margin < -1.0 else f"{100 * margin:.0f} %".replace("-", "−")


def _linked(each: KeptFolder, text: object, beside: Path) -> Markup:
    if each.page is None:
        return joined(text)
    return element("a", text, href=_address(each.page, beside))


def _address(page: Path, beside: Path) -> str:
    return Path(os.path.relpath(page.resolve(), beside.resolve())).as_posix()


def _trend(folders: Sequence[KeptFolder], beside: Path) -> Markup:
    """A line through the margins of runs, a point for each, and a line at zero."""
    margins = [_drawn(each) for each in folders]
    low, high = min(*margins, 0.0), max(*margins, 0.0)
    tall = (_HEIGHT - 2.0 * _EDGE) / ((high - low) or 1.0)
    places = [(_EDGE + _STEP * i, _EDGE + (high - m) * tall) for i, m in enumerate(margins)]
    zero, width = _EDGE + high * tall, 2.0 * _EDGE + _STEP * (len(folders) - 1)
    dots = []
    for (x, y), each in zip(places, folders, strict=True):
        role = {True: "good", False: "bad", None: "muted"}[each.good]
        title = element("title", f"{each.when}: {each.verdict}, margin {margin_text(each.margin)}")
        dot = element("circle", title, cx=f"{x:.0f}", cy=f"{y:.1f}", r=_RADIUS,
                      fill=f"var(--{role})")  # fmt: skip
        dots.append(element("a", dot, href=_address(each.page, beside)) if each.page else dot)
    return element(
        "svg",
        element("path", d=f"M0 {zero:.1f}H{width:.0f}", stroke="var(--line)"),
        element("polyline", points=" ".join(f"{x:.0f},{y:.1f}" for x, y in places), fill="none",
                stroke="var(--soft)", stroke_width=1.2),
        *dots,
        viewBox=f"0 0 {width:.0f} {_HEIGHT:.0f}", width=f"{width:.0f}", height=f"{_HEIGHT:.0f}",
        class_="trend", role="img",
        aria_label=f"{len(folders)} runs, the last one {folders[-1].verdict}",
    )  # fmt: skip


def _drawn(each: KeptFolder) -> float:
    """The height of a point: what did not succeed lies on the line or below it."""
    margin = each.margin if each.margin is not None else 1.0 if each.good else 0.0
    return max(-1.0, min(margin, 1.0) if each.good else min(margin, 0.0))
