"""The chapter's own conditions of stability, beside the sampled model that decides.

On a stiff contact they can be wrong a hundredfold; where they agree with the sampled model they say
why.
"""

from __future__ import annotations

import numpy as np

from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.conditions import AxisContact, StabilityCondition
from taskspec.laws.gains import on_axis
from taskspec.program.sensor import SensorModel
from taskspec.stability.sampled_stage import SampledStage, along

#: A contact on which more than this share of a step's acceleration comes back is called rigid.
_RIGID_PHASE = 0.3


def conditions(sampled: SampledStage) -> tuple[StabilityCondition, ...]:
    """All conditions of the chapter that speak of a stage's contacts with the world's shapes."""
    law, found = sampled.stage.plan.law.control_law, list[StabilityCondition]()
    for name in sampled.pressed:
        if name not in sampled.context.surfaces:
            continue
        for axis in sampled.stage.plan.axes:
            if along(sampled.context, sampled.rotation, name, axis):
                found.extend(law.conditions(_at(sampled, name, axis)))
    return tuple(found)


def _at(sampled: SampledStage, name: str, axis: Axis) -> AxisContact:
    plan, contact = sampled.stage.plan.plans[axis], sampled.context.compliances[name]
    sensor = SensorModel.of(sampled.context.loaded.task.robot.sensor, sampled.context.period)
    return AxisContact(
        axis=axis,
        force=plan.force,
        normal=plan.yields,
        gains=on_axis(sampled.stage.plan.gains, axis),
        stiffness=contact.stiffness,
        mass=_arm_mass(sampled, axis),
        rigid=contact.phase > _RIGID_PHASE and sensor.direct,
        period=sampled.context.period,
        largest_mass=lambda: _largest_mass(sampled),
    )


def _arm_mass(sampled: SampledStage, axis: Axis) -> float:
    """Lambda_n = 1/(a^T J H^-1 J^T a) along a translation of the stage's frame [kg]."""
    row = sampled.rotation[:, AXES.index(axis)] @ sampled.context.start_jacobian[:3]
    return float(1.0 / (row @ np.linalg.solve(sampled.context.start_inertia, row)))


def _largest_mass(sampled: SampledStage) -> float:
    """lambda_max(H_x) of the translations [kg]."""
    rows = [AXES.index(a) for a in sampled.stage.plan.axes]
    J = (np.kron(np.eye(2), sampled.rotation.T) @ sampled.context.start_jacobian)[rows]
    H_x = np.linalg.inv(J @ np.linalg.solve(sampled.context.start_inertia, J.T))
    linear = [i for i, a in enumerate(sampled.stage.plan.axes) if not a.is_rotation]
    return float(np.max(np.linalg.eigvalsh(H_x[np.ix_(linear, linear)])))
