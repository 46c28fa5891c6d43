"""Poles of a logged transient, by linear least squares on its own samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def poles(y: Vector, order: int, period: float, stride: int = 1) -> Vector:
    """Poles s [1/s] of a free response, slowest first.

    y[k + order] = c_1 y[k + order - 1] + ... + c_order y[k] + c_0, on every `stride`-th sample but
    with all starting points. The roots of the polynomial are exp(s stride T). The constant takes up
    the equilibrium, which therefore need not be known.

    Args:
        y: (rows,) samples. order: how many poles are excited. period: T [s].
        stride: so that there are some ten samples in the quickest oscillation.
    """
    rows = len(y) - order * stride
    past = [y[(order - 1 - i) * stride : (order - 1 - i) * stride + rows] for i in range(order)]
    scale = float(np.ptp(y))
    offset = float(y[-1])
    columns = [(p - offset) / scale for p in past]
    target = (y[order * stride :] - offset) / scale
    found = np.linalg.lstsq(np.column_stack([*columns, np.ones(rows)]), target, rcond=None)[0]
    roots = np.roots([1.0, *(-found[:order])]).astype(complex)
    s = np.log(roots) / (stride * period)
    return s[np.argsort(-s.real)]


def ratios(y: Vector, order: int) -> Vector:
    """Roots z of a free response sample by sample, largest magnitude first."""
    z = np.exp(poles(y, order, 1.0))
    return z[np.argsort(-np.abs(z))]


def rate(y: Vector, period: float) -> float:
    """Slope [unit/s] of a straight line through samples."""
    return float(np.polyfit(period * np.arange(len(y)), y, 1)[0])


def grows(y: Vector) -> bool:
    """Whether the last third of a signal swings more than the third before.

    Weighted by a Hann window, so that it does not matter how many periods a third holds.
    """
    third = len(y) // 3
    window = np.hanning(third)
    first, last = (part - np.average(part, weights=window) for part in np.split(y[-2 * third :], 2))
    return bool(np.sum(window * last**2) > np.sum(window * first**2))
