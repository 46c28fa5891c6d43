"""How the axes of a stage come to rest, from the poles of its sampled loop.

Which poles an axis has follows from its own response: displaced alone from the equilibrium and let
go, it comes back as sum_i A_i e^(s_i t) over the poles s_i of the loop. The shapes of poles do not
tell: axes whose loops are alike have poles in common, and these shapes lie anywhere among them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.prediction.types import Settling
from taskspec.program.sensor import SensorModel
from taskspec.stability.loop import Mode, one_step
from taskspec.stability.margin import grows
from taskspec.stability.sampled_stage import SampledStage

Vector = NDArray[np.float64]

#: A pole is one of an axis if at least this share of its displacement comes back with it.
_TAKES_PART = 0.1
#: Poles nearer to each other than this share of their size are taken as one.
_ALIKE = 1e-2
#: The response is looked at so often over so many of the slowest time constants.
_LOOKS, _REACH = 400, 5.0
#: No response is followed for longer than this [s].
_LONGEST = 20.0
_NULL_SPACE = "null space"


def settling(sampled: SampledStage, modes: Sequence[Mode]) -> dict[str, Settling]:
    """The slowest pole of each axis, each equation and the null space.

    An axis that nothing brings back, or that goes back at once, has none; nor has any axis of a
    stage that is unstable.

    Args:
        sampled: the stage.
        modes: its own, the least stable first.
    """
    if any(grows(mode) for mode in modes):
        return {}
    poles = _distinct(modes)
    dying = [1 / -mode.s.real for mode in poles if mode.s.real < 0]
    found: dict[str, Settling] = {}
    if dying:
        rows = _rows(sampled)
        times, responses = _responses(sampled, rows, min(_REACH * max(dying), _LONGEST))
        for name, response in zip(rows, responses.T, strict=True):
            slowest = _slowest(times, response, poles)
            if slowest is not None:
                found[name] = _of(slowest)
    inner = next((mode for mode in modes if sampled.axis(mode) == _NULL_SPACE), None)
    return found if inner is None else found | {_NULL_SPACE: _of(inner)}


def _distinct(modes: Sequence[Mode]) -> list[Mode]:
    """One mode of those with like poles."""
    found: list[Mode] = []
    for mode in modes:
        if all(abs(mode.s - m.s) > _ALIKE * abs(m.s) for m in found):
            found.append(mode)
    return found


def _rows(sampled: SampledStage) -> dict[str, Vector]:
    """(n,) rates of axes and equations per rate of the joints."""
    J = np.kron(np.eye(2), sampled.rotation.T) @ sampled.context.start_jacobian
    rows = {axis: J[AXES.index(axis)] for axis in sampled.stage.plan.axes}
    return rows | {e: sampled.context.start_equations[e].normal for e in sampled.stage.plan.active}


def _responses(
    sampled: SampledStage, rows: dict[str, Vector], span: float
) -> tuple[Vector, Vector]:
    """(k,) times [s], and (k, rows) how each row comes back from a unit displacement of its own.

    An axis is displaced with the others held, an equation along what gives way to it.
    """
    context, task = sampled.context, sampled.context.loaded.task
    sensor, plant = SensorModel.of(task.robot.sensor, context.period), sampled.plant()
    F = one_step(sampled.controller, plant, sensor, samples=True)
    if sensor.hold_ticks > 1:
        held = one_step(sampled.controller, plant, sensor, samples=False)
        F = np.linalg.matrix_power(held, sensor.hold_ticks - 1) @ F
    step = sensor.hold_ticks * context.period
    stride = max(1, round(span / _LOOKS / step))
    F = np.linalg.matrix_power(F, stride)
    W = np.linalg.inv(context.start_inertia)
    axes = np.array([rows[a] for a in sampled.stage.plan.axes])
    pushed = [*(W @ axes.T @ np.linalg.inv(axes @ W @ axes.T)).T]
    pushed += [W @ rows[e] / (rows[e] @ W @ rows[e]) for e in sampled.stage.plan.active]
    x = np.zeros((len(F), len(rows)))
    x[: plant.n] = np.array(pushed).T
    seen_by = np.array([*rows.values()])
    found = []
    for _ in range(_LOOKS):
        found.append(np.einsum("rn,nr->r", seen_by, x[: plant.n]))
        x = F @ x
    return np.asarray(stride * step * np.arange(_LOOKS), dtype=float), np.array(found)


def _slowest(times: Vector, response: Vector, poles: Sequence[Mode]) -> Mode | None:
    """The slowest pole with a share in a response, by least squares over all that it can show."""
    shown = [mode for mode in poles if abs(mode.s.real) * (times[1] - times[0]) < 1.0]
    # What is neutral stays where it is, or goes on.
    columns = [np.ones_like(times), times]
    owners: list[Mode] = []
    for mode in shown:
        for column in _columns(times, mode):
            columns.append(column)
            owners.append(mode)
    parts = np.linalg.lstsq(np.array(columns).T, response, rcond=None)[0][2:]
    sizes = {id(mode): 0.0 for mode in shown}
    for mode, part in zip(owners, parts, strict=True):
        sizes[id(mode)] = math.hypot(sizes[id(mode)], float(part))
    return next((mode for mode in shown if sizes[id(mode)] > _TAKES_PART), None)


def _columns(times: Vector, mode: Mode) -> Iterator[Vector]:
    envelope = np.exp(mode.s.real * times)
    yield envelope * np.cos(mode.s.imag * times)
    if mode.s.imag:
        yield envelope * np.sin(mode.s.imag * times)


def _of(mode: Mode) -> Settling:
    rate = float(-mode.s.real)
    return Settling(1 / rate if rate > 0 else math.inf, mode.frequency, float(mode.damping_ratio))
