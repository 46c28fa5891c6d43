"""Times and values as pixels: what the pictures of a run and of a comparison have in common."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.history import Vector
from taskspec_runner.report import decimate
from taskspec_runner.report.chart import Band
from taskspec_runner.report.drawing import Area, Tick, tick_text, ticks

#: Width of a letter of a stage's name, and room beside it [px].
_LETTER, _BESIDE = 5.8, 4.0


@dataclass(frozen=True, slots=True)
class Times:
    """The time axis of a picture.

    Attributes:
        start, end: [s].
        left, width: where it lies [px].
    """

    start: float
    end: float
    left: float
    width: float

    @property
    def scale(self) -> float:
        """Pixels for a second."""
        return self.width / max(self.end - self.start, 1e-9)

    def x(self, time: float) -> float:
        """A time [s] as a pixel."""
        return self.left + (time - self.start) * self.scale

    def marks(self, about: int) -> list[Tick]:
        """Round times, about so many."""
        found = [t for t in ticks(self.start, self.end, about) if t <= self.end]
        return [Tick(self.x(t), tick_text(t, found)) for t in found]

    def stage(self, name: str, tint: int, start: float, end: float) -> dict[str, object]:
        """A stage [s] as the pictures draw it; without its name where that has no room."""
        width = (end - start) * self.scale
        fits = _LETTER * len(name) + _BESIDE < width
        return {"x": self.x(start), "width": width, "tint": tint, "name": name if fits else ""}


@dataclass(frozen=True, slots=True)
class PlotPlane:
    """The inside of a panel.

    Attributes:
        times: its time axis.
        low, high: values at its lower and upper edge.
        top, height: where it lies [px].
    """

    times: Times
    low: float
    high: float
    top: float
    height: float

    @classmethod
    def around(
        cls,
        times: Times,
        values: Vector,
        top: float,
        height: float,
        room: float,
        near: Sequence[float] = (),
    ) -> PlotPlane:
        """A plane that shows all of some finite values, and of other values those that are near.

        Args:
            times, top, height: as of the plane.
            values: (k,) finite.
            room: above and below, as a share of their range.
            near: values that may be shown.
        """
        low, high = float(values.min()), float(values.max())
        close = [v for v in near if low - (high - low) < v < high + (high - low)]
        low, high = min([low, *close]), max([high, *close])
        extra = room * max(high - low, 1e-6)
        return cls(times, low - extra, high + extra, top, height)

    def y(self, value: float) -> float:
        """A value as a pixel; one that is out of view, as the edge that is nearest."""
        inside = min(max(value, self.low), self.high)
        return self.top + (self.high - inside) * self.height / (self.high - self.low)

    def points(
        self, clock: Vector, values: Vector, breaks: decimate.Rows, gaps: decimate.Rows
    ) -> Vector:
        """(k, 2) pixels of a signal, NaN where it has gaps.

        Args:
            clock: (n,) times [s].
            values: (n,) of it.
            breaks: rows that are kept.
            gaps: rows before which the line is broken.
        """
        rows = decimate.decimate(values, breaks, 3 * int(self.times.width))
        rows, shown = decimate.broken(rows, values, gaps)
        x = self.times.left + (clock[rows] - self.times.start) * self.times.scale
        y = self.top + (self.high - shown) * self.height / (self.high - self.low)
        return np.column_stack([x, y])

    def area(self, band: Band, passed: bool | None, later: float = 0.0) -> Area:
        """An expected band, `later` by so much [s]."""
        top = self.y(self.high if band.high is None else band.high)
        foot = self.y(self.low if band.low is None else band.low)
        left = self.times.x(band.start + later)
        return Area(left, top, (band.end - band.start) * self.times.scale, foot - top, passed)

    def marks(self, found: Iterable[tuple[float, str]]) -> tuple[Tick, ...]:
        """Marks of the value axis at values in view, with their texts."""
        return tuple(Tick(self.y(value), text) for value, text in found)

    def round(self, about: int) -> list[tuple[float, str]]:
        """Round values in view, about so many, with their texts."""
        found = ticks(self.low, self.high, about)
        return [(v, tick_text(v, found)) for v in found]
