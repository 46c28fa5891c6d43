"""Tracking metrics of each stage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.record.history import History, Mask

Vector = NDArray[np.float64]

#: What a peak is called, and the columns whose common size it is.
_PEAKS = {
    "force": ("force.x", "force.y", "force.z"),
    "torque": ("torque.rx", "torque.ry", "torque.rz"),
    "speed": ("speed",),
}

Metrics = dict[str, dict[str, float]]


def metrics(history: History, axes: Mapping[str, Sequence[str]]) -> dict[str, Metrics]:
    """Tracking of every stage that was visited.

    Args:
        history: the run.
        axes: stage to the axes that exist in it.

    Returns:
        Stage to signal to rms_error, max_error, final_error (reference - truth; the last is that
        of the last tick, with its sign), mean, min and max [SI]. The signals are `force.*` and
        `torque.*` where there is a force reference, `EQUATION.force` or `.torque` where there is a
        set point, `position.*` where there is a motion reference.
    """
    found: dict[str, Metrics] = {}
    for stage, names in axes.items():
        window = history.window(stage)
        if window.any():
            found[stage] = _stage(history, window, names)
    return found


def _stage(history: History, window: Mask, axes: Sequence[str]) -> Metrics:
    columns = history.columns
    found: Metrics = {}
    for axis in axes:
        signal = f"{'torque' if axis.startswith('r') else 'force'}.{axis}"
        found |= _against_reference(history, window, signal)
    for axis in axes:
        signal, error = f"position.{axis}", f"error.{axis}"
        if history.unrecorded.isdisjoint((signal, error)):
            found |= _signal(signal, columns[error][window], columns[signal][window])
    for signal in set_points(columns):
        found |= _against_reference(history, window, signal)
    return found


def _against_reference(history: History, window: Mask, signal: str) -> Metrics:
    """The metrics of a signal with a reference beside it; none where one was not recorded."""
    if not history.unrecorded.isdisjoint((signal, f"{signal}.ref")):
        return {}
    reference, values = (history.columns[n][window] for n in (f"{signal}.ref", signal))
    return _signal(signal, reference - values, values)


def set_points(columns: Iterable[str]) -> list[str]:
    """The efforts of equations, `EQUATION.force` or `.torque`, among the columns of a log."""
    named = [name.removesuffix(".ref") for name in columns if name.endswith(".ref")]
    return [name for name in named if name.endswith((".force", ".torque"))]


def _signal(name: str, error: Vector, values: Vector) -> Metrics:
    """The metrics of a signal over the ticks at which it has a reference, if it ever has."""
    known = np.isfinite(error) & np.isfinite(values)
    if not known.any():
        return {}
    error, values = error[known], values[known]
    return {
        name: {
            "rms_error": float(np.sqrt(np.mean(error**2))),
            "max_error": float(np.max(np.abs(error))),
            "final_error": float(error[-1]),
            "mean": float(np.mean(values)),
            "min": float(np.min(values)),
            "max": float(np.max(values)),
        }
    }


def peaks(history: History, stages: Sequence[str]) -> dict[str, dict[str, float]]:
    """Largest contact force [N], moment [N m] and tip speed [m/s] of every visited stage."""
    found = {}
    for stage in stages:
        window = history.window(stage)
        if window.any():
            found[stage] = {
                name: _largest(history, window, columns) for name, columns in _PEAKS.items()
            }
    return found


def _largest(history: History, window: Mask, names: Sequence[str]) -> float:
    if not history.unrecorded.isdisjoint(names):
        return float("nan")
    columns = [history.columns[name][window] for name in names if name in history.columns]
    # An axis that a stage does not have, on a planar arm in another frame, is not a number.
    parts = [column for column in columns if not np.isnan(column).all()]
    return float(np.sqrt(np.max(sum(part**2 for part in parts)))) if parts else 0.0
