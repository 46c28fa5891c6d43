"""The page of an identification: values, what logs do not decide, and each log beside the world."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from statistics import NormalDist

import numpy as np
from markupsafe import Markup

from taskspec.deferred_methods import dataclass
from taskspec_runner.identify.estimate import Estimate
from taskspec_runner.identify.identification import Identification
from taskspec_runner.identify.residual import ChannelResidual, surprises
from taskspec_runner.identify.written import set_lines, shown, unit_of
from taskspec_runner.pages.chart import Band, Chart, Trace
from taskspec_runner.pages.document import (
    Cell,
    Cells,
    Heading,
    bar,
    button,
    document,
    figure,
    fold,
    head,
    in_unit,
    mark,
    note,
    outcome,
    pairs,
    patience,
    right,
    section,
    sign,
    span,
    table,
    task_file,
)
from taskspec_runner.pages.html import code, element, joined, prose
from taskspec_runner.pages.numbers import figure as digits
from taskspec_runner.pages.numbers import quantity, scale
from taskspec_runner.pages.picture import picture_svg
from taskspec_runner.pages.samples import page_data
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.record.folder import Json
from taskspec_runner.record.history import History
from taskspec_runner.record.whole import write_whole
from taskspec_runner.runs import Run

#: Room beside the interval and the file's value on their line, as a share of what is between them.
_ROOM = 0.15
#: Channels that are drawn where no script runs.
_STILL = 3
_MEASURED, _PREDICTED, _LEFT = "measured", "predicted", "left"


@dataclass(frozen=True)
class LoggedChannels:
    """A log with what is left of its channels.

    Attributes:
        key: of its charts and its time.
        title: as the heading of its charts has it.
        name: of the log.
        history: its ticks.
        channels: that carry something.
        silent: names of those that do not.
        held_out: whether nothing was identified from it.
    """

    key: str
    title: str
    name: str
    history: History
    channels: tuple[ChannelResidual, ...]
    silent: tuple[str, ...]
    held_out: bool

    @property
    def run(self) -> Run:
        """Its ticks as the charts take them."""
        return Run(Path(self.name), manifest={}, summary={}, history=self.history)


def write_page(found: Identification, path: Path) -> Path:
    """Writes the page of an identification.

    Raises:
        OutputError: it cannot be written.
    """
    return write_whole(path, render(found))


def render(found: Identification) -> str:
    """The page as text."""
    task, logs = found.loaded.task, [*_logs(found)]
    drawn = {log.key: [*_charts(found, log)] for log in logs}
    charts = [chart for each in drawn.values() for pair in each for chart in pair]
    data, time = None, _time(logs)
    if charts:
        # Logs differ in their stages: those of several are on their own charts alone.
        own = time.stages() if len(logs) == 1 else []
        data = page_data(time, charts, (), linked=False, stages=own)
    return document(
        f"{task.name}: identified",
        head(
            "taskspec identify", task.name, task.about or "",
            outcome("done", _count(found), element("p", _about(found))),
            *(outcome("unfinished", "Warning", element("p", prose(f"{text}.")))
              for text in surprises(found.residuals)),
            pairs(((log.title, code(log.name)) for log in logs), "runs"),
        ),
        _values(found),
        _undecided(found),
        _commands(found, copied=data is not None),
        _left(found),
        _predicted(found),
        *((bar(data["stages"], "Whole log" if len(logs) == 1 else "Whole logs"),
           patience(_still(task.name, logs[0], drawn[logs[0].key]))) if data else ()),
        *(_section(log, drawn[log.key]) for log in logs),
        task_file(found.loaded.source.text),
        data=data,
        scripts=("samples", "plot", "legend", "copy", "time"),
        facts=pairs([("level of the intervals", f"{100 * found.level:g} %")]),
        remark=_density(data) if data else "",
    )  # fmt: skip


# The logs.


def _logs(found: Identification) -> Iterator[LoggedChannels]:
    """The logs in order, those that were held out last."""
    for held_out, channels in ((False, found.residuals), (True, found.held_out)):
        # One log may be named twice.
        grouped = groupby(channels, key=lambda each: (each.log, id(each.history)))
        parts = [tuple(group) for _, group in grouped]
        word = "Held out" if held_out else "Log"
        for number, part in enumerate(parts, 1):
            yield LoggedChannels(
                f"{'held ' if held_out else ''}{number}",
                f"{word} {number}" if len(parts) > 1 else word,
                part[0].log,
                part[0].history,
                tuple(each for each in part if each.peak),
                tuple(each.channel for each in part if not each.peak),
                held_out,
            )


def _time(logs: Sequence[LoggedChannels]) -> Timeline:
    """The logs on a common time, that of the clock of each."""
    runs = {log.key: log.run for log in logs}
    return Timeline(runs, next(iter(runs)), dict.fromkeys(runs, 0.0))


def _charts(found: Identification, log: LoggedChannels) -> Iterator[tuple[Chart, ...]]:
    """Of each channel what was measured and predicted, and what is left if anything is."""
    run = log.run
    for each in log.channels:
        ticks = np.full((3, len(log.history)), np.nan)
        ticks[:, each.ticks] = each.measured, each.predicted, each.left
        key, title, role = f"{log.key} {each.channel}", _title(each), _role(each)
        factor, unit = scale(each.unit, each.peak)
        drawn = (
            Trace(_MEASURED, factor * ticks[0], role, signal=each.channel, run=log.key),
            Trace(_PREDICTED, factor * ticks[1], "ink", "reference", run=log.key),
        )
        beside = Chart(key, title, unit, drawn, _said(each, log), factor=factor, of=log.key)
        if each.exact:
            # A chart of rounding would look like one of noise.
            yield (beside,)
            continue
        size = float(np.abs(each.left).max())
        fine, small = scale(each.unit, size)
        traces: tuple[Trace, ...] = (Trace(_LEFT, fine * ticks[2], role, run=log.key),)
        half = fine * NormalDist().inv_cdf(0.5 + found.level / 2) * each.explained
        of = "the sensor's noise" if each.declared else "what is new from tick to tick"
        text = f"{100 * found.level:g} % of {of}"
        bands = (Band(run.start, run.end, -half, half, None, text),)
        yield (
            beside,
            Chart(f"{key} left", f"{title}, left", small, traces, _noise(each), bands,
                  factor=fine, of=log.key),
        )  # fmt: skip


def _title(each: ChannelResidual) -> str:
    kind, name, *_ = each.channel.split(".")
    return {"force": "Force", "torque": "Moment", "joint": "Torque of joint"}[kind] + f" {name}"


def _role(each: ChannelResidual) -> str:
    """The colour of a channel: that of its axis, or of its joint."""
    kind, name, *_ = each.channel.split(".")
    return f"j{(int(name) - 1) % 7}" if kind == "joint" else name[-1]


def _said(each: ChannelResidual, log: LoggedChannels) -> str:
    if each.exact:
        return f"nothing left of {_text(each.size, each)} rms but rounding"
    if not log.held_out:
        return f"left {_text(each.rms, each)} rms of {_text(each.size, each)}"
    return (
        f"held out: predicted to {_text(each.rms, each)} rms, {digits(100 * each.share)} % of the "
        f"peak of {_text(each.peak, each)}"
    )


def _noise(each: ChannelResidual) -> str:
    of = "noise" if each.declared else "new from tick to tick"
    return f"{_text(each.rms, each)} rms, {of} {_text(each.explained, each)}"


def _text(value: float, each: ChannelResidual) -> str:
    return " ".join(quantity(value, each.unit)).rstrip()


def _section(log: LoggedChannels, charts: Sequence[tuple[Chart, ...]]) -> Markup:
    """The charts of a log; torques of joints that noise explains are folded below the forces."""
    front: list[Markup] = []
    back: list[Markup] = []
    for each, (chart, *left) in zip(log.channels, charts, strict=True):
        drawn = joined(figure(chart), *(figure(part, "low") for part in left))
        of_joint = each.channel.startswith("joint.")
        (back if of_joint and not each.surprising else front).append(drawn)
    if not front:
        front, back = back, []
    silent = f"Zero throughout and not drawn: {', '.join(log.silent)}." if log.silent else ""
    return section(
        joined(log.title, " ", code(log.name)),
        joined(*front),
        fold("Torques of the joints", len(back), *back) if back else Markup(""),
        note(silent),
        look="charts",
    )


def _still(name: str, log: LoggedChannels, charts: Sequence[tuple[Chart, ...]]) -> Markup | None:
    """What stands for the charts where no script runs: the first channels of the first log."""
    if not charts:
        return None
    first = [chart for chart, *_ in charts[:_STILL]]
    time = Timeline({log.key: log.run}, log.key, {log.key: 0.0})
    return Markup(picture_svg(name, log.name, "", time, first))


def _density(data: Json) -> str:
    """How many of the ticks are drawn."""
    if all(each["kind"] == "all" for each in data["samples"]):
        return "All ticks are drawn."
    return (
        "Of neighbouring ticks the lowest and the highest value are drawn, and all of them near "
        "changes of stage."
    )


# Words and tables.


def _count(found: Identification) -> str:
    count = len(found.estimates)
    return f"{count} value{'' if count == 1 else 's'}"


def _about(found: Identification) -> str:
    logs, outside = (
        len(found.fit.problem.logs),
        [e for e in found.estimates if not e.declared_inside],
    )
    text = f"Identified from {logs} log{'' if logs == 1 else 's'}"
    tied = sum(len(group.names) for group in found.confounded)
    more = [
        f"{count} {one if count == 1 else many}"
        for count, one, many in (
            (len(outside), "value of the file is outside its interval",
             "values of the file are outside their intervals"),
            (tied, "more is not told apart", "more are not told apart"),
            (len(found.unseen), "does not show in the logs", "do not show in the logs"),
        )
        if count
    ]  # fmt: skip
    return "; ".join([text, *more]) + "."


def _values(found: Identification) -> Markup:
    columns: list[Heading | str] = ["Value", right("Identified")]
    columns += [right(f"{100 * found.level:g} % interval"), Heading("", "spans")]
    columns += [right("In the file"), ""]
    rows = []
    for each in found.estimates:
        unit = unit_of(each)
        low, high, value = (
            shown(x, unit, each.deviation) for x in (each.low, each.high, each.value)
        )
        good = each.declared_inside
        word = "inside" if good else "outside"
        rows.append(
            Cells(
                [
                    code(each.name),
                    prose(value),
                    prose(f"{low} .. {high}"),
                    _line(each),
                    prose(shown(each.declared, unit, 0.0)),
                    Cell(joined(mark(good, (word, word)), " ", word), "whole"),
                ],
                "good" if good else "bad",
            )
        )
    about = "On the line: the interval, the identified value in it, and upright the file's value."
    none = note("The logs decide no value.")
    return section("Values", table(columns, rows) or none, note(about if rows else ""))


def _line(each: Estimate) -> Markup:
    """The interval and the value on a line, beside the value of the file."""
    ends = [x for x in (each.low, each.high, each.value, each.declared) if not math.isinf(x)]
    low, high = min(ends, default=0.0), max(ends, default=0.0)
    room = _ROOM * (high - low)

    def at(x: float) -> float:
        if math.isinf(x):
            return 1.0
        return (x - low + room) / (high - low + 2 * room) if room else 0.5

    return span((at(each.low), at(each.high)), at(each.value), at(each.declared))


def _undecided(found: Identification) -> Markup:
    """What the logs do not tell apart, and what they show nothing of."""
    rows: list[tuple[object, ...]] = []
    for group in found.confounded:
        known = [
            element("div", prose(
                f"`{each.text}` = {each.value:.6g} ({each.low:.6g} .. {each.high:.6g}), in SI"
            ))
            for each in group.known
        ]  # fmt: skip
        rows.append(("not told apart", _names(group.names), joined(*known) or "nothing"))
    if found.unseen:
        rows.append(("not in the logs", _names(found.unseen), "nothing"))
    return section(
        "What the logs do not decide", table(["", "Values", "Known of them"], rows, "long")
    )


def _names(names: Sequence[str]) -> Markup:
    # One piece: on a phone a cell puts its pieces side by side.
    return element("span", Markup(", ").join(map(code, names)))


def _commands(found: Identification, *, copied: bool) -> Markup:
    """The options that give a command the identified values."""
    lines = [*set_lines(found)]
    if not lines:
        return Markup("")
    text = element("pre", " \\\n".join(lines), class_="options")
    copy = button("copy", data_copy=True) if copied else Markup("")
    return section("On the command line", copy + text)


def _left(found: Identification) -> Markup:
    """What is left of each channel, beside its noise."""
    several = len(found.fit.problem.logs) > 1
    columns: list[Heading | str] = [*(["Log"] if several else []), "Channel"]
    columns += [right("Left, rms"), right("Noise, rms"), right("Ratio"), right("Channel, rms"), ""]
    rows = [
        Cells(
            [
                *([code(each.log)] if several else []),
                code(each.channel),
                in_unit(quantity(each.rms, each.unit)),
                in_unit(quantity(each.explained, each.unit)),
                digits(each.excess),
                in_unit(quantity(each.size, each.unit)),
                _judged(each),
            ],
            "bad" if each.surprising else "good" if each.exact or each.declared else "open",
        )
        for each in found.residuals
        if each.peak
    ]  # fmt: skip
    return section("Left unexplained", table(columns, rows))


def _judged(each: ChannelResidual) -> Markup:
    """Whether what is left is the noise of the sensor."""
    if each.surprising:
        return mark(False, ("", "more")) + " more than noise"
    if each.exact or each.declared:
        return mark(True, ("explained", "")) + (" nothing left" if each.exact else " noise")
    # Then it is held to itself.
    return sign("undecided") + " no noise declared"


def _predicted(found: Identification) -> Markup:
    """What is predicted of logs that were held out."""
    numbers = ("Off, rms", "Of the peak", "Peak", "Predicted there")
    columns: list[Heading | str] = ["Log", "Channel", *map(right, numbers)]
    rows = [
        [
            code(each.log),
            code(each.channel),
            in_unit(quantity(each.rms, each.unit)),
            f"{digits(100 * each.share)} %",
            in_unit(quantity(each.peak, each.unit)),
            in_unit(quantity(each.at_peak, each.unit)),
        ]
        for each in found.held_out
    ]
    return section("Held out", table(columns, rows))
