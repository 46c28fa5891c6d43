"""The margin of a condition inside its bounds, and the tick at which it was broken."""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from taskspec.expression import tree
from taskspec.expression.series import Series

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


def room(value: Vector, low: Vector | None, high: Vector | None) -> Vector:
    """Distance to the nearest bound, negative outside.

    Args:
        value: (n,) measured.
        low, high: (n,) bounds; None on an open side.
    """
    sides = []
    if low is not None:
        sides.append(value - low)
    if high is not None:
        sides.append(high - value)
    return reduce(np.minimum, sides)


def left(distance: float, low: float | None, high: float | None) -> float | None:
    """The share of a tolerance that a distance inside of it leaves unused."""
    if low is not None and high is not None:
        half = (high - low) / 2
    else:
        half = abs(high if low is None else low)  # type: ignore[arg-type]
    return distance / half if half > 0 else None


def lost_share(bad: Mask, window: Mask, amount: float) -> int:
    """The row at which more ticks had failed than a share forgives.

    Args:
        bad: (n,) ticks that fail.
        window: (n,) ticks that count.
        amount: share that must hold.
    """
    allowed = np.floor((1 - amount * (1 - 1e-12)) * np.count_nonzero(window))
    return int(np.flatnonzero(bad & window)[int(allowed)])


def reached(
    node: tree.Node, values: Series, low: float | None, high: float | None
) -> tuple[int | None, bool]:
    """The row at which one number of a run left its bounds for good.

    A largest or smallest value leaves them at a tick. A root mean square leaves an upper bound at
    the tick at which the sum of squares exceeds all that its ticks may have. Of other numbers
    only the last tick decides.

    Args:
        node: the measured part.
        values: what it reduces, tick by tick.
        low, high: its bounds.

    Returns:
        The row, None without any; and whether the value at that tick is itself outside.
    """
    assert values.window is not None
    rows = np.flatnonzero(values.window)
    if not len(rows):
        return None, False
    inside, reducer = values.inside(), node.reducer if isinstance(node, tree.Reduce) else ""
    over: Mask | None = None
    if reducer == "max" and high is not None:
        over = inside >= high
    elif reducer == "min" and low is not None:
        over = inside <= low
    elif reducer == "rms" and high is not None:
        over = np.cumsum(inside**2) >= len(inside) * high**2
    if over is not None and over.any():
        return int(rows[np.argmax(over)]), reducer != "rms"
    return int(rows[-1]), False
