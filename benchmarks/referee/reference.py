"""The pose that rules of admittance are given as their reference, from what a plant reports.

Such a rule moves an arm off a pose that it is given; where the task has a set point of force, that
pose stays where the motion before has brought it.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from referee.session import Sample

Vector = NDArray[np.float64]


def separation(to: tuple[Vector, Vector], of: tuple[Vector, Vector]) -> Vector:
    """(6,) from one pose to another, world axes: place [m], and rotation vector [rad]."""
    return np.concatenate([to[1] - of[1], pin.log3(to[0] @ of[0].T)])


class Reference:
    """Follows the references of a task's axes.

    Attributes:
        pose: (3, 3) axes and (3,) place of the tip in the world [m].
        twist: (6,) of it, world axes [m/s, rad/s].
    """

    def __init__(self, period: float) -> None:
        """Takes the control period [s]."""
        self.pose = np.eye(3), np.zeros(3)
        self.twist = np.zeros(6)
        self._period = period
        self._at: Vector | None = None

    def follow(self, sample: Sample) -> None:
        """Goes on by one tick.

        An axis without a position of its own goes on from where it was by its velocity, if it has
        one.
        """
        here, T = sample.extras["position"], sample.frame
        before = here if self._at is None else self._at + self._period * sample.rate
        given = sample.extras["position_ref"]
        self._at = np.where(np.isfinite(given), given, before)
        R, p = sample.tip
        off = T @ (self._at - here)
        self.pose = pin.exp3(off[3:]) @ R, p + off[:3]
        self.twist = sample.jacobian @ sample.v + T @ sample.off_rate
