"""Selection matrices of a hybrid law: which directions bear force set points, which move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.explain.natural import reduced
from taskspec.explain.reactions import equation_wrenches
from taskspec.geometry.axis import Axis
from taskspec.program.plan import StagePlan

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Selection:
    """Bases of what a law controls, in the axes of the stage's frame: S_f^T S_v = 0.

    Attributes:
        axes: (m,) names of the rows.
        force: (m, r) S_f, wrenches by unit set points [1, m].
        motion: (m, k) S_v, twists by rates of its motion loops.
        soft: axes with a spring of their own, which are in neither.
    """

    axes: tuple[Axis, ...]
    force: Vector
    motion: Vector
    soft: tuple[str, ...] = ()


def selection(plan: StagePlan) -> Selection | None:
    """The matrices of a stage; None for a law that does not select.

    Under a law with multipliers, force axes and equations are what is selected; the equations are
    taken where the run begins. An equation that no wrench on the tool returns is in neither.
    """
    axes, law = plan.axes, plan.law.control_law
    if not law.selects:
        return None
    soft = tuple(a for a in axes if plan.plans[a].soft)
    forced = [a for a in axes if plan.plans[a].force]
    columns = [np.eye(len(axes))[axes.index(a)] for a in forced]
    if law.multipliers:
        rows = [a.row for a in axes]
        columns += [w[rows] for name, w, _ in equation_wrenches(plan) if name in plan.active]
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
