"""Paths from CSV files: columns with units in their headers, through which a spline is laid."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, ROTATIONS
from taskspec.motion.blend import BLEND_TIME
from taskspec.motion.polynomial import PiecewiseCubic, from_states
from taskspec.text.confines import Confines

#: Columns that a table may have.
COLUMNS = ("t", *AXES)
SUFFIX = ".csv"
"""What the name of a table ends with, that of a file behind a link too."""
#: A table that begins at no more than this [m/s, rad/s] begins at rest.
_CRAWL = (1e-3, 1e-2)
_MOST_ROWS = 100_000
_MOST_TEXT = 16 << 20


class TableError(ValueError):
    """A CSV file that cannot be read as a path; `line` is 1-based, 0 for the whole file."""

    def __init__(self, message: str, line: int = 0) -> None:
        super().__init__(message)
        self.line = line


@dataclass(frozen=True, slots=True)
class Table:
    """Points of a path in SI units.

    Attributes:
        time: (k,) [s] or None where the file has no t column.
        points: axis name to (k,) coordinates [m, rad].
    """

    time: NDArray[np.float64] | None
    points: dict[str, NDArray[np.float64]]

    def argument(self) -> NDArray[np.float64]:
        """(k,) what the spline runs over: time, or the chord length from 0 to 1."""
        if self.time is not None:
            return self.time
        reached = self._chord()
        return np.asarray(reached / reached[-1])

    @property
    def begins_moving(self) -> bool:
        """Whether its first two points are apart at more than a crawl."""
        if self.time is None:
            return False
        first = float(self.time[1] - self.time[0])
        return any(
            abs(float(points[1] - points[0])) > first * _CRAWL[axis in ROTATIONS]
            for axis, points in self.points.items()
        )

    @property
    def length(self) -> float:
        """Chord length [m]; [rad] for a table that only turns."""
        return float(self._chord()[-1])

    def _chord(self) -> NDArray[np.float64]:
        translations = [v for k, v in self.points.items() if k not in ROTATIONS]
        steps = np.diff(np.array(translations or list(self.points.values())), axis=1)
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=0))])

    def clock(self) -> PiecewiseCubic:
        """Its time against stage time [s], of a table that has times of its own.

        One that begins in motion starts from rest: its rate rises in `BLEND_TIME` to what then
        still brings it to its end in time, so that it goes faster by at most that share.
        """
        assert self.time is not None
        start, duration = float(self.time[0]), float(self.time[-1] - self.time[0])
        if not self.begins_moving:
            return PiecewiseCubic(
                np.array([0.0, duration, duration + 1.0]),
                np.array([[start, 1.0, 0.0, 0.0], [start + duration, 0.0, 0.0, 0.0]]),
            )
        rise = min(BLEND_TIME, duration / 2)
        rate = duration / (duration - rise / 2)
        return from_states(
            [0.0, rise / 2, rise, duration],
            [
                (start, 0.0, 0.0),
                (start + rate * rise / 12, rate / 2, 2 * rate / rise),
                (start + rate * rise / 2, rate, 0.0),
                (start + duration, rate, 0.0),
            ],
        )

    def splines(self) -> dict[str, PiecewiseCubic]:
        """C2 cubic splines of every axis over `argument`; timed ones start and end at rest."""
        x, clamped = self.argument(), self.time is not None
        return {axis: _spline(x, y, clamped=clamped) for axis, y in self.points.items()}


def _spline(x: NDArray[np.float64], y: NDArray[np.float64], *, clamped: bool) -> PiecewiseCubic:
    """The C2 cubic spline through y at x: with no slope at its ends, or with no curvature.

    The slopes at the points are those that make the second derivative continuous: a tridiagonal
    system that is diagonally dominant, so that elimination needs no pivots.
    """
    step = np.diff(x)
    slope = np.diff(y) / step
    ends = (0.0, 0.0) if clamped else (3 * (y[1] - y[0]), 3 * (y[-1] - y[-2]))
    inner = 3 * (step[1:] * slope[:-1] + step[:-1] * slope[1:])
    right = [ends[0], *inner.tolist(), ends[1]]
    edge = (1.0, 1.0) if clamped else (2 * step[0], 2 * step[-1])
    diagonal = [edge[0], *(2 * (step[:-1] + step[1:])).tolist(), edge[1]]
    lower = [*step[1:].tolist(), 0.0 if clamped else step[-1]]
    upper = [0.0 if clamped else step[0], *step[:-1].tolist()]
    for i in range(len(lower)):
        share = lower[i] / diagonal[i]
        diagonal[i + 1] -= share * upper[i]
        right[i + 1] -= share * right[i]
    right[-1] /= diagonal[-1]
    for i in reversed(range(len(upper))):
        right[i] = (right[i] - upper[i] * right[i + 1]) / diagonal[i]
    rate = np.array(right)
    bend = (rate[:-1] + rate[1:] - 2 * slope) / step
    coefficients = [y[:-1], rate[:-1], (slope - rate[:-1]) / step - bend, bend / step]
    return PiecewiseCubic(x, np.column_stack(coefficients))


class OutsideError(Exception):
    """A CSV file that lies where a task may not read."""


def read_table(path: Path, unit_of: Callable[[str, str], float], confines: Confines) -> Table:
    """Reads a CSV table.

    Args:
        path: the file; its first row names the columns as `x [mm]`.
        unit_of: (unit, column) to the factor to SI; raises ValueError with a message.
        confines: where it may lie.

    Raises:
        OutsideError: it lies elsewhere.
        TableError: a wrong header, a cell that is no number, points that do not advance.
        OSError: the file cannot be read.
    """
    if path.suffix.lower() == SUFFIX and not confines.hold(path):
        raise OutsideError
    if path.exists() and not path.is_file():
        raise TableError(f"{path.name} is not a regular file")
    if {path.suffix.lower(), path.resolve().suffix.lower()} != {SUFFIX}:
        raise TableError(f"{path.name} is no CSV file by its ending, {SUFFIX}")
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(_MOST_TEXT + 1)
    except UnicodeDecodeError as error:
        raise TableError(f"{path.name} is not UTF-8 text") from error
    if len(text) > _MOST_TEXT:
        raise TableError(f"{path.name} is larger than {_MOST_TEXT >> 20} MiB")
    rows = [
        (number, row)
        for number, row in enumerate(csv.reader(text.splitlines()), start=1)
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")
    ]
    if len(rows) < 3:
        raise TableError("a path needs a header row and at least two points")
    if len(rows) > _MOST_ROWS:
        raise TableError(f"more than {_MOST_ROWS} points")
    names, factors = _header(rows[0][1], rows[0][0], unit_of)
    values = np.array([_numbers(row, len(names), number) for number, row in rows[1:]])
    columns = dict(zip(names, (values * factors).T.copy(), strict=True))
    time = columns.pop("t", None)
    table = Table(time, columns)
    steps = np.diff(table.argument()) if time is not None or table.length > 0 else np.zeros(1)
    if not np.all(steps > 0):
        line = rows[1 + int(np.argmin(steps > 0)) + 1][0]
        what = "t must increase from row to row" if time is not None else "a point repeats"
        raise TableError(what, line)
    return table


def _header(
    cells: list[str], line: int, unit_of: Callable[[str, str], float]
) -> tuple[list[str], NDArray[np.float64]]:
    names, factors = [], []
    for cell in cells:
        name, _, unit = cell.strip().partition("[")
        name, unit = name.strip(), unit.strip().removesuffix("]").strip()
        if len(cells) == 1 and (";" in cell or "\t" in cell):
            raise TableError("columns are separated by commas, decimals by points", line)
        if name not in COLUMNS:
            raise TableError(f"column {name!r} is none of {', '.join(COLUMNS)}", line)
        if name in names:
            raise TableError(f"column {name!r} is there twice", line)
        if not unit:
            raise TableError(f"column {name!r} has no unit; write e.g. '{name} [mm]'", line)
        try:
            factors.append(unit_of(unit, name))
        except ValueError as error:
            raise TableError(str(error), line) from error
        names.append(name)
    if not set(names) - {"t"}:
        raise TableError("no column of coordinates", line)
    return names, np.array(factors)


def _numbers(row: list[str], width: int, line: int) -> list[float]:
    if len(row) != width:
        raise TableError(f"{len(row)} cells where the header has {width}", line)
    try:
        values = [float(cell) for cell in row]
    except ValueError as error:
        raise TableError(f"not a number: {error.args[0].rpartition(': ')[2]}", line) from error
    if not all(np.isfinite(values)):
        raise TableError("a number is not finite", line)
    return values
