"""What a run in contact is measured by.

NISTIR 8097, "Benchmarking robot force control capabilities", measures a step of force by its
settling time, its overshoot and what is left of the error. Beside them stands what a task needs:
the contact that is lost, and the error along the path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

#: Share of the set point within which a force has settled.
BAND = 0.05
#: Below this a contact is lost [N].
TOUCHING = 0.1


@dataclass(frozen=True)
class Metrics:
    """Of one stage.

    Attributes:
        force_rms: of the force's error [N], once the set point has been reached; NaN without one.
        overshoot: beyond the set point [N].
        settled: from the stage's beginning until the error stays within `BAND` [s]; inf if never.
        lost: share of ticks without contact.
        path_rms: of the position's error along the axes that are led [m].
    """

    force_rms: float
    overshoot: float
    settled: float
    lost: float
    path_rms: float


def metrics(
    time: Vector, force: Vector, wanted: Vector, off: Vector, least: float = TOUCHING
) -> Metrics:
    """Those of a stage that presses along one axis.

    Args:
        time: (k,) since the stage began [s].
        force: (k,) along the axis [N].
        wanted: (k,) its set point [N]; what it comes to is its last value.
        off: (k, m) error of each led axis [m].
        least: force below which there is no contact [N].
    """
    final, error = wanted[-1], force - wanted
    there = np.abs(wanted - final) <= 1e-9 * max(1.0, abs(final))
    outside = np.flatnonzero(np.abs(force - final) > BAND * abs(final))
    last = int(outside[-1]) + 1 if len(outside) else 0
    period = float(time[1] - time[0])
    beyond = np.sign(final) * force - abs(final)
    return Metrics(
        force_rms=float(np.sqrt(np.mean(error[there] ** 2))),
        overshoot=max(0.0, float(np.max(beyond))),
        settled=float(time[0] + period * last) if last < len(force) else float("inf"),
        lost=float(np.mean(np.abs(force) < least)),
        path_rms=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) if off.size else 0.0,
    )
