"""The arm as the tool has it: its equation of motion in operational space, (4.8)-(4.11).

    H_x x'' + C_x x' + g_x = J^-T u + f

with H_x = J^-T H J^-1, C_x = (J^-T C - H_x J') J^-1 and g_x = J^-T g (4.9). Where an arm has more
joints than axes, the inverse that is consistent with its dynamics takes the place of J^-1,
J_# = H^-1 J^T H_x with H_x = (J H^-1 J^T)^-1 (Khatib, 1987), and the terms are those of motions
without one of the null space.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.robot.twin import Twin

Array = NDArray[np.float64]

#: From here on the condition of J H^-1 J^T is that of a singular pose.
SINGULAR = 1e12


class SingularPoseError(ValueError):
    """The arm cannot move along all of its axes, so that there is no operational space."""


@dataclass(frozen=True, slots=True, eq=False)
class OperationalTerms:
    """Terms at one configuration, on the axes of the arm, world axes, for the tip.

    Attributes:
        axes: (m,) of the arm.
        inertia: (m, m) H_x [kg, kg m, kg m^2], symmetric, positive definite: (4.10).
        gravity: (m,) g_x [N, N m].
        by_rate: (m, m, m) C_x of a unit rate along and about each axis: C_x(x') is their sum,
            each times its rate [kg/m, kg, kg m for each unit].
    """

    axes: tuple[Axis, ...]
    inertia: Array
    gravity: Array
    by_rate: Array

    def coriolis(self, rate: Array) -> Array:
        """(m, m) C_x at a velocity x' (m,) of the tip [kg/s, kg m/s, kg m^2/s]."""
        return np.tensordot(rate, self.by_rate, 1)

    def masses(self, *, angular: bool = False) -> tuple[float, float]:
        """lambda_m, lambda_M of (4.10): the least and the largest mass [kg], or moment [kg m^2].

        Of translations while the rotations are held, or of rotations while those are. Both 0
        where the arm has no such axes.
        """
        rows = self._rows(angular=angular)
        if not rows:
            return 0.0, 0.0
        found = np.linalg.eigvalsh(self.inertia[np.ix_(rows, rows)])
        return float(found[0]), float(found[-1])

    def coriolis_bound(self) -> float:
        """k_Cx of (4.11) for translations while rotations are held [kg/m].

        ||C_x(x')|| <= k_Cx ||x'|| for every x', by the spectral norms of the three matrices into
        which C_x, with a third index for the rate, unfolds: each is at least the largest ||C_x|| of
        a unit rate, and at most sqrt(3) times that.
        """
        rows = self._rows(angular=False)
        if not rows:
            return 0.0
        tensor = self.by_rate[np.ix_(rows, rows, rows)]
        unfolded = (np.moveaxis(tensor, i, 0).reshape(len(rows), -1) for i in range(3))
        return min(float(np.linalg.norm(each, 2)) for each in unfolded)

    def _rows(self, *, angular: bool) -> list[int]:
        return [i for i, axis in enumerate(self.axes) if axis.is_rotation == angular]


def operational_terms(twin: Twin, axes: Sequence[Axis], q: Array) -> OperationalTerms:
    """The terms at coordinates q (n,).

    Args:
        twin: the arm with its tool.
        axes: world axes that the tip can move along and about independently.
        q: coordinates of the arm [rad, m].

    Raises:
        SingularPoseError: the tip cannot move along one of them.
    """
    rows = [axis.row for axis in axes]
    J, H = twin.jacobian(q)[rows], twin.inertia(q)
    from_forces = np.linalg.solve(H, J.T)
    mobility = J @ from_forces
    if np.linalg.cond(mobility) > SINGULAR:
        raise SingularPoseError("the tip cannot move along all of its axes here")
    inertia = np.linalg.inv(mobility)
    inertia = (inertia + inertia.T) / 2
    inverse = from_forces @ inertia
    by_rate = []
    for rate in inverse.T:
        C, J_dot = twin.coriolis(q, rate), twin.jacobian_rate(q, rate)[rows]
        by_rate.append((inverse.T @ C - inertia @ J_dot) @ inverse)
    return OperationalTerms(tuple(axes), inertia, inverse.T @ twin.gravity(q), np.array(by_rate))
