"""Charts over time as an SVG file of its own, for a README or a paper, on light and dark pages."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from taskspec_runner.pages import decimate
from taskspec_runner.pages.chart import Chart, Trace
from taskspec_runner.pages.document import part
from taskspec_runner.pages.html import element, joined
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.record.history import Vector
from taskspec_runner.record.whole import write_whole

WIDTH = 860
_LEFT, _RIGHT, _TOP, _BOTTOM = 60.0, 22.0, 96.0, 46.0
#: Height of a panel and room above it for its title [px].
_PANEL, _TITLE = 150.0, 40.0
#: Edge of a square beside the panels, and the room that it takes [px].
_SQUARE, _BESIDE = 240.0, 310.0
#: Where the legend begins, the height of its rows [px], and how many entries stand in one.
_LEGEND, _ROW, _COLUMNS = 60.0, 20.0, 3
#: Room above and below the values of a panel, as a share of their range.
_ROOM = 0.06
#: Width of a letter of a stage's name, and room beside it [px].
_LETTER, _MARGIN = 5.8, 4.0
#: Logarithmic panels with fewer powers of ten get marks between them.
_FEW_DECADES = 2.5
#: Lines may leave their data by this much [px], which keeps the file small.
_TOLERANCE = 0.12
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Picture:
    """A drawing that notebooks show.

    Attributes:
        svg: the drawing as text.
    """

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def save(self, path: str | Path) -> Path:
        """Writes it as an SVG file.

        Raises:
            ValueError: the file's name does not end in .svg.
            OutputError: it cannot be written.
        """
        path = Path(path)
        if path.suffix != ".svg":
            raise ValueError(f"a picture is saved as .svg, not as {path.suffix or path.name}")
        return write_whole(path, self.svg)

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        return f"<picture of {len(self.svg)} characters of SVG>"


@dataclass(frozen=True, slots=True)
class Panel:
    """A rectangle of a picture, and what lies at its edges.

    Attributes:
        left, top, width, height: of it [px].
        across: values at its left and right edge.
        up: values at its lower and upper edge.
    """

    left: float
    top: float
    width: float
    height: float
    across: tuple[float, float]
    up: tuple[float, float]

    def x(self, value: Any) -> Any:
        """Values across as pixels."""
        low, high = self.across
        return self.left + (value - low) * self.width / max(high - low, 1e-9)

    def y(self, value: Any) -> Any:
        """Values upwards as pixels."""
        low, high = self.up
        return self.top + (high - value) * self.height / (high - low)

    def curve(self, points: Vector, role: str, style: str) -> Markup:
        """A line through (k, 2) values, broken where they are NaN."""
        pixels = np.column_stack([self.x(points[:, 0]), self.y(points[:, 1])])
        good = np.isfinite(pixels).all(axis=1)
        edges = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
        parts = []
        for first, last in edges.reshape(-1, 2):
            kept = decimate.simplify(pixels[first:last], _TOLERANCE)
            parts.append("M" + " ".join(f"{px:.1f},{py:.1f}" for px, py in kept))
        return _line("".join(parts), role, style)

    def inside(self, *content: Markup) -> Markup:
        """What is drawn in it, cut at its edges."""
        place = (self.left, self.top, self.width, self.height)
        x, y, width, height = map(_px, place)
        return element("svg", *content, x=x, y=y, width=width, height=height,
                       viewBox=f"{x} {y} {width} {height}")  # fmt: skip

    def scale_up(self, marks: Iterable[tuple[float, str]]) -> Markup:
        """Lines and texts at values upwards."""
        return joined(
            *(
                element("path", class_="grid", d=f"M{self.left},{_px(y)}h{_px(self.width)}")
                + _text(self.left - 7, y + 4, text, "end small")
                for at, text in marks
                for y in (self.y(at),)
            )
        )

    def scale_across(self, marks: Iterable[tuple[float, str]], unit: str = "") -> Markup:
        """Texts below values across, the last with its unit."""
        marks = list(marks)
        ends = ["" for _ in marks[1:]] + [f" {unit}" if unit else ""]
        foot = self.top + self.height + 18
        return joined(
            *(
                _text(self.x(at), foot, text + end, "mid small")
                for (at, text), end in zip(marks, ends, strict=False)
            )
        )


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A run in the legend.

    Attributes:
        name, role: its name and colour.
        style: of its lines, empty where it has none.
        ending, kind: what came of it, in words and as a verdict.
    """

    name: str
    role: str
    style: str
    ending: str
    kind: str


