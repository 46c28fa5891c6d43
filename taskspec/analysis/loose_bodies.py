"""Loose bodies of a plain plant: six coordinates each, with the points with which they touch."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.analysis.point_contacts import Ground, Mover, Spheres
from taskspec.deferred_methods import dataclass
from taskspec.program.world import frames
from taskspec.robot.rebuild import GRAVITY
from taskspec.shapes import SHAPES, BoundedSurface
from taskspec.spec import Shape, Task

Vector = NDArray[np.float64]

#: Numbers of a body's state: position, quaternion w x y z, twist; and of its pose, the first ones.
_STATE, POSE = 13, 7


@dataclass(frozen=True, slots=True)
class LooseBody:
    """A loose body of a task.

    Attributes:
        name: of it.
        shape: as the file has it.
        solid: about its own origin.
        number: of the body among all.
        first: of its coordinates among those of the plant.
    """

    name: str
    shape: Shape
    solid: BoundedSurface
    number: int
    first: int

    @property
    def entries(self) -> slice:
        """Where its state is among those of all bodies."""
        return slice(_STATE * self.number, _STATE * (self.number + 1))

    @property
    def pose(self) -> slice:
        """Where its pose is among those of all bodies."""
        return slice(POSE * self.number, POSE * (self.number + 1))

    @property
    def rows(self) -> slice:
        """Where its coordinates are."""
        return slice(self.first, self.first + 6)

    @property
    def spheres(self) -> Spheres:
        """With which it touches other shapes."""
        centers, radius = self.solid.contact_points()
        return Spheres(centers, np.full(len(centers), radius), self.solid.resting_points)

    @property
    def mass(self) -> float:
        """[kg]."""
        assert self.shape.mass is not None
        return self.shape.mass

    @property
    def mobility(self) -> float:
        """The greatest that a point of it has along any direction [1/kg]."""
        centers, radius = self.solid.contact_points()
        lever = float(np.linalg.norm(centers, axis=1).max()) + radius
        return 1 / self.mass + lever**2 / min(self.solid.inertia(self.mass))

    def at_start(self) -> Vector:
        """(13,) its state as it lies."""
        R, origin = frames.pose(self.shape)
        x, y, z, w = pin.Quaternion(R).coeffs()
        return np.array([*origin, w, x, y, z, *np.zeros(6)])

    def mover(self, state: ca.SX, c: int) -> Mover:
        """What its state (13,) says, of c coordinates."""
        J = ca.SX(6, c)
        J[:, self.rows] = ca.DM.eye(6)
        p, R, twist = state[:3], _rotation(state[3:POSE]), state[POSE:]
        return Mover(p, R, twist, J, self.mobility)

    def ground(self, pose: ca.SX) -> Ground:
        """Its surface where it is at a pose (7,)."""
        rest = ca.SX.zeros(6)
        return Ground(self.solid, body=Mover(pose[:3], _rotation(pose[3:]), rest, ca.SX(6, 0)))

    def weigh(self, H: ca.SX, on: ca.SX, mover: Mover) -> None:
        """Adds its inertia to H (c, c), and weight and turning to generalised forces (c,)."""
        mass = self.mass
        inertia = mover.R @ ca.diag(ca.DM(self.solid.inertia(mass))) @ mover.R.T
        linear = slice(self.first, self.first + 3)
        angular = slice(self.first + 3, self.first + 6)
        H[linear, linear], H[angular, angular] = mass * ca.DM.eye(3), inertia
        w = mover.twist[3:]
        on[linear], on[angular] = mass * ca.DM(GRAVITY), -ca.cross(w, inertia @ w)

    def moved(self, state: ca.SX, a: ca.SX, h: float) -> ca.SX:
        """Its state (13,) a step of h [s] later, with acceleration a (6,)."""
        twist = state[POSE:] + h * a
        w, q = twist[3:], state[3:POSE]
        turning = ca.vertcat(-ca.dot(w, q[1:]), q[0] * w + ca.cross(w, q[1:]))
        turned = q + 0.5 * h * turning
        return ca.vertcat(state[:3] + h * twist[:3], turned / ca.norm_2(turned), twist)


def loose_bodies(task: Task, first: int = 0) -> dict[str, LooseBody]:
    """The loose bodies of a task, whose coordinates follow on `first` others."""
    found: dict[str, LooseBody] = {}
    for name, shape in task.shapes.items():
        if shape.free:
            solid = SHAPES[shape.shape](np.zeros(3), np.eye(3), **shape.sizes)
            assert isinstance(solid, BoundedSurface)
            number = len(found)
            found[name] = LooseBody(name, shape, solid, number, first + 6 * number)
    return found


def poses(states: Vector) -> Vector:
    """(k, 7 bodies) of states (k, 13 bodies)."""
    k = len(states)
    return states.reshape(k, -1, _STATE)[:, :, :POSE].reshape(k, -1)


def _rotation(q: ca.SX) -> ca.SX:
    """(3, 3) of a quaternion w x y z."""
    K = ca.skew(q[1:])
    return ca.SX.eye(3) + 2 * q[0] * K + 2 * (K @ K)
