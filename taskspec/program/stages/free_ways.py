"""What a held mechanism leaves free, on the axes of a stage."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.laws.case import FreeWays
from taskspec.laws.mechanism_form import damping_rate
from taskspec.program.plan import StagePlan
from taskspec.program.reference.measurement import Measurement

#: A motion axis drives a direction of the mechanism if at least this share of it is along the axis.
_DRIVES = 0.1


def free_ways(plan: StagePlan, measurement: Measurement) -> FreeWays:
    """The free directions of the mechanism that a stage holds, at its control point now.

    Which of them its motion axes drive is decided at the start pose.
    """
    context, point = plan.context, measurement.point
    mechanism = context.mechanisms[plan.contacts.held]
    R = measurement.at.R.T
    rows = [a.row for a in plan.axes]
    T = (ca.diagcat(R, R) @ mechanism.twists(point.p - point.offset, point.p))[rows, :]
    driven, others = _driven(plan)
    return FreeWays(T @ ca.DM(driven), T @ ca.DM(others), damping_rate(context.period))


def _driven(plan: StagePlan) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(k, d), (k, o) of the mechanism's k directions: driven by motion axes, and not driven."""
    context = plan.context
    mechanism = context.mechanisms[plan.contacts.held]
    twists = mechanism.free_twists(context.start_p, context.start_p + plan.kinematics.lever)
    lengths = np.array([1.0] * 3 + [ARM_LENGTH] * 3)[:, None]
    ways = lengths * (np.kron(np.eye(2), plan.rotation.T) @ twists)
    size = np.linalg.norm(ways, axis=0)
    moving = [a.row for a, p in plan.plans.items() if not (p.force or p.soft)]
    _, shares, V = np.linalg.svd(np.vstack([(ways / size)[moving], np.zeros((6, len(size)))]))
    chosen = V.T / size[:, None]
    return chosen[:, shares > _DRIVES], chosen[:, shares <= _DRIVES]