@dataclass(frozen=True, slots=True)
class Square:
    """A curve in a plane, to one scale in both directions.

    Attributes:
        title, unit: as shown.
        lines: (k, 2) values with a style each.
    """

    title: str
    unit: str
    lines: Sequence[tuple[Vector, str]]


def picture_svg(
    title: str,
    subtitle: str,
    kind: str,
    time: Timeline | None,
    charts: Sequence[Chart],
    *,
    legend: Sequence[LegendEntry] = (),
    square: Square | None = None,
    faults: Sequence[tuple[float, float]] = (),
    cut: Collection[str] = (),
    foot: str = "",
) -> str:
    """A picture as text, 860 px wide.

    Args:
        title: of the picture, at its left.
        subtitle, kind: at its right; a verdict has its colour.
        time: of the runs that the charts are of; None without any.
        charts: one above the other.
        legend: of several runs; the lines of a single one are named in each chart.
        square: beside the charts.
        faults: times from which and to which something failed [s].
        cut: runs that did not come to their end; their lines end with a cross, and do not rule
            which values are shown.
        foot: below the time axis.
    """
    width = WIDTH - _LEFT - _RIGHT - (_BESIDE if square else 0.0)
    top = _TOP + _ROW * math.ceil(len(legend) / _COLUMNS)
    content: list[Markup] = [_entry(i, each) for i, each in enumerate(legend)]
    bottom = top
    if time is not None:
        across = (time.start, time.end)
        for number, chart in enumerate(charts):
            y = top + number * (_PANEL + _TITLE)
            plane = Panel(_LEFT, y, width, _PANEL, across, _range(chart, cut))
            caption = _caption(chart, {each.name for each in legend}, faults)
            content.append(_text(20, y - (28 if number == 0 else 13), caption))
            content.append(_stages(plane, time, faults, names=number == 0))
            content.append(_panel(plane, chart, time, cut))
            bottom = y + _PANEL
        axis = Panel(_LEFT, top, width, bottom - top, across, (0.0, 1.0))
        times = [(at, text) for at, text in ticks(*across, 8) if at <= across[1]]
        content.append(axis.scale_across(times, "s"))
    end = bottom
    if square is not None:
        content.append(_square(square, top))
        end = max(end, top + _SQUARE)
    if foot:
        content.append(_text(_LEFT + width / 2, bottom + 36, foot, "mid small"))
    height = f"{end + _BOTTOM:.0f}"
    verdict = element("tspan", kind, dx=14, font_weight=600, font_size=15, fill="var(--mark)")
    right = joined(element("tspan", subtitle), verdict if kind else None)
    frame = element("rect", x=".5", y=".5", width=WIDTH - 1, height=int(height) - 1, rx=10,
                    fill="var(--card)", stroke="var(--line)")  # fmt: skip
    return element(
        "svg",
        element("style", _style()),
        frame,
        _text(20, 33, title, "ink", font_size=17),
        element("g", _text(WIDTH - 20, 33, right, "end", font_size=13), class_=kind),
        *content,
        xmlns="http://www.w3.org/2000/svg", class_="pic", viewBox=f"0 0 {WIDTH} {height}",
        width=WIDTH, height=height, role="img", aria_label=f"{title}: {kind or subtitle}",
    )  # fmt: skip


def _style() -> Markup:
    """The colours of the pages, and the looks of what pictures are made of."""
    light, dark = re.findall(r":root \{(.*?)\}", part("page.css"), re.S)[:2]
    dark = f"@media (prefers-color-scheme:dark){{.pic{{{dark}}}}}"
    return Markup(f".pic{{{light}}}\n{dark}\n{part('picture.css')}")


