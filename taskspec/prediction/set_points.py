"""What set points of forces and moments come to, once their loops have settled."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import on_axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.reach import Bearing
from taskspec.program.context import Context
from taskspec.program.known_value import known_value
from taskspec.text.expression import Expression

Vector = NDArray[np.float64]

#: Instants at which a set point is looked at while its stage lasts; a prime, so that whole
#: periods of a swinging one do not fall on them.
_LOOKS = 199
#: How long a stage is looked at that nothing bounds [s].
_LONGEST = 60.0
#: What is not returned is no more than this share of what is requested: rounding.
_ROUNDING = 1e-6
#: A force that drives nothing [N].
_NOTHING = 1e-6


def span_of(
    context: Context, expression: Expression, lasts: float | None
) -> tuple[float, float, float] | None:
    """First, lowest and highest value of a set point while its stage lasts [SI].

    None where it depends on anything but params and time, or is no number.

    Args:
        context: the task.
        expression: of the set point.
        lasts: the stage [s], if that is known.
    """
    times = np.linspace(0.0, _LONGEST if lasts is None else lasts, _LOOKS)
    found = [known_value(context, expression, {"t": float(t)}) for t in times]
    values = [v for v in found if v is not None]
    if len(values) < len(found) or not np.isfinite(values).all():
        return None
    return values[0], min(values), max(values)


def settled(
    here: StageAtStart, on: Bearing, wanted: Mapping[Axis, float]
) -> dict[Axis, float] | None:
    """What is applied on force axes, by axis; None where the law leaves that open.

    Set points that contacts cannot return drift: then a f_E = a a^T f_d, (4.48), with each axis
    weighed by how fast its loop gives way. Friction holds what lies within its cone, and brakes
    with its limit beyond.

    Args:
        here: the stage.
        on: its contacts.
        wanted: set points of its force axes [N].
    """
    found = here.stage.plan.law.control_law.gives_way(here.stage.plan.gains, [*wanted])
    if found is None:
        return None
    weights = np.array(found)
    rows = [AXES.index(a) for a in wanted]
    requested = np.array([*wanted.values()]) + [_pull(here, a) for a in wanted]
    if not on.names:
        return dict(zip(wanted, requested.tolist(), strict=True))
    N, root = on.normals[rows], np.sqrt(weights)
    push = np.linalg.lstsq(-root[:, None] * N, root * requested, rcond=None)[0]
    returned = -N @ np.maximum(push, 0.0)
    rest = requested - returned
    size, most = float(np.linalg.norm(rest)), on.friction * float(np.maximum(push, 0.0).sum())
    if size > _ROUNDING * float(np.linalg.norm(requested)):
        returned = returned + rest * min(1.0, most / size)
    else:
        returned = requested
    return dict(zip(wanted, returned.tolist(), strict=True))


def drift(here: StageAtStart, missing: Mapping[Axis, float]) -> float:
    """Speed to which loops drive the tool along what returns no more force [m/s]; may be infinite.

    Args:
        here: the stage.
        missing: f_d - f by force axis [N].
    """
    unreturned = {axis: _pull(here, axis) + f for axis, f in missing.items()}
    if all(abs(f) < _NOTHING for f in unreturned.values()):
        return 0.0
    law, gains = here.stage.plan.law.control_law, here.stage.plan.gains
    return math.hypot(*(law.runs_away(on_axis(gains, a), f) for a, f in unreturned.items()))


def _pull(here: StageAtStart, axis: Axis) -> float:
    """What a motion on a force axis adds to its set point [N]."""
    stage, plan = here.stage, here.stage.plan.plans[axis]
    if not plan.motion or not plan.mode.goes_on:
        return 0.0
    rate = plan.mode.constant_rate(stage.plan.known) or 0.0
    return stage.plan.law.control_law.pulls(on_axis(stage.plan.gains, axis), rate)
