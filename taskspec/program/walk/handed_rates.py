"""The rates that one stage's reference hands on to the next, as far as the text determines them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Course, rate_until

Vector = NDArray[np.float64]


def rates_at_end(stage: StagePlan, course: Course | None) -> dict[Axis, float]:
    """Rates of a stage's reference as it ends [m/s, rad/s]; what is not known is left out.

    An axis with a force hands on where it was measured, which is taken as at rest.

    Args:
        stage: the stage.
        course: how it moves; None where that is not planned.
    """
    free = [a for a, plan in stage.plans.items() if plan.motion and not plan.axis.has_force]
    if stage.spec.until is None and course is not None:
        ways, end = course.ways, course.duration
        rates = {a: rate_until(ways[a], end) for a in free if a in ways}
    else:
        known = {a: stage.plans[a].mode.constant_rate(stage.known) for a in free}
        rates = {a: rate for a, rate in known.items() if rate is not None}
    return {a: rate for a, rate in rates.items() if math.isfinite(rate)}


def twist_of(rates: Mapping[Axis, float], rotation: Vector) -> Vector:
    """(6,) the twist of rates along and about the axes of a frame (3, 3), world axes."""
    along = np.array([rates.get(a, 0.0) for a in AXES])
    return np.concatenate([rotation @ part for part in np.split(along, 2)])


def rates_of(stage: StagePlan, rotation: Vector, twist: Vector) -> dict[Axis, float]:
    """Rates at which a stage's axes are handed over, of a (6,) twist in world axes [m/s, rad/s].

    Braking a reference that nothing commands would push with the loop's damper: a force alone
    begins at rest.
    """
    local = np.concatenate([rotation.T @ part for part in np.split(twist, 2)])
    return {
        a: 0.0 if plan.force and not plan.mode.moves else float(local[a.row])
        for a, plan in stage.plans.items()
    }
