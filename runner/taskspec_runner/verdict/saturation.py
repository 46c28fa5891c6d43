"""Joints at their limits: which last so long that an engineer would call a stage saturated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.limits.bounds import COMMAND, JOINT
from taskspec.program.limits.resolution import Resolution
from taskspec_runner.verdict.oscillation import judged

Vector = NDArray[np.float64]

#: A torque is at its limit from this share of it on; what lasts takes more than so much of the
#: ticks.
AT_LIMIT, LASTS = 0.999, 0.5
#: A joint that its program holds back moves at more than this share of its limit where that is one
#: of velocity: where it is one of position, it rests.
_MOVES = 0.5


def torque_share(torque: Vector, most: float) -> float:
    """The share of the last half of a visit in which a torque is at its limit.

    Args:
        torque: (k,) of a joint [N m, N].
        most: its limit.
    """
    return float(np.mean(np.abs(torque[-judged(len(torque)) :]) >= AT_LIMIT * most))


def velocity_share(
    resolution: Resolution, joint: int, codes: Vector, v: Vector, most: float
) -> float:
    """The share of the last half of a visit in which a program holds a joint at its velocity limit.

    Args:
        resolution: the program of the stage.
        joint: number from 0.
        codes: (k,) sum of 2^i over the rows i that bind.
        v: (k,) of the joint [rad/s, m/s].
        most: its limit.
    """
    half, commanded = judged(len(v)), resolution.velocities
    for i, row in enumerate(resolution.rows):
        if row.kind == (COMMAND if commanded else JOINT) and row.number == joint:
            binds = (codes[-half:].astype(np.int64) >> i) & 1 == 1
            return float(np.mean(binds & (np.abs(v[-half:]) > _MOVES * most)))
    return 0.0
