"""The panel below a picture: stages and time, force against reference, what the colours mean."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Images
from PIL import ImageDraw

from taskspec_runner.video.canvas import Image
from taskspec_runner.video.lettering import Color, Pen, dark, font, rgb
from taskspec_runner.video.marks import APPLIED, FORCE, FREE, MOTION, TRACE, WANTED
from taskspec_runner.video.panel_force import PanelForce, panel_forces
from taskspec_runner.video.recording import Recording

Vector = NDArray[np.float64]

_INK, _SOFT, _LINE, _CARD = (22, 27, 34), (91, 102, 117), (225, 229, 234), (255, 255, 255)
_NOW = (194, 51, 74)
#: Those of the report.
_TINTS: tuple[Color, ...] = (
    (125, 141, 163), (138, 128, 207), (70, 160, 143), (207, 154, 58),
    (199, 115, 144), (91, 149, 204), (141, 163, 75), (176, 133, 106),
)  # fmt: skip
#: The design's width and height; all lengths below are in its pixels.
WIDTH, HEIGHT = 1280, 160
_CHART = (330, 46, 1040, 132)
_LEGEND = 1082
_WASH = 0.16


class SignalPanel:
    """Draws the panel for any row of a run."""

    def __init__(self, recording: Recording, width: int, height: int) -> None:
        """Draws what does not change, for panels of a size [px]."""
        self._recording = recording
        self._pen = Pen(min(width / WIDTH, height / HEIGHT))
        self._size = width, height
        self._shown = panel_forces(recording)
        self._low, self._high = _range(self._shown)
        names = dict.fromkeys(visit.stage for visit in recording.visits)
        self._tints = {name: _TINTS[i % len(_TINTS)] for i, name in enumerate(names)}
        self._still = self._background()

    def draw(self, row: int) -> Image:
        """(height, width, 3) the panel at a row."""
        recording, pen = self._recording, self._pen
        image = self._still.copy()
        draw = ImageDraw.Draw(image)
        visit = recording.visit(row)
        shown = self._shown[recording.visits.index(visit)]
        self._text(draw, 24, 18, recording.program.context.loaded.task.name, 15, _SOFT)
        self._text(draw, 24, 40, visit.stage, 30, _INK)
        clock = float(recording.clock[row])
        self._text(draw, 24, 82, f"{clock:.2f} s of {recording.end:.2f} s", 17, _SOFT)
        line = f"{shown.name}  {shown.text(row)}"
        self._text(draw, 24, 112, line, 17, dark(APPLIED))
        x = self._column(clock)
        draw.line([(x, pen(_CHART[1] - 24)), (x, pen(_CHART[3]))], fill=_NOW, width=max(1, pen(2)))
        return np.asarray(image)

    def _background(self) -> Images.Image:
        image = Images.new("RGB", self._size, _CARD)
        draw, pen = ImageDraw.Draw(image), self._pen
        draw.line([(0, 0), (self._size[0], 0)], fill=_LINE)
        left, top, right, bottom = (pen(v) for v in _CHART)
        for visit in self._recording.visits:
            a = self._column(float(self._recording.clock[visit.first]))
            b = self._column(float(self._recording.clock[visit.last]) + self._recording.period)
            tint = self._tints[visit.stage]
            washed = tuple(round(255 - (255 - c) * _WASH) for c in tint)
            # A stage that is short in a long run has a column of its own.
            b = max(b, a + 1)
            draw.rectangle([a, top, b - 1, bottom], fill=washed)
            draw.rectangle([a, top - pen(24), b - 1, top - pen(4)], fill=tint)
            letters = font(pen(14))
            if draw.textlength(visit.stage, letters) < b - a - pen(8):
                where = ((a + b) / 2, top - pen(14))
                draw.text(where, visit.stage, font=letters, fill="white", anchor="mm")
        for value in _ticks(self._low, self._high):
            y = self._line(value)
            draw.line([(left, y), (right, y)], fill=(205, 211, 218))
            draw.text((left - pen(8), y), _tick(value), font=font(pen(13)), fill=_SOFT, anchor="rm")
        for shown in self._shown:
            if shown.wanted is not None:
                self._curve(draw, shown, shown.wanted, rgb(WANTED), pen(4))
        for shown in self._shown:
            self._curve(draw, shown, shown.values, dark(APPLIED), max(1, pen(1.6)))
        units = sorted({shown.unit for shown in self._shown})
        line = f"{' and '.join(units)}, over the time of the run"
        self._text(draw, _CHART[0], _CHART[3] + 6, line, 13, _SOFT)
        self._legend(draw)
        return image

    def _legend(self, draw: ImageDraw.ImageDraw) -> None:
        entries = (
            ("force, by the robot", APPLIED, 6),
            ("force axis", FORCE, 4),
            ("motion axis", MOTION, 4),
            ("free axis", FREE, 4),
            ("reference", WANTED, 5),
            ("tool path", TRACE, 3),
        )
        pen = self._pen
        for i, (text, color, width) in enumerate(entries):
            y = 24 + 22 * i
            line = [(pen(_LEGEND), pen(y)), (pen(_LEGEND + 26), pen(y))]
            draw.line(line, fill=rgb(color), width=max(1, pen(width)))
            where = (pen(_LEGEND + 36), pen(y))
            draw.text(where, text, font=font(pen(15)), fill=_INK, anchor="lm")

    def _curve(
        self, draw: ImageDraw.ImageDraw, shown: PanelForce, values: Vector, color: Color, width: int
    ) -> None:
        """Lines over time, that take in the lowest and highest value of every pixel column."""
        clock = self._recording.clock[shown.visit.rows]
        good = np.isfinite(values)
        last: tuple[int, int] | None = None
        for x, inside in _by_column(np.array([self._column(t) for t in clock[good]])):
            ys = [self._line(v) for v in (values[good][inside].min(), values[good][inside].max())]
            if last is not None and x - last[0] <= self._pen(12):
                draw.line([last, (x, round(sum(ys) / 2))], fill=color, width=width)
            draw.line([(x, ys[1] - width // 2), (x, ys[0] + width // 2)], fill=color, width=width)
            last = x, round(sum(ys) / 2)

    def _column(self, clock: float) -> int:
        left, right = self._pen(_CHART[0]), self._pen(_CHART[2])
        start = float(self._recording.clock[0])
        return round(left + (right - left) * (clock - start) / (self._recording.end - start))

    def _line(self, value: float) -> int:
        top, bottom = self._pen(_CHART[1]), self._pen(_CHART[3])
        share = (min(max(value, self._low), self._high) - self._low) / (self._high - self._low)
        return round(bottom - (bottom - top) * share)

    def _text(
        self, draw: ImageDraw.ImageDraw, x: float, y: float, text: str, size: float, color: Color
    ) -> None:
        """Text with its upper left corner at a place of the design, that fits its column."""
        pen, room = self._pen, self._pen(_CHART[0] - 70)
        letters = font(pen(size))
        while x < _CHART[0] and draw.textlength(text, letters) > room and size > 8:
            size -= 1
            letters = font(pen(size))
        draw.text((pen(x), pen(y)), text, font=letters, fill=color, anchor="la")


def _range(shown: tuple[PanelForce, ...]) -> tuple[float, float]:
    """Lowest and highest value that a chart shows: all references, and forces without impacts."""
    values = np.concatenate([s.values[np.isfinite(s.values)] for s in shown])
    wanted = [s.wanted[np.isfinite(s.wanted)] for s in shown if s.wanted is not None]
    inner = np.quantile(values, [0.002, 0.998]) if len(values) else np.zeros(2)
    ends = np.concatenate([inner, [0.0], *wanted])
    low, high = float(ends.min()), float(ends.max())
    room = max(0.12 * (high - low), 0.1)
    return low - room, high + room


def _by_column(columns: NDArray[np.int64]) -> list[tuple[int, slice]]:
    """Runs of equal pixel columns."""
    if not len(columns):
        return []
    starts = np.concatenate([[0], np.flatnonzero(np.diff(columns)) + 1, [len(columns)]])
    return [(int(columns[a]), slice(int(a), int(b))) for a, b in pairwise(starts)]


def _ticks(low: float, high: float) -> list[float]:
    raw = (high - low) / 3
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw)
    return [i * step for i in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _tick(value: float) -> str:
    return f"{value:g}"
