"""The report as one HTML file that needs nothing beside it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from taskspec.program.execution.transition import FAIL
from taskspec.spec.servo import PLURALS, TORQUE
from taskspec_runner.link.link import sentence
from taskspec_runner.pages.chart import Chart, Section
from taskspec_runner.pages.document import (
    Cells,
    Heading,
    bar,
    button,
    document,
    dot,
    figure,
    head,
    mark,
    named,
    note,
    outcome,
    pairs,
    patience,
    right,
    seconds,
    section,
    sign,
    table,
)
from taskspec_runner.pages.html import code, element, expression, joined, prose
from taskspec_runner.pages.numbers import figure as digits
from taskspec_runner.pages.samples import density, page_data
from taskspec_runner.pages.timeline import Timeline, tints
from taskspec_runner.record.fault_time import fault_times
from taskspec_runner.record.folder import mapping, mappings, number
from taskspec_runner.record.history import commanded
from taskspec_runner.record.names import REPORT
from taskspec_runner.record.whole import write_whole
from taskspec_runner.report import annotated, figures, recorded, tables, to_rest
from taskspec_runner.report.events import events, fault_spans
from taskspec_runner.report.overview import overview_svg
from taskspec_runner.runs import Run
from taskspec_runner.scene.page import Pictured, arm_figure, pictured
from taskspec_runner.verdict.judged import SHARE, Judged, Margin
from taskspec_runner.verdict.outcome import (
    Verdict,
    first_broken,
    is_measured,
    is_recorded,
    mirrored,
    so_far,
    verdict,
)

#: The chart on which a limit is drawn, by its name.
_LIMITED = {
    "force": "force",
    "torque": "torque",
    "speed": "velocity",
    "deviation": "position error",
    "joint_position": "joint positions",
}
#: A checksum, and so many of its digits as tell it from others.
_CHECKSUM, _DIGITS = re.compile(r"[0-9a-f]{64}"), 12
#: A look shows no more than this share of a run to either side.
_PART = 0.3
#: A look at what went wrong shows its stage so far, at least and at most so long before and after
#: it [s].
_AROUND = (0.25, 1.0)


def write_report(run: Run) -> Path:
    """Writes `report.html` into the folder of a run; what the run lacks is left out of it.

    Returns:
        The path of the report.

    Raises:
        OSError: the folder cannot be written.
    """
    return write_whole(run.folder / REPORT, render(run, pictured(run)))


def render(run: Run, arm: Pictured | None = None) -> str:
    """The page of a run, with the arm where it is pictured."""
    parts = figures.sections(run)
    shown = to_rest.going_on(run, parts)
    charts = [chart for each in shown for chart in each.charts]
    main, said = _main(run, charts), verdict(run)
    time = Timeline.of(run)
    faults = [{"start": start, "end": end} for start, end in fault_spans(run)]
    data = page_data(time, charts, events(run), faults=faults, **to_rest.as_stage(run))
    title = _text(run.summary.get("task") or run.manifest.get("task")) or "run"
    kind = "taskspec judge, measured elsewhere" if run.manifest.get("recorded") else "taskspec run"
    return document(
        f"{title}: {said.kind}",
        head(kind, title, _text(run.summary.get("about")), _outcome(run, said, bool(charts))),
        *_first(run, time, main, parts, arm),
        _expectations(run, said),
        _findings(run),
        section("", pairs(_facts(run), "facts")),
        _truth(run),
        _stages(run),
        *(_charts(each, main) for each in shown),
        _of_tables("Responses", *tables.responses(run), _about_responses(run),
                   *map(note, tables.solver(run))),
        _of_tables("Tracking", *tables.tracking(run)),
        annotated.annotated_task(run),
        recorded.columns(run),
        data=data if charts else None,
        scripts=("samples", "plot", "legend", "time", "scene"),
        facts=pairs(_flat(recorded.without_paths(run.manifest))),
        remark=density(run, data["samples"]),
    )  # fmt: skip


def _outcome(run: Run, said: Verdict, drawn: bool) -> Markup:
    """The verdict, with a button that shows where to look for what went wrong."""
    around = _around(run)
    look = None
    if around and drawn:
        look = button("Show in charts", "look", data_start=around[0], data_end=around[1])
    word, first = sign(said.kind) + said.kind, said.first
    why = [element("p", prose(said.sentence))]
    suspected = [element("p", prose(text)) for text in mirrored(run)]
    if first is not None and first.broken is not None:
        stage = joined(" in stage ", element("b", said.stage)) if said.stage else None
        at, text = element("b", seconds(first.broken.clock)), expression(first.text)
        broken = joined(
            "At ", at, stage, ", ", text, " was broken: ", prose(first.broken.text), "."
        )
        why = [element("p", broken, id="first-broken"), element("p", said.rest, class_="rest")]
    return outcome(said.kind, word, *why, *suspected, beside=look, id="verdict")


def _first(
    run: Run, time: Timeline, main: Chart | None, parts: Sequence[Section], arm: Pictured | None
) -> tuple[Markup, ...]:
    """The arm and the chart to see first, below the buttons for the window of all."""
    if main is None:
        text = "The log holds no complete batch of ticks, so there is nothing to draw."
        seen = section("", arm_figure(arm, live=False)) if arm else None
        return tuple(each for each in (element("section", note(text)), seen) if each)
    place = [figure(main)] if arm is None else [arm_figure(arm), figure(main)]
    front = section("", joined(*place), look="charts main front" if arm else "charts main")
    return bar(time.stages(), "Whole run"), patience(Markup(overview_svg(run, parts=parts))), front


def _charts(part: Section, main: Chart | None) -> Markup:
    """A section without the chart that stands first."""
    shown = [figure(chart) for chart in part.charts if chart is not main]
    silent = f"Zero throughout and not drawn: {', '.join(part.silent)}." if part.silent else ""
    return section(part.title, joined(*shown, note(silent)), look="charts")


def _main(run: Run, charts: list[Chart]) -> Chart | None:
    """The chart to see first: of the limit that stopped the run, of what broke, or is expected."""
    stopped = _LIMITED.get(_text(mapping(run.summary.get("ending")).get("reason")))
    for chart in charts:
        if chart.key == stopped and run.extent.status == "stopped":
            return chart
    first = first_broken(run)
    ranked = [first] if first is not None else []
    for fault in run.faults if first is None else ():
        for chart in charts:
            if fault.signal in {trace.signal for trace in chart.traces}:
                return chart
    for each in (*ranked, *(e for e in run.expectations if e.band is not None)):
        for chart in charts:
            if each.text in _bounded(chart):
                return chart
        about = {signal.removeprefix(f"{each.stage}.") for signal in each.signals}
        about |= {each.signal} if each.signal else set()
        for chart in charts:
            if about & {trace.signal for trace in chart.traces}:
                return chart
    return charts[0] if charts else None


def _bounded(chart: Chart) -> set[str]:
    """The expectations whose bounds a chart draws."""
    return {b.text for b in chart.bands} | {t.label for t in chart.traces if t.style == "bound"}


def _around(run: Run) -> tuple[float, float] | None:
    """The window in which to look for what went wrong, None if nothing did."""
    kind, first = verdict(run).kind, first_broken(run)
    if kind in ("stopped", "failed"):
        at: float | None = run.end
    elif first is None and run.faults:
        at = run.faults[0].end
    else:
        at = first.broken.clock if first is not None and first.broken else None
    if at is None:
        return None
    begun = max((v.start for v in run.visits if v.start < at), default=run.start)
    span = min(max(1.1 * (at - begun), _AROUND[0]), _AROUND[1], _PART * (run.end - run.start))
    return max(at - span, run.start), min(at + span, run.end)


def _urgency(each: Judged) -> tuple[bool, float]:
    """Sorts what was missed first, in the order in which it was broken."""
    never = 0.0 if each.passed else math.inf
    return each.passed is not False, each.broken.clock if each.broken else never


def _expectations(run: Run, said: Verdict) -> Markup:
    """What was expected and found, with meters of what is left of what is allowed."""
    rows = [
        Cells(
            [
                sign("undecided") if each.unrecorded else mark(bool(each.passed)),
                named(each.name, each.text),
                joined(prose(each.explanation), _when(each)),
                joined(*map(_margin, each.margins)),
            ],
            "open" if each.unrecorded else "good" if each.passed else "bad",
        )
        for each in sorted(run.expectations, key=_urgency)
    ]
    partial = "" if said.kind in ("passed", "done", "missed") else " pale"
    until = "Judged on what there was until then." if so_far(run) and rows else ""
    shown = table(
        ["", "Expected", "Measured", Heading("Margin", "margin")],
        rows,
        f"judged expectations{partial}",
    )
    return section("Expectations", note(until) + shown, look="first")


def _when(each: Judged) -> Markup | None:
    if each.broken is None:
        return None
    return joined(" ", element("span", f"broken at {seconds(each.broken.clock)}", class_="when"))


def _margin(margin: Margin) -> Markup:
    """How far inside, with a meter of what is left of what is allowed."""
    label = element("small", "margin ", class_="label")
    shown = f"{digits(margin.value)} {margin.unit}".rstrip()
    shown += " of ticks" if margin.name == SHARE else ""
    if margin.left is None:
        return element("div", label, shown)
    width = round(100 * min(max(margin.left, 0.0), 1.0))
    meter = element("i", element("i", style=f"width: {width}%"), class_="meter", aria_hidden="true")
    left = f"{digits(100 * margin.left, 2)} % left" if margin.left >= 0 else "outside"
    return element("div", label, shown, meter, element("small", left))


def _findings(run: Run) -> Markup:
    """Oscillations and saturation."""
    rows = [
        Cells(
            [
                mark(each.allowed),
                each.stage,
                joined(prose(each.text), " ", element("span", "allowed by the stage", class_="when")
                       if each.allowed else None),
            ],
            "good" if each.allowed else "bad",
        )
        for each in run.findings
    ]  # fmt: skip
    found = table(["", "Stage", "Measured"], rows, "judged pale")
    return section("Oscillation and saturation", found, look="first")


def _stages(run: Run) -> Markup:
    """The visits of stages as a line and as a table, and what limits took in them."""
    if not run.visits:
        return Markup("")
    tint, end = tints(run), max(run.visits[-1].end, 1e-9)
    line, rows = [], []
    for visit in run.visits:
        label = run.label(visit)
        window = f"{label}: {visit.start:.3f} to {seconds(visit.end)}"
        line.append(
            button(
                element("span", label), f"tint{tint[visit.stage]}", tabindex=-1, title=window,
                data_start=visit.start, data_end=visit.end,
                style=f"flex-grow: {1e3 * (visit.end - visit.start) / end:.2f}",
            )
        )  # fmt: skip
        why, to = visit.ended_by, _text(visit.ended_by.get("to"))
        bad = why.get("kind") not in (None, "until", "done", "recorded") or to == FAIL
        cells = [
            joined(dot(tint[visit.stage]), label),
            seconds(visit.start),
            seconds(visit.end),
            seconds(visit.end - visit.start),
            *([] if is_recorded(run) else [visit.law]),
            visit.frame,
            prose(_text(why.get("text"))),
            to,
        ]
        rows.append(Cells(cells, "bad" if bad else ""))
    times = map(right, ("From", "To", "Lasted"))
    # The law is that of the file: whoever moved the robot may have had another one.
    law = [] if is_recorded(run) else ["Law"]
    return section(
        "Stages",
        element("div", *line, class_="timeline", aria_hidden="true"),
        table(["Stage", *times, *law, "Frame", Heading("Ended by", "why"), "Then"], rows, "stages"),
        *(note(f"{text}.") for text in tables.given_up(run)),
        note(prose(to_rest.told(run))),
    )


def _of_tables(title: str, *pieces: Markup) -> Markup:
    """A section of several tables and what stands below them."""
    shown = [piece for piece in pieces if piece]
    return section(title, joined(*shown))


def _about_responses(run: Run) -> Markup:
    return note(
        "Rest is the mean of the last tenth of a visit. A force has settled when it stays within "
        "the expectation on it, else within 2 % of its set point or of the step to it; time counts "
        "from the beginning of the visit, or from where the set point was last set. The time "
        "constant is of the decay once the set point stays, measured on the hull of the error."
        if mapping(run.summary.get("responses")) or mapping(run.summary.get("contact"))
        else ""
    )


def _facts(run: Run) -> Iterator[tuple[str, str]]:
    if is_recorded(run):
        # Robot, law and rate are those of the file, and not of what was recorded.
        yield from recorded.facts(run)
        yield "taskspec", _version(run)
        yield "Findings", annotated.counted(run)
        return
    laws = dict.fromkeys(v.law for v in run.visits if v.law)
    law = _text(run.summary.get("law")) or ", ".join(laws)
    duration = number(run.summary.get("duration"))
    objects = run.summary.get("objects")
    period = number(run.summary.get("period")) or (run.period if len(run.clock) else None)
    seed = run.manifest.get("seed", run.summary.get("seed"))
    yield "Robot", run.robot
    yield "Law", law
    if (command := commanded(run.columns)) != TORQUE:
        yield "Commanded", f"joint {PLURALS[command]}"
    yield "World", ", ".join(map(_text, objects)) if isinstance(objects, list) else ""
    yield "Duration", f"{run.end if duration is None else duration:.3f} s"
    yield "Control rate", f"{digits(1 / period, 4)} Hz" if period else ""
    yield "Seed", _text(seed)
    yield "Random world", _text(mapping(run.summary.get("world")).get("number"))
    yield "taskspec", _version(run)
    if "link" in run.summary:
        yield (
            "As measured" if is_measured(run) else "Driven",
            sentence(mapping(run.summary["link"])),
        )
    yield "Findings", annotated.counted(run)
    yield "Run in spite of", ", ".join(run.forced)


def _version(run: Run) -> str:
    versions = run.manifest.get("versions")
    return _text(versions.get("taskspec")) if isinstance(versions, Mapping) else ""


def _truth(run: Run) -> Markup:
    """Where world and robot differ from the controller's model, and what failed."""
    differs = []
    for each in mappings(mapping(run.summary.get("world")).get("differs")):
        written = each.get("written")
        if isinstance(written, list) and len(written) == 2:
            differs.append([code(_text(each.get("path"))), *map(_text, written)])
    faults = ([each.text, each.when] for each in fault_times(run.summary))
    return _of_tables(
        "Model mismatch",
        table(
            ["Of the world and the robot", right("Nominal"), right("Actual")], differs, "metrics"
        ),
        table(["Fault", right("When")], faults, "metrics"),
    )


def _flat(value: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Leaves of nested data as dotted name and text, empty where there is nothing."""
    if isinstance(value, Mapping):
        for key, leaf in value.items():
            yield from _flat(leaf, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(value, list):
        yield prefix, ", ".join(map(_text, value))
    else:
        yield prefix, _text(value)


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = "" if value is None else str(value)
    # The whole of a checksum stands in the manifest.
    return f"{text[:_DIGITS]}…" if _CHECKSUM.fullmatch(text) else text
