"""Poses between the conventions: quaternions of MuJoCo, roll-pitch-yaw of task files, SE3."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]


def pose(position: Sequence[float] | Array, quaternion: Sequence[float] | Array) -> pin.SE3:
    """A pose from a position (3,) [m] and a quaternion (4,), scalar first, of any length."""
    w, x, y, z = quaternion
    unit = pin.Quaternion(float(w), float(x), float(y), float(z))
    unit.normalize()
    return pin.SE3(unit.matrix(), np.array(position, dtype=float))


def pose_of_rpy(xyz: Sequence[float] | Array, rpy: Sequence[float] | Array) -> pin.SE3:
    """A pose from `xyz` (3,) [m] and `rpy` (3,) [rad] about the fixed axes x, then y, then z."""
    roll, pitch, yaw = (float(angle) for angle in rpy)
    return pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), np.array(xyz, dtype=float))


def columns(jacobian: Array) -> Array:
    """(6, joints): Pinocchio's bindings give that of a single joint as a vector of six."""
    return np.array(jacobian).reshape(6, -1)


def mirrored(upper: Array) -> Array:
    """A symmetric matrix (n, n) of which the part below the diagonal may be anything."""
    whole = np.array(upper)
    below = _below(len(whole))
    whole[below] = whole.T[below]
    return whole


@cache
def _below(n: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    return np.tril_indices(n, -1)


def symmetric(entries: Sequence[float]) -> Array:
    """(3, 3) of [xx, yy, zz], or of [xx, yy, zz, xy, xz, yz]."""
    xx, yy, zz, xy, xz, yz = (*entries, 0.0, 0.0, 0.0)[:6]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Principal moments (3,) of an inertia (3, 3), ascending; their axes (3, 3), right-handed."""
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.linalg.det(axes)
    return moments, axes


def quaternion(rotation: Array) -> Array:
    """The quaternion (4,), scalar first, of a rotation matrix (3, 3)."""
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return np.array([w, x, y, z])
