"""Bushings as functions: one source for plant, checks, values at rest and the log.

In the axes R_b and about the origin p_b of its rest pose the tip at (p, R) has the coordinates

    xi = (R_b^T (p - p_b); log(R_b^T R)),

a place and a rotation vector. The energy is U = xi^T K xi / 2, and the wrench on the tip that of
-U and of a damper on the rates of the same coordinates:

    (f; m) = -J^T (K xi + D xi'),    xi' = J (v; w).

J is the derivative of xi along twists, so that of its rotation vector is the inverse of the left
Jacobian of SO(3), not the unit matrix. Therefore f and m are the gradient of a function of the pose
whatever K couples, no closed way takes work out of the spring, and the damper takes
xi'^T D xi' >= 0. At an angle of pi the rotation vector is not unique, and U has a crest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation as so3
from taskspec.program.world import tip_pose
from taskspec.spec import Bushing, Task

Matrix = NDArray[np.float64]

#: Mass [kg] and inertia [kg m^2] for which a damping that is left out is a tenth of critical.
_UNIT = np.array([1.0] * 3 + [0.05] * 3)


@dataclass(frozen=True, slots=True)
class BushingModel:
    """A bushing at its rest pose.

    Attributes:
        name: of the object.
        rotation, origin: (3, 3), (3,) rest pose of the tip in the world.
        stiffness, damping: (6, 6) on its coordinates [SI].
    """

    name: str
    rotation: Matrix
    origin: Matrix
    stiffness: Matrix
    damping: Matrix

    @property
    def numbers(self) -> Matrix:
        """(84,) what `wrench_on_tip` takes of it."""
        matrices = (self.rotation, self.origin, self.stiffness, self.damping)
        return np.concatenate([each.ravel(order="F") for each in matrices])

    def coordinates(self, p: ca.SX, R: ca.SX) -> ca.SX:
        """(6,) xi of a tip at p (3,) with axes R (3, 3) [m, rad]."""
        return _coordinates(tip_pose.pose(p, R), ca.DM(self.rotation), ca.DM(self.origin))

    def spring(self, p: Sequence[float] | Matrix, R: Matrix) -> Spring:
        """What the spring is about a pose of the tip."""
        function = _spring()
        xi, J, wrench, change = (
            np.array(part) for part in function(tip_pose.pose(ca.DM(p), ca.DM(R)), self.numbers)
        )
        return Spring(xi.ravel(), J, wrench.ravel(), change)


@dataclass(frozen=True, slots=True)
class Spring:
    """A bushing's spring at a pose of the tip.

    Attributes:
        coordinates: (6,) xi [m, rad].
        J: (6, 6) their derivative along twists of the tip, world axes.
        wrench: (6,) on the tip, world axes [N, N m].
        change: (6, 6) of that wrench along twists.
    """

    coordinates: Matrix
    J: Matrix
    wrench: Matrix
    change: Matrix

    def geometric(self, stiffness: Matrix) -> Matrix:
        """(6, 6) how the wrench changes as J does, the coordinates' effort being kept."""
        return np.asarray(self.change + self.J.T @ stiffness @ self.J)


def bushing_models(task: Task) -> dict[str, BushingModel]:
    """All bushings of a task, by name."""
    return {name: _model(name, declared) for name, declared in task.bushings.items()}


def wrench_on_tip(x: ca.SX, twist: ca.SX, numbers: ca.SX) -> tuple[ca.SX, ca.SX]:
    """A bushing's wrench on the tip, and what the tip applies to it in its own axes.

    Args:
        x: (12,) pose of the tip in the world.
        twist: (6,) of the tip, world axes.
        numbers: (84,) of the bushing.

    Returns:
        Both (6,) at the tip [N, N m].
    """
    rotation, origin, K, D = _parts(numbers)
    xi, J = _with_jacobian(x, rotation, origin)
    applied = J.T @ (K @ xi + D @ (J @ twist))
    local = ca.vertcat(rotation.T @ applied[:3], rotation.T @ applied[3:])
    return -applied, local


def _parts(numbers: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    rotation, origin, K, D = ca.vertsplit(numbers, [0, 9, 12, 48, 84])
    return ca.reshape(rotation, 3, 3), origin, ca.reshape(K, 6, 6), ca.reshape(D, 6, 6)


def _coordinates(x: ca.SX, rotation: ca.SX | ca.DM, origin: ca.SX | ca.DM) -> ca.SX:
    place = rotation.T @ (tip_pose.place(x) - origin)
    return ca.vertcat(place, so3.log(rotation.T @ tip_pose.axes(x)))


def _with_jacobian(x: ca.SX, rotation: ca.SX, origin: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(6,) coordinates and (6, 6) their derivative along twists."""
    s, R, o = ca.SX.sym("s", 12), ca.SX.sym("R", 3, 3), ca.SX.sym("o", 3)
    xi = _coordinates(s, R, o)
    found = ca.Function("coordinates", [s, R, o], [xi, tip_pose.jacobian(xi, s)])
    value, J = found(x, rotation, origin)
    return value, J


def _spring() -> ca.Function:
    """Pose (12,) and numbers (84,) -> coordinates, their Jacobian, the wrench and its change."""
    x, numbers = ca.SX.sym("x", 12), ca.SX.sym("numbers", 84)
    rotation, origin, K, _ = _parts(numbers)
    xi, J = _with_jacobian(x, rotation, origin)
    wrench = -J.T @ (K @ xi)
    parts = [xi, J, wrench, tip_pose.jacobian(wrench, x)]
    return ca.Function("spring", [x, numbers], [ca.densify(part) for part in parts])


def _model(name: str, declared: Bushing) -> BushingModel:
    K = np.array(declared.stiffness, dtype=float)
    D = _designed(K) if declared.damping is None else np.array(declared.damping, dtype=float)
    rotation = so3.from_rpy(declared.rpy)
    return BushingModel(name, rotation, np.array(declared.xyz, dtype=float), K, D)


def _designed(K: Matrix) -> Matrix:
    """(6, 6) a tenth of critical damping for the unit mass and inertia, mode by mode."""
    root = np.sqrt(_UNIT)
    values, modes = np.linalg.eigh(K / np.outer(root, root))
    scaled = modes @ np.diag(0.1 * 2 * np.sqrt(np.maximum(values, 0.0))) @ modes.T
    return np.asarray(np.outer(root, root) * scaled)


def quickest(model: BushingModel, mobility: Matrix) -> float:
    """The greatest natural frequency [rad/s] of a tip of a mobility (6, 6) on the bushing."""
    six = np.kron(np.eye(2), model.rotation)
    moved = six.T @ mobility @ six
    values = np.linalg.eigvals(moved @ model.stiffness)
    return math.sqrt(max(float(np.real(values).max()), 0.0))
