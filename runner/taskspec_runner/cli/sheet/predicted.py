"""What a stage is expected to do, in words, for `explain`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.prediction import Depth, Duration, Equilibrium, Extreme, Impact, Selection
from taskspec.prediction import StagePrediction as Predicted
from taskspec.spec import Task
from taskspec.text.units import FORCE, LENGTH, MASS, STIFFNESS, TIME, VELOCITY, number, scaled, show

_COMPONENTS = {"xyz": "xyz", "rpy": ("roll", "pitch", "yaw")}
#: A force or moment below this is none [N, N m].
_NOTHING = 1e-6
#: A component below this is not shown.
_SHOWN = 1e-6


@dataclass(frozen=True, slots=True)
class PredictedRow:
    """Something expected, what it is in the worst world of `vary`, and what it follows from."""

    what: str
    value: str
    worst: str
    source: str


def predicted_rows(task: Task, stage: Predicted) -> Iterator[PredictedRow]:
    """All that is expected of a stage of a task."""
    yield PredictedRow("duration", duration_text(stage.duration), "", stage.duration.why)
    if stage.impact is not None:
        yield _impact(task, stage.impact)
    yield from _forces(task, stage)
    for depth in stage.depths.values():
        yield _depth(task, depth)
    if stage.drift:
        speed = "faster and faster" if math.isinf(stage.drift) else show(stage.drift, VELOCITY, 3)
        yield PredictedRow("drift", speed, "", "of set points that nothing returns")
    yield from _settling(stage)


def duration_text(duration: Duration) -> str:
    """Expected and longest duration."""
    if duration.expected is None:
        bound = "" if duration.most is None else f", at most {show(duration.most, TIME, 3)}"
        return f"unknown{bound}"
    shown = show(duration.expected, TIME, 3)
    bounded = duration.most is not None and duration.most > duration.expected + 1e-9
    return f"{shown}, at most {show(duration.most or 0.0, TIME, 3)}" if bounded else shown


def _impact(task: Task, met: Impact) -> PredictedRow:
    def peak(force: float) -> str:
        return f"up to {show(force, FORCE, 2)}"

    strikes = f"{show(met.mass, MASS, 2)} at {show(met.speed, VELOCITY, 3)}"
    whole = peak(met.peak)
    if met.largest < met.peak:
        whole += f", {show(met.largest, FORCE, 2)} of it before the guard"
    elif met.largest > met.peak:
        whole = f"{peak(met.largest)}, {show(met.peak, FORCE, 2)} at once"
    return PredictedRow(
        f"impact on {met.contact}",
        whole,
        _worst(task, met.worst, peak),
        f"{strikes} on {scaled(met.stiffness, STIFFNESS)}",
    )


def _forces(task: Task, stage: Predicted) -> Iterator[PredictedRow]:
    """Forces at rest; those that are nothing together."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for force in stage.equilibrium.values():
        text = _force(force)
        worst = _worst(task, force.worst, partial(_newtons, force.signal))
        groups.setdefault((text, worst, force.source), []).append(force.signal)
    for (text, worst, source), signals in groups.items():
        yield PredictedRow(" ".join(signals), text, worst, source)
    for signal, why in stage.left_out.items():
        yield PredictedRow(signal, "unknown", "", why)


def _force(force: Equilibrium) -> str:
    if force.steady:
        return _newtons(force.signal, force.value)
    return f"{_newtons(force.signal, force.low)} to {_newtons(force.signal, force.high)}"


def _newtons(signal: str, value: float) -> str:
    turns = "torque" in signal.split(".")
    if abs(value) < _NOTHING:
        return "0"
    return scaled(value, FORCE.on(rotation=turns), 3)


def _depth(task: Task, depth: Depth) -> PredictedRow:
    def way(value: float) -> str:
        return scaled(value, LENGTH.on(rotation=depth.angular), 3)

    return PredictedRow(
        f"into {depth.on}", way(depth.depth), _worst(task, depth.worst, way), depth.source
    )


def _settling(stage: Predicted) -> Iterator[PredictedRow]:
    """Time to 2 % of each axis; equal ones together."""
    groups: dict[tuple[str, str], list[str]] = {}
    for axis, mode in stage.settling.items():
        if math.isinf(mode.time_constant):
            value, source = "never", "grows, or stays"
        else:
            value = f"in {_seconds(mode.settling_time)}"
            source = f"to 2 %, tau {_seconds(mode.time_constant)}"
        groups.setdefault((value, source), []).append(axis)
    for (value, source), axes in groups.items():
        verb = "settles" if len(axes) == 1 else "settle"
        yield PredictedRow(f"{' '.join(axes)} {verb}", value, "", source)


def _seconds(time: float) -> str:
    return scaled(time, TIME, 3)


def _worst(task: Task, extreme: Extreme | None, text: Callable[[float], str]) -> str:
    """A value and the world in which it is had."""
    if extreme is None:
        return ""
    parts = []
    for (path, index), value in extreme.values.items():
        _, name, key = path.split(".")
        component = f" {_COMPONENTS[key][index]}" if index is not None else ""
        written = scaled(value, task.dimensions_of(path)[index or 0], 3)
        parts.append(f"{name}.{key}{component} = {written}")
    return f"{text(extreme.value)} at {', '.join(parts)}"


def selection_rows(selection: Selection) -> tuple[tuple[str, str], ...]:
    """The matrices, on a line each."""
    found = [("S_f", _matrix(selection.force)), ("S_v", _matrix(selection.motion))]
    if selection.soft:
        found.append(("neither", f"{' '.join(selection.soft)}: springs of their own"))
    return tuple(found)


def _matrix(M: NDArray[np.float64]) -> str:
    """A basis along axes as the diagonal of its projector, another one column by column."""
    there = np.abs(M) > _SHOWN
    if np.all(np.count_nonzero(there, axis=0) == 1):
        chosen = np.count_nonzero(there, axis=1)
        return f"diag({' '.join(map(str, chosen))})"
    columns = (" ".join(number(float(v) + 0.0, 3) for v in np.round(c, 6)) for c in M.T)
    return ", ".join(f"({column})^T" for column in columns)
