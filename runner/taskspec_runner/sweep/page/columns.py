"""What the table and the charts of a sweep's page are made of, a value a world."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program.worlds import component_dimension
from taskspec.spec import Task
from taskspec.text.units import FORCE, MOMENT, TIME, VELOCITY, Dimension, in_unit, suited
from taskspec_runner.pages.html import prose
from taskspec_runner.sweep.statistics import Influence, Vector, parameters
from taskspec_runner.sweep.summary import expectation_texts
from taskspec_runner.sweep.world_run import Row

#: Of what a tool went through, the largest of a world.
PEAKS: Mapping[str, Dimension] = {
    "peak force": FORCE,
    "peak torque": MOMENT,
    "peak speed": VELOCITY,
}
_DURATION = "duration"
MARGIN = "margin"
#: Whether an expectation was met, as a byte.
_MISSED, _MET, _UNKNOWN = 0, 1, 2


@dataclass(frozen=True, slots=True)
class WorldColumn:
    """A number of every world.

    Attributes:
        key: in the sweep's table.
        kind: `parameter`, `margin`, `peak` or `duration`.
        unit: that it is shown in, as the language has it; empty for a plain number.
        values: (worlds,) in that unit; nan where there is none.
    """

    key: str
    kind: str
    unit: str
    values: Vector

    @property
    def label(self) -> str:
        """As a column is headed; every object is of the world."""
        return self.key.removeprefix("world.")

    @property
    def shown_unit(self) -> str:
        """With real dots and micros."""
        return str(prose(f"1 {self.unit}")).removeprefix("1").strip()

    def as_data(self) -> dict[str, Any]:
        """For the script: the values as 32 bit floats."""
        return {
            "key": self.key,
            "label": self.label,
            "kind": self.kind,
            "unit": self.shown_unit,
            "values": packed(self.values.astype("<f4")),
        }


def columns(task: Task, rows: Sequence[Row], influences: Sequence[Influence]) -> list[WorldColumn]:
    """What varies, the most influential first, then the margin, peaks, and how long it lasted."""
    known = parameters(rows)
    order = dict.fromkeys([*(each.parameter for each in influences), *known])
    found = [_column(n, "parameter", known[n], component_dimension(task, n)) for n in order]
    # What a world that was broken off has met so far says nothing of it.
    margins = [row.get(MARGIN) if row["status"] == "done" else None for row in rows]
    found.append(WorldColumn(MARGIN, "margin", "%", 100 * _numbers(margins)))
    for key, dimension in PEAKS.items():
        found.append(_column(key, "peak", _numbers([row.get(key) for row in rows]), dimension))
    lasted = _numbers([row.get(_DURATION) for row in rows])
    return [*found, _column(_DURATION, "duration", lasted, TIME)]


def _column(key: str, kind: str, values: Vector, dimension: Dimension) -> WorldColumn:
    size = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    unit = suited(size, dimension)
    return WorldColumn(key, kind, unit, in_unit(1.0, unit) * values if unit else values)


def _numbers(values: Sequence[float | None]) -> Vector:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def world_data(task: Task, rows: Sequence[Row]) -> dict[str, Any]:
    """What the table says of worlds in words, for the script."""
    verdicts, ends = (
        _coded(texts)
        for texts in ([row["verdict"] for row in rows], [_why(task, row) for row in rows])
    )
    return {
        "worlds": [row["world"] for row in rows],
        "success": packed(np.array([row["success"] for row in rows], "u1")),
        "verdicts": verdicts,
        "why": ends,
        "expectations": [
            {"name": key, "text": text, "met": packed(np.array(list(_met(rows, key)), "u1"))}
            for key, text in expectation_texts(task).items()
        ],
    }


def _met(rows: Sequence[Row], key: str) -> Iterator[int]:
    for row in rows:
        met = row.get(f"expect {key}")
        yield _UNKNOWN if met is None else _MET if met else _MISSED


def _why(task: Task, row: Row) -> str:
    """Why a world was no success, in words; empty of one that was."""
    if row["success"]:
        return ""
    if row["status"] != "done":
        stage = row.get("stage")
        return f"{row['text'] or row['reason']}{f', in stage {stage}' if stage else ''}"
    texts = expectation_texts(task).items()
    missed = [text for key, text in texts if row.get(f"expect {key}") is False]
    return "; ".join([*missed, *filter(None, [row.get("findings")])])


def _coded(texts: Sequence[str]) -> dict[str, Any]:
    """Texts that are often the same, as numbers into a list."""
    names = list(dict.fromkeys(texts))
    number = {name: i for i, name in enumerate(names)}
    return {"names": names, "of": packed(np.array([number[text] for text in texts], "<u4"))}


def packed(values: np.ndarray[Any, Any]) -> str:
    """The bytes of an array as text."""
    return base64.b64encode(values.tobytes()).decode()
