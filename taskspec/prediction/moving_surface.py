"""Forces on a surface that moves by itself under a stage whose frame does not go with it.

The way of the surface along its normal drives the sampled loop. With a force loop of mass h,
damping d, gains p and i on a contact k this is, to the sampling,

    (f_d - f) / p_s = (h s^2 + d s) / ((1 + p) + i/s + (h s^2 + d s)/k).
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.prediction.at_start import StageAtStart
from taskspec.stability.loop import UnfitError
from taskspec.stability.sampled_stage import SampledStage

Vector = NDArray[np.float64]

#: A surface that moves along its normal by less than this stands [m].
_STANDS = 1e-9
#: The longest stretch that is looked at, and what of it is left out as its beginning [s].
LONGEST, _BEGINNING = 10.0, 4.0


def way_of(here: StageAtStart, name: str, times: Vector) -> Vector:
    """(N,) by how much the surface of an object comes towards the tool [m].

    Args:
        here: the stage, with the tool where the run begins.
        name: of the object.
        times: (N,) of the run [s].
    """
    context = here.context
    base, clock = context.moving_bases[name], ca.SX.sym("clock")
    at = base.at(clock)
    center = ca.SX(ca.DM(context.start_p))
    distance = context.surfaces[name].distance(at.place(center))
    gap = np.array(ca.Function("gap", [clock], [distance]).map(len(times))(times)).ravel()
    return np.asarray(gap[0] - gap)


def change(
    here: StageAtStart, name: str, sampled: SampledStage | None, begins: float, lasts: float | None
) -> tuple[float, float] | None:
    """The least and the greatest of what a contact bears more than at rest [N].

    Args:
        here: the stage.
        name: of the contact, which moves.
        sampled: its loop; None where there is none.
        begins: the stage, on the run's clock [s].
        lasts: the stage [s]; None where that is not known.

    Returns:
        None where that cannot be told; zeros of a surface that does not move along its normal.
    """
    period = here.context.period
    span = min(LONGEST if lasts is None else lasts, LONGEST)
    count = round((span + _BEGINNING) / period) + 1
    way = way_of(here, name, begins - _BEGINNING + period * np.arange(count, dtype=float))
    if not np.isfinite(way).all():
        return None
    if float(np.ptp(way)) < _STANDS:
        return 0.0, 0.0
    if sampled is None or name not in sampled.pressed:
        return None
    try:
        found = sampled.moved(name, way)[round(_BEGINNING / period) :]
    except UnfitError:
        return None
    return (float(found.min()), float(found.max())) if np.isfinite(found).all() else None
