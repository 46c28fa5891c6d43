"""The readings that a force sensor makes of wrenches, over all ticks at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.sensor import SensorModel

Vector = NDArray[np.float64]

#: Weights of past values below this are none.
_NOTHING = 1e-18


def filtered(values: Vector, pole: float) -> Vector:
    """(n, m) x[k] = b x[k-1] + (1 - b) w[k] of w (n, m), switched on for long before the first."""
    if pole <= 0:
        return values
    made = (1 - pole) * values
    made[0] = values[0]
    step, weight = 1, pole
    # The sum over ever longer pasts, doubled each time.
    while step < len(made) and weight > _NOTHING:
        made[step:] += weight * made[:-step].copy()
        step, weight = 2 * step, weight * weight
    return made


def readings(own: Vector, model: SensorModel, first: int = 1) -> Vector:
    """(n, m) what a sensor shows at ticks `first`, `first` + 1, ... of wrenches (n, m)."""
    values = filtered(own, model.pole)
    if model.hold_ticks > 1:
        at = np.arange(len(values))
        values = values[np.maximum(at - (at + first) % model.hold_ticks, 0)]
    return delayed(values, model.delay_ticks)


def delayed(values: Vector, ticks: int) -> Vector:
    """(n, m) values that come some ticks late; those before the first are as the first."""
    if not ticks:
        return values
    return np.concatenate([np.repeat(values[:1], min(ticks, len(values)), axis=0), values[:-ticks]])
