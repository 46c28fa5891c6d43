"""What a run was predicted to do, drawn beside what it did."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from taskspec_runner.record.file_array import full
from taskspec_runner.record.folder import Json, mapping, number
from taskspec_runner.record.history import Mask, Vector
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.report.chart import Level, Trace
from taskspec_runner.report.quantities import figure
from taskspec_runner.runs import Run
from taskspec_runner.verdict.predicted import axis_of
from taskspec_runner.verdict.response import stays

ROLE = "predicted"
#: A decay is drawn for so many time constants, and only of an error that is this share of the
#: chart's range.
_LASTS, _VISIBLE = 5.0, 0.01
#: The step that a force makes to where it rests is at least this share of an error of its own.
_OWN = 0.5


def stage_prediction(run: Run, stage: str) -> Json:
    """What was predicted of a stage; empty where nothing was."""
    return mapping(mapping(run.summary.get("predicted")).get(stage))


def rest_levels(run: Run, signals: Iterable[str], factor: float) -> Iterator[Level]:
    """Where forces and moments were predicted to come to rest; `factor` makes the chart's unit."""
    for name in signals:
        for visit in run.visits:
            at = mapping(mapping(stage_prediction(run, visit.stage).get("equilibrium")).get(name))
            value, low, high = (number(at.get(key)) for key in ("value", "low", "high"))
            if value is not None and low == high:
                yield Level(
                    visit.start, visit.end, factor * value, ROLE, "predicted at rest", "rest"
                )


def impact_levels(run: Run, signals: Iterable[str], factor: float) -> Iterator[Level]:
    """The largest force that was predicted for meeting a surface."""
    for name in signals:
        for visit in run.visits:
            met = mapping(stage_prediction(run, visit.stage).get("impact"))
            peak, values = number(met.get("peak")), run.columns.get(name)
            if peak is None or values is None or met.get("axis") != axis_of(name):
                continue
            inside = values[run.rows(visit)]
            if len(inside) and np.isfinite(inside).any():
                side = np.sign(inside[np.nanargmax(np.abs(inside))])
                if side == 0:
                    continue
                text = "predicted peak of the impact"
                yield Level(visit.start, visit.end, factor * side * peak, ROLE, text, "peak")


def depth_levels(run: Run, objects: Iterable[str], factor: float) -> Iterator[Level]:
    """How deep contacts were predicted to be pressed in at rest."""
    for name in objects:
        for visit in run.visits:
            at = mapping(mapping(stage_prediction(run, visit.stage).get("depths")).get(name))
            depth = number(at.get("depth"))
            if depth is not None:
                value = -factor * depth
                text = "predicted depth at rest"
                yield Level(visit.start, visit.end, value, ROLE, text, "rest")


def decay(run: Run, name: str, factor: float) -> Trace | None:
    """How the largest error of a force was predicted to die away, once its set point stays.

    From the tick with the largest error on, it falls by e in every predicted time constant of the
    slowest mode of its axis; of a mode that swings this is the hull. Errors that do not come from
    a step of the force itself are those of other axes, with modes of their own.
    """
    values = run.column(name)
    if values is None:
        return None
    drawn, texts = full(len(values), np.nan), []
    for visit in run.visits:
        prediction = stage_prediction(run, visit.stage)
        how = mapping(mapping(prediction.get("settling")).get(axis_of(name)))
        constant = number(how.get("time_constant"))
        target = _target(run, visit, name, prediction)
        if constant is None or constant < 2 * run.period or target is None:
            continue
        rows = np.flatnonzero(run.rows(visit))[target[1] :]
        error = values[rows] - target[0]
        if not len(rows) or not np.isfinite(error).all():
            continue
        top = int(np.argmax(np.abs(error)))
        step = values[run.rows(visit)][0] - target[0]
        if abs(step) < _OWN * abs(error[top]):
            continue
        shown = rows[top : top + round(_LASTS * constant / run.period)]
        if abs(error[top]) < _VISIBLE * np.ptp(values[np.isfinite(values)]):
            continue
        since = run.clock[shown] - run.clock[shown[0]]
        drawn[shown] = target[0] + error[top] * np.exp(-since / constant)
        texts.append(f"{figure(1e3 * constant)} ms")
    if not texts:
        return None
    label = f"predicted decay, {', '.join(dict.fromkeys(texts))}"
    return Trace(label, factor * drawn, ROLE, ROLE)


def _target(run: Run, visit: StageVisit, name: str, prediction: Json) -> tuple[float, int] | None:
    """Where a force comes to rest in a visit, and the tick of it from which its reference stays."""
    rows = run.rows(visit)
    wanted = _wanted(run, f"{name}.ref", rows)
    if wanted is None:
        wanted = _wanted(run, f"position.{axis_of(name)}.ref", rows)
    at = mapping(mapping(prediction.get("equilibrium")).get(name))
    value = number(at.get("value"))
    if wanted is None or value is None or at.get("low") != at.get("high"):
        return None
    return value, stays(wanted)


def _wanted(run: Run, column: str, rows: Mask) -> Vector | None:
    """A reference in some rows, None where it does not reach to their end."""
    values = run.columns.get(column)
    if values is None or not rows.any() or not np.isfinite(values[rows][-1]):
        return None
    return values[rows]
