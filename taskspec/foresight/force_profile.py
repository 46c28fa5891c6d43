"""Set points that change with time, over the whole time of their stage."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.program.plan import StagePlan
from taskspec.text.expression import Expression

#: Instants at which a profile is looked at.
_LOOKS = 121


@dataclass(frozen=True, slots=True)
class ForceProfile:
    """The set point of one axis against time.

    Attributes:
        axis: whose it is.
        times: (k,) [s].
        values: (k,) [N, N m].
    """

    axis: Axis
    times: tuple[float, ...]
    values: tuple[float, ...]


def force_profiles(stage: StagePlan) -> list[ForceProfile]:
    """Set points of a stage that depend on its time alone, until it ends.

    A stage that a guard ends may end before its forces are what they would become.
    """
    passage, found = stage.nominal.passage, []
    lasts = max(stage.spec.time or 0.0, 0.0 if passage is None else passage.last.time)
    if stage.spec.until is not None or not lasts:
        return []
    times = tuple(np.linspace(0.0, lasts, _LOOKS).tolist())
    for axis, entry in stage.spec.axes.items():
        force = entry.set_point if axis in stage.axes else None
        if force is None or stage.known(force.wanted) is not None:
            continue
        values = set_points_at(stage, force.wanted, times)
        if values is not None:
            found.append(ForceProfile(axis, times, values))
    return found


def set_points_at(
    stage: StagePlan, wanted: Expression, times: Sequence[float]
) -> tuple[float, ...] | None:
    """(k,) a set point at times of its stage [N, N m]; None where it depends on more than that.

    Args:
        stage: the stage.
        wanted: the set point.
        times: (k,) since it began [s].
    """
    values = [stage.known(wanted, {"t": float(t)}) for t in times]
    known = tuple(v for v in values if v is not None and math.isfinite(v))
    return known if len(known) == len(values) else None


def at(profiles: list[ForceProfile], i: int) -> dict[Axis, float]:
    """All of them at their i-th instant."""
    return {p.axis: p.values[i] for p in profiles if p.values[i]}
