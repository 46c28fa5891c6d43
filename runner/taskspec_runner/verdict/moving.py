"""Where objects that move were at every tick of a run, and coordinates along a handle's circle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.program.world.mechanisms import MechanismModel
from taskspec.program.world.moving_base import MovingBase

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Ride:
    """A moving base at n ticks: declared places x are at A x + a.

    Attributes:
        A, a: (n, 3, 3), (n, 3) [m]. A_rate, a_rate: their time derivatives.
    """

    A: Vector
    a: Vector
    A_rate: Vector
    a_rate: Vector

    def place(self, p: Vector) -> Vector:
        """World points (n, 3) in the moving base's coordinates."""
        return np.asarray(np.einsum("kji,kj->ki", self.A, p - self.a))

    def world(self, p: Vector) -> Vector:
        """Points (n, 3) of the moving base's coordinates in the world."""
        return np.asarray(np.einsum("kij,kj->ki", self.A, p) + self.a)

    def twist(self, p: Vector) -> Vector:
        """(n, 6) velocity of the moving base at world points (n, 3) [m/s, rad/s]."""
        spin = np.einsum("kij,klj->kil", self.A_rate, self.A)
        turning = np.column_stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])
        linear = self.a_rate + np.einsum("kij,kj->ki", spin, p - self.a)
        return np.concatenate([linear, turning], axis=1)


def ride(base: MovingBase | None, clock: Vector) -> Ride:
    """The moving base at the ticks `clock` (n,) [s]; for none, at rest."""
    n = len(clock)
    if base is None:
        still = np.zeros((n, 3))
        return Ride(np.broadcast_to(np.eye(3), (n, 3, 3)), still, np.zeros((n, 3, 3)), still)
    A, a, A_rate, a_rate, *_ = (np.array(v).T for v in base.numbers.map(n)(clock))

    def matrices(columns: Vector) -> Vector:
        return columns.reshape(n, 3, 3).transpose(0, 2, 1)

    return Ride(matrices(A), a, matrices(A_rate), a_rate)


def handle_axes(mechanism: MechanismModel, p: Vector) -> Vector:
    """(n, 3, 3) axes of a swinging handle at world points (n, 3): radial, tangential, the axis."""
    x = (p - mechanism.origin) @ mechanism.rotation
    about = np.arctan2(x[:, 1], x[:, 0])
    c, s, zero, one = np.cos(about), np.sin(about), np.zeros(len(p)), np.ones(len(p))
    turned = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    return np.asarray(mechanism.rotation @ turned)


def handle_coordinates(mechanism: MechanismModel, p: Vector) -> Vector:
    """(n, 3) off the handle's circle, along it and along the axis, as `deviation` has them [m].

    The way along the circle counts whole turns from the angle 0 of the mechanism.
    """
    x = (p - mechanism.origin) @ mechanism.rotation
    rest = np.arctan2(mechanism.handle[1], mechanism.handle[0])
    about = np.arctan2(x[:, 1], x[:, 0]) - rest
    angle = np.unwrap(about) + (np.angle(np.exp(1j * about[0])) - about[0] if len(p) else 0.0)
    return np.column_stack(
        [
            np.hypot(x[:, 0], x[:, 1]) - mechanism.radius,
            mechanism.radius * angle,
            x[:, 2] - mechanism.handle[2] - mechanism.lead * angle,
        ]
    )
