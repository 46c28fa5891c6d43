"""Rotations on SO(3) as CasADi expressions and, for the places that run once, as NumPy arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

# Keeps angle/|w| finite and differentiable at the identity; its square root is the angle (rad)
# below which a rotation counts as none.
_SQUARED_ANGLE_FLOOR = 1e-24


def exp(w: ca.SX) -> ca.SX:
    """Rotation matrix (3, 3) of the rotation vector w (3,) [rad], by Rodrigues' formula."""
    angle = ca.sqrt(ca.dot(w, w) + _SQUARED_ANGLE_FLOOR)
    W = ca.skew(w)
    half = ca.sin(angle / 2) / (angle / 2)
    return ca.SX.eye(3) + ca.sin(angle) / angle * W + half**2 / 2 * (W @ W)


def log(R: ca.SX) -> ca.SX:
    """Rotation vector (3,) [rad] of the rotation matrix R (3, 3); exact for angles below pi."""
    w = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    sine = ca.sqrt(ca.dot(w, w) + _SQUARED_ANGLE_FLOOR)
    cosine = (R[0, 0] + R[1, 1] + R[2, 2] - 1) / 2
    return w * (ca.atan2(sine, cosine) / sine)


def unskew(W: ca.SX) -> ca.SX:
    """The vector w (3,) of a skew-symmetric W (3, 3)."""
    return ca.vertcat(W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]) / 2


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """a x b of vectors (3,): the bits of `np.cross`, at a tenth of its time."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def quaternion(w: NDArray[np.float64]) -> NDArray[np.float64]:
    """The unit quaternion (4,), scalar first, of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(w))
    return np.array([math.cos(angle / 2), *(0.5 * np.sinc(angle / (2 * math.pi)) * w)])


def turned(
    one: NDArray[np.float64], other: NDArray[np.float64], *, back: bool = False
) -> NDArray[np.float64]:
    """The product (4,) of two unit quaternions, the first one inverted where `back` is true."""
    s, v = one[0], -one[1:] if back else one[1:]
    return np.array(
        [s * other[0] - v @ other[1:], *(s * other[1:] + other[0] * v + cross(v, other[1:]))]
    )


def vector_of(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """The shortest rotation vector (3,) [rad] of a unit quaternion (4,)."""
    s, v = (q[0], q[1:]) if q[0] >= 0 else (-q[0], -q[1:])
    sine = float(np.linalg.norm(v))
    # Below the square root of the smallest number the ratio is 2.
    found: NDArray[np.float64] = v * (2 * math.atan2(sine, s) / sine if sine > 1e-150 else 2.0)
    return found


def to_rpy(R: NDArray[np.float64]) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] about fixed axes of a rotation matrix (3, 3).

    Where the pitch is 90 deg, which leaves roll and yaw to each other, the roll is 0.
    """
    across = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], across)
    if across < 1e-12:
        return 0.0, pitch, math.atan2(-R[0, 1], R[1, 1])
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def from_rpy(rpy: Sequence[float]) -> NDArray[np.float64]:
    """R = Rz(yaw) Ry(pitch) Rx(roll) (3, 3) of roll, pitch, yaw [rad] about fixed axes."""
    (cr, cp, cy), (sr, sp, sy) = ([f(a) for a in rpy] for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