def _range(chart: Chart, cut: Collection[str]) -> tuple[float, float]:
    """The values of a chart that are all shown, and bounds near to them, with a little room."""
    traces = [t for t in chart.traces if t.run not in cut] or chart.traces
    finite = (t.values[np.isfinite(t.values)] for t in traces)
    ends = [float(end(part)) for part in finite if len(part) for end in (np.min, np.max)]
    sides = [v for band in chart.bands for v in (band.low, band.high) if v is not None]
    low, high = (_upright(chart, end(ends)) for end in (min, max))
    near = [v for v in sides if low - (high - low) < v < high + (high - low)]
    low, high = min([low, *near]), max([high, *near])
    room = _ROOM * max(high - low, 1e-6)
    return low - room, high + room


def _upright(chart: Chart, values: Any) -> Any:
    return np.log10(values) if chart.log else values


def _panel(plane: Panel, chart: Chart, time: Timeline, cut: Collection[str]) -> Markup:
    marks = decades(*plane.up) if chart.log else ticks(*plane.up, 6)
    content: list[Markup] = []
    for band in chart.bands:
        left, right = plane.x(band.start), plane.x(band.end)
        sides = (plane.up[1] if band.high is None else band.high,
                 plane.up[0] if band.low is None else band.low)  # fmt: skip
        upper, lower = (plane.y(float(np.clip(side, *plane.up))) for side in sides)
        width, height = _px(right - left), _px(lower - upper)
        edges = f"M{_px(left)},{_px(upper)}h{width}m0,{height}h-{width}"
        area = element("rect", class_="area", x=_px(left), y=_px(upper), width=width, height=height)
        kind = "plain" if band.passed is None else "passed" if band.passed else "missed"
        content.append(element("g", area, element("path", class_="edge", d=edges), class_=kind))
    for trace in chart.traces:
        points = _points(plane, chart, trace, time)
        content.append(plane.curve(points, trace.role, trace.style))
        if trace.run in cut and trace.style != "reference":
            content.append(_cross(plane, points, trace.role))
    return plane.scale_up(marks) + plane.inside(*content)


def _points(plane: Panel, chart: Chart, trace: Trace, time: Timeline) -> Vector:
    """(k, 2) times and values of a trace, NaN where it has gaps."""
    run = time.runs[trace.run]
    values = _upright(chart, trace.values)
    rows = decimate.decimate(values, run.breaks, 3 * int(plane.width))
    gaps = run.breaks[:0] if trace.continuous else run.breaks
    rows, shown = decimate.broken(rows, values, gaps)
    return np.column_stack([run.clock[rows] + time.begins[trace.run], shown])


def _cross(plane: Panel, points: Vector, role: str) -> Markup:
    """A mark where the line of a run ends that was cut short; at the edge if it is out of view."""
    at, value = points[np.isfinite(points).all(axis=1)][-1]
    x, y = plane.x(at), float(np.clip(plane.y(value), plane.top + 5, plane.top + plane.height - 5))
    return _line(f"M{_px(x - 4)},{_px(y - 4)}l8,8m0,-8l-8,8", role, "cross")


def _caption(chart: Chart, known: Collection[str], faults: Sequence[object]) -> Markup:
    """The title of a panel, and what of its lines no legend names."""

    def word(text: str, colour: str, **more: Any) -> Markup:
        return element("tspan", text, dx=12, fill=f"var(--{colour})", font_weight=600, **more)

    words = [element("tspan", chart.title.removesuffix(" against its reference"), class_="ink"),
             element("tspan", chart.unit, dx=5)]  # fmt: skip
    words += [
        word(f"{'- -' if trace.style == 'reference' else '—'} {trace.label}", trace.role)
        for trace in chart.traces
        if trace.label and not trace.reference_of and trace.label not in known
    ]
    if any(trace.style == "halo" for trace in chart.traces):
        words.append(word("wide and pale: reference", "muted"))
    if faults:
        words.append(word("fault", "warn"))
    if chart.bands:
        passed = chart.bands[0].passed
        kind = "plain" if passed is None else "passed" if passed else "missed"
        text = "expected within the grey band" if passed is None else "expected"
        words.append(word(text, "mark", class_=kind))
    return joined(*words)


