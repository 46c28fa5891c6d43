"""Selection matrices of a hybrid law: which directions bear force set points, which move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.natural import reduced
from taskspec.prediction.reactions import equation_wrenches
from taskspec.prediction.types import Selection

Vector = NDArray[np.float64]


def selection(here: StageAtStart) -> Selection | None:
    """The matrices of a stage; None for a law that does not select.

    Under a law with multipliers, force axes and equations are what is selected; the equations are
    taken where the run begins. An equation that no wrench on the tool returns is in neither.
    """
    stage = here.stage
    axes, law = stage.plan.axes, stage.plan.law.control_law
    if not law.selects:
        return None
    soft = tuple(a for a in axes if stage.plan.plans[a].soft)
    forced = [a for a in axes if stage.plan.plans[a].force]
    columns = [np.eye(len(axes))[axes.index(a)] for a in forced]
    if law.multipliers:
        rows = [AXES.index(a) for a in axes]
        columns += [w[rows] for name, w, _ in equation_wrenches(here) if name in stage.plan.active]
    force = np.array(columns).reshape(-1, len(axes)).T
    return Selection(axes, force, _reciprocal(force, axes, soft), soft)


def _reciprocal(force: Vector, axes: tuple[Axis, ...], soft: tuple[str, ...]) -> Vector:
    """(m, k) twists on which no wrench of (m, r) does work, one for each axis that is left."""
    pivots, R, _ = reduced(force.T, axes)
    columns = []
    for j, axis in enumerate(axes):
        if j in pivots or axis in soft:
            continue
        twist = np.zeros(len(axes))
        twist[j] = 1.0
        twist[pivots] = -R[:, j]
        columns.append(twist)
    return np.array(columns).reshape(-1, len(axes)).T
