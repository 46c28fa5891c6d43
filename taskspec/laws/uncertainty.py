"""What the controller's model of the arm may lack, as a file bounds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Bounds of what a model lacks.

    Attributes:
        wrench: by axis, of what pushes at the control point [N, N m].
        joint_torque: of each joint, or one for all [N m, N].
        payload: of a point mass at the control point [kg].
        inertia: a, where the inertia H (1 - a) <= H_true <= H (1 + a) and C q' + g lacks as much.
    """

    wrench: Mapping[Axis, float] = field(default_factory=dict)
    joint_torque: tuple[float, ...] = ()
    payload: float = 0.0
    inertia: float = 0.0
