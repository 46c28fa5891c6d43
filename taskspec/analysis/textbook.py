"""The chapter's own conditions of stability, beside the sampled model that decides.

On a stiff contact they can be wrong a hundredfold; where they agree with the sampled model they say
why.
"""

from __future__ import annotations

import numpy as np

from taskspec.analysis.stage import Analysed, along
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.conditions import AxisContact, StabilityCondition
from taskspec.laws.gains import on_axis
from taskspec.program.sensor import SensorModel

#: A contact on which more than this share of a step's acceleration comes back is called rigid.
_RIGID_PHASE = 0.3


def conditions(seen: Analysed) -> tuple[StabilityCondition, ...]:
    """All conditions of the chapter that speak of a stage's contacts with the world's shapes."""
    law, found = seen.stage.plan.law.control_law, list[StabilityCondition]()
    for name in seen.pressed:
        if name not in seen.context.surfaces:
            continue
        for axis in seen.stage.plan.axes:
            if along(seen.context, seen.rotation, name, axis):
                found.extend(law.conditions(_at(seen, name, axis)))
    return tuple(found)


def _at(seen: Analysed, name: str, axis: Axis) -> AxisContact:
    plan, contact = seen.stage.plan.plans[axis], seen.context.compliances[name]
    sensor = SensorModel.of(seen.context.loaded.task.robot.sensor, seen.context.period)
    return AxisContact(
        axis=axis,
        force=plan.force,
        normal=plan.yields,
        gains=on_axis(seen.stage.plan.gains, axis),
        stiffness=contact.stiffness,
        mass=_felt_mass(seen, axis),
        rigid=contact.phase > _RIGID_PHASE and sensor.direct,
        period=seen.context.period,
        largest_mass=lambda: _largest_mass(seen),
    )


def _felt_mass(seen: Analysed, axis: Axis) -> float:
    """Lambda_n = 1/(a^T J H^-1 J^T a) along a translation of the stage's frame [kg]."""
    row = seen.rotation[:, AXES.index(axis)] @ seen.context.start_jacobian[:3]
    return float(1.0 / (row @ np.linalg.solve(seen.context.start_inertia, row)))


def _largest_mass(seen: Analysed) -> float:
    """lambda_max(H_x) of the translations [kg]."""
    rows = [AXES.index(a) for a in seen.stage.plan.axes]
    J = (np.kron(np.eye(2), seen.rotation.T) @ seen.context.start_jacobian)[rows]
    H_x = np.linalg.inv(J @ np.linalg.solve(seen.context.start_inertia, J.T))
    linear = [i for i, a in enumerate(seen.stage.plan.axes) if not a.is_rotation]
    return float(np.max(np.linalg.eigvalsh(H_x[np.ix_(linear, linear)])))
