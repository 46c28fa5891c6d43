"""Fewer points for the screen, with every peak and every gap kept."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.record.file_array import BLOCK_ROWS

Vector = NDArray[np.float64]
Rows = NDArray[np.int64]

#: Points a trace is drawn with at most: two for each pixel of a wide screen.
POINTS = 3200


def decimate(values: Vector, breaks: Rows, limit: int = POINTS, keep: Rows | None = None) -> Rows:
    """Rows to draw: the lowest and the highest of each bucket, and both sides of every gap.

    Args:
        values: (rows,) a signal, NaN where it has no value.
        breaks: rows that begin something new; they and the rows before them are kept.
        limit: number of points aimed at; gaps, ends and `keep` add to it.
        keep: rows that are drawn whatever they are.

    Returns:
        Rows in order, without the inside of stretches that have no value.
    """
    rows = len(values)
    finite = np.isfinite(values)
    if rows <= limit:
        chosen: Rows = np.arange(rows, dtype=np.int64)
    else:
        edges = np.flatnonzero(finite[1:] != finite[:-1])
        sides = [np.array([0, rows - 1]), breaks, breaks - 1, edges, edges + 1]
        parts = [*_extremes(values, -(-2 * rows // limit)), *sides]
        parts += [] if keep is None else [keep]
        chosen = np.unique(np.concatenate(parts)).astype(np.int64)
    kept = finite[chosen]
    inside = np.zeros(len(chosen), dtype=bool)
    inside[1:] = ~kept[1:] & ~kept[:-1]
    return chosen[~inside]


def _extremes(values: Vector, width: int) -> Iterator[Rows]:
    """Rows of the lowest and the highest value of each bucket of so many rows, some at a time."""
    step = width * max(BLOCK_ROWS // width, 1)
    for first in range(0, len(values), step):
        part = values[first : first + step]
        grid = np.full((-(-len(part) // width), width), np.nan)
        grid.reshape(-1)[: len(part)] = part
        known = np.isfinite(grid)
        filled = np.flatnonzero(known.any(axis=1))
        begin = first + filled * width
        yield begin + np.where(known, grid, np.inf).argmin(axis=1)[filled]
        yield begin + np.where(known, grid, -np.inf).argmax(axis=1)[filled]


def broken(rows: Rows, values: Vector, breaks: Rows) -> tuple[Rows, Vector]:
    """Rows and their values with a gap put in before each row of `breaks`."""
    shown = values[rows]
    at = np.unique(np.searchsorted(rows, breaks))
    at = at[(at > 0) & (at < len(rows))]
    return np.insert(rows, at, rows[at]), np.insert(shown, at, np.nan)


def encode(rows: Rows, values: Vector) -> Mapping[str, str]:
    """Rows as steps and values as 32 bit floats, both little-endian in base64.

    Rows without a gap, from 0 on, are not named.
    """
    packed = base64.b64encode(values.astype("<f4").tobytes()).decode()
    steps = np.diff(rows, prepend=0)
    if len(rows) and rows[0] == 0 and rows[-1] == len(rows) - 1:
        return {"kind": "all", "rows": "", "values": packed}
    widest = int(steps.max(initial=0))
    kind = "u1" if widest < 2**8 else "u2" if widest < 2**16 else "u4"
    return {
        "kind": kind,
        "rows": base64.b64encode(steps.astype(f"<{kind}").tobytes()).decode(),
        "values": packed,
    }


def simplify(points: Vector, tolerance: float) -> Vector:
    """Fewer points of a curve, which stays within `tolerance` of all that are left out.

    Args:
        points: (k, 2) in order.
        tolerance: in the unit of the points.

    Returns:
        (m, 2) some of them, with the first and the last (Douglas and Peucker's method).
    """
    keep = np.zeros(len(points), dtype=bool)
    keep[[0, -1]] = True
    open_spans = [(0, len(points) - 1)]
    while open_spans:
        first, last = open_spans.pop()
        if last - first < 2:
            continue
        off = _distances(points[first + 1 : last], points[first], points[last])
        worst = int(off.argmax())
        if off[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            open_spans += [(first, middle), (middle, last)]
    return points[keep]


def _distances(points: Vector, start: Vector, end: Vector) -> Vector:
    """Distances [unit of the points] from the straight piece between two points."""
    along = end - start
    length = float(np.hypot(*along))
    offsets = points - start
    if length == 0.0:
        return np.asarray(np.hypot(offsets[:, 0], offsets[:, 1]))
    share = np.clip(offsets @ along / length**2, 0.0, 1.0)
    rest = offsets - share[:, None] * along
    return np.asarray(np.hypot(rest[:, 0], rest[:, 1]))