def _stages(
    plane: Panel, time: Timeline, faults: Sequence[tuple[float, float]], *, names: bool
) -> Markup:
    """The ground of each stage and of each fault, and a strip above it with the stage's name."""
    drawn = []
    for stage in time.stages():
        x, end = plane.x(stage["start"]), plane.x(stage["end"])
        colour = f"var(--tint{stage['tint']})"
        place = {"x": _px(x), "width": _px(end - x), "fill": colour}
        drawn.append(element("rect", class_="ground", y=plane.top, height=plane.height, **place))
        drawn.append(element("rect", y=plane.top - 3, height=3, **place))
        if names and _LETTER * len(stage["name"]) + _MARGIN < end - x:
            drawn.append(_text(x, plane.top - 8, stage["name"], "small"))
    for start, end in faults:
        place = {"x": _px(plane.x(start)), "width": _px(plane.x(end) - plane.x(start))}
        drawn.append(element("rect", class_="ground", y=plane.top, height=plane.height,
                             fill="var(--warn)", **place))  # fmt: skip
    return joined(*drawn)


def _entry(number: int, each: LegendEntry) -> Markup:
    x = 20 + (WIDTH - 40) / _COLUMNS * (number % _COLUMNS)
    y = _LEGEND + _ROW * (number // _COLUMNS)
    line = _line(f"M{_px(x)},{y - 4}h27", each.role, each.style) if each.style else None
    known = each.kind in ("passed", "stopped", "failed")
    ending = element("tspan", each.ending, dx=6, class_=each.kind,
                     fill="var(--mark)" if known else None)  # fmt: skip
    name = element("tspan", each.name, class_="ink" if each.style else "")
    return joined(line, _text(x + 35, y, name + ending))


def _square(square: Square, top: float) -> Markup:
    both = np.concatenate([points for points, _ in square.lines])
    low, high = np.nanmin(both, axis=0), np.nanmax(both, axis=0)
    half = 0.56 * float(np.max(high - low))
    middle = (low + high) / 2
    (left, right), (foot, head) = ((float(m) - half, float(m) + half) for m in middle)
    plane = Panel(WIDTH - _RIGHT - _SQUARE, top, _SQUARE, _SQUARE, (left, right), (foot, head))
    title = joined(
        element("tspan", square.title, class_="ink"), element("tspan", square.unit, dx=5)
    )
    columns = ticks(left, right, 4)
    grid = (
        element("path", class_="grid", d=f"M{_px(plane.x(at))},{top}v{_SQUARE}")
        for at, _ in columns
    )
    curves = (plane.curve(points, "z", style) for points, style in square.lines)
    return joined(_text(plane.left, top - 28, title), plane.scale_up(ticks(foot, head, 4)), *grid,
                  plane.scale_across(columns), *curves)  # fmt: skip


def _px(value: float) -> str:
    return f"{value:.1f}"


def _line(d: str, role: str, style: str) -> Markup:
    return element("path", class_=style, stroke=f"var(--{role})", d=d)


def _text(x: float, y: float, content: object, look: str = "", **more: Any) -> Markup:
    return element("text", content, x=_px(x), y=_px(y), class_=look, **more)


def ticks(low: float, high: float, about: int) -> list[tuple[float, str]]:
    """Round values between two others, about so many, with the digits that tell them apart."""
    raw = max(high - low, 1e-12) / about
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [(i * step, f"{i * step:.{digits}f}".replace("-", "−")) for i in range(first, last + 1)]


def decades(low: float, high: float) -> list[tuple[float, str]]:
    """Marks between two logarithms: powers of ten, with 2 and 5 times them where they are few."""
    leading = (1, 2, 5) if high - low < _FEW_DECADES else (1,)
    powers = range(math.floor(low), math.ceil(high) + 1)
    marks = [(n + math.log10(m), m, str(n).translate(_RAISED)) for n in powers for m in leading]
    return [(at, f"{'' if m == 1 else f'{m}·'}10{n}") for at, m, n in marks if low <= at <= high]
