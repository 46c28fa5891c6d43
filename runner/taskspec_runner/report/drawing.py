"""What the pictures are drawn with: curves, marks and panels in pixels."""

from __future__ import annotations

import math

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.history import Vector
from taskspec_runner.report import decimate

#: Lines may leave their data by this much [px], which keeps the file small.
_TOLERANCE = 0.12


@dataclass(frozen=True, slots=True)
class Stroke:
    """A curve: path data, colour role and style."""

    d: str
    role: str
    style: str
    label: str = ""


@dataclass(frozen=True, slots=True)
class Tick:
    """A mark of an axis at a pixel."""

    at: float
    text: str


@dataclass(frozen=True, slots=True)
class Area:
    """An expected band in pixels; `passed` is None where several runs are held against it."""

    x: float
    y: float
    width: float
    height: float
    passed: bool | None


@dataclass(frozen=True, slots=True)
class Panel:
    """A chart in pixels.

    Attributes:
        title, unit: as shown.
        x, y, width, height: of the inside.
        lines, areas: what it holds.
        ticks: of values; columns: of the other axis, of a square.
    """

    title: str
    unit: str
    x: float
    y: float
    width: float
    height: float
    lines: tuple[Stroke, ...]
    ticks: tuple[Tick, ...]
    areas: tuple[Area, ...] = ()
    columns: tuple[Tick, ...] = ()


def path_data(points: Vector) -> str:
    """Path data of (k, 2) points [px], broken where they are NaN."""
    good = np.isfinite(points).all(axis=1)
    edges = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
    parts = []
    for first, last in edges.reshape(-1, 2):
        kept = decimate.simplify(points[first:last], _TOLERANCE)
        parts.append("M" + " ".join(f"{px:.1f},{py:.1f}" for px, py in kept))
    return "".join(parts)


def ticks(low: float, high: float, about: int) -> list[float]:
    """Round values between two others; about so many."""
    raw = max(high - low, 1e-12) / about
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw)
    first = math.ceil(low / step - 1e-9)
    return [i * step for i in range(first, math.floor(high / step + 1e-9) + 1)]


def tick_text(value: float, among: list[float]) -> str:
    """A value with the digits that tell it from its neighbours."""
    step = among[1] - among[0] if len(among) > 1 else 1.0
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return f"{value:.{digits}f}".replace("-", "−")
