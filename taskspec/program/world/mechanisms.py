"""Nominal geometry of the world's mechanisms: coordinate, handle frame and generalised force.

A mechanism has one coordinate s, 0 as declared: an angle about z of its own axes, or for a slide a
travel along it. Its handle is where s takes the declared point. A robot that holds the handle knows
s from its own joints: from where the tip is, or, on the axis, from how the tool has turned.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation
from taskspec.geometry.rotation import cross
from taskspec.spec import Mechanism, Task

Matrix = NDArray[np.float64]

#: A handle nearer to the axis than this is on it [m].
ON_AXIS = 1e-3
#: Nearer to the axis than this part of its circle's radius, a handle frame has no axes.
_CORE = 0.1


@dataclass(frozen=True, slots=True)
class MechanismModel:
    """A mechanism as the controller has it.

    Attributes:
        name: of the object.
        kind: hinge, slide or screw.
        rotation, origin: (3, 3), (3,) its own axes in the world at coordinate 0.
        handle: (3,) the handle in them at coordinate 0 [m].
        lead: travel along z per angle about it [m/rad].
        angular: its coordinate is an angle.
        free: the knob turns on the handle.
    """

    name: str
    kind: str
    rotation: Matrix
    origin: Matrix
    handle: Matrix
    lead: float
    angular: bool
    free: bool

    @property
    def radius(self) -> float:
        """Of the handle's circle [m]."""
        return float(np.hypot(self.handle[0], self.handle[1]))

    @property
    def swings(self) -> bool:
        """Whether the handle goes around the axis, so that its frame turns."""
        return self.angular and self.radius > ON_AXIS

    @property
    def grip(self) -> Matrix:
        """(3,) the handle in the world at coordinate 0 [m]."""
        return np.asarray(self.origin + self.rotation @ self.handle)

    def moved(self, coordinate: float) -> MechanismModel:
        """The mechanism with its handle where a coordinate [rad, m] takes it."""
        axis = self.rotation[:, 2]
        if not self.angular:
            return replace(self, origin=self.origin + coordinate * axis)
        c, s = np.cos(coordinate), np.sin(coordinate)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        origin = self.origin + self.lead * coordinate * axis
        return replace(self, rotation=self.rotation @ turn, origin=origin)

    def taken_back(self, coordinate: ca.SX, p: ca.SX, R: ca.SX) -> tuple[ca.SX, ca.SX]:
        """A world pose (3,), (3, 3) as what the mechanism carries sees it, taken back to 0.

        Args:
            coordinate: where the mechanism is [rad, m].
            p, R: the pose.
        """
        axis = ca.DM(self.rotation[:, 2])
        if not self.angular:
            return p - coordinate * axis, R
        turn = rotation.exp(-coordinate * axis)
        origin = ca.DM(self.origin)
        return origin + turn @ (p - origin - self.lead * coordinate * axis), turn @ R

    def local(self, p: ca.SX) -> ca.SX:
        """A world point (3,) in the mechanism's own axes [m]."""
        return ca.DM(self.rotation.T) @ (p - ca.DM(self.origin))

    def angle(self, p: ca.SX, turned: ca.SX, before: ca.SX) -> ca.SX:
        """Angle [rad] within half a turn of the one `before`, so that whole turns are counted.

        Args:
            p: (3,) tip in the world.
            turned: (3, 3) rotation of the tool since the run began,
                world axes.
            before: the angle of the last tick.
        """
        c, s = ca.cos(before), ca.sin(before)
        if self.swings:
            x = self.local(p)
            at = np.arctan2(self.handle[1], self.handle[0])
            c, s = ca.cos(before + at), ca.sin(before + at)
            return before + ca.atan2(c * x[1] - s * x[0], c * x[0] + s * x[1])
        # The part about z of the rotation: what is left of it turns about a direction across z.
        D = ca.DM(self.rotation.T) @ turned @ ca.DM(self.rotation)
        sine, cosine = D[1, 0] - D[0, 1], D[0, 0] + D[1, 1]
        return before + ca.atan2(c * sine - s * cosine, c * cosine + s * sine)

    def travel(self, p: ca.SX) -> ca.SX:
        """Travel of the handle along the axis [m] with the tip at p (3,)."""
        return self.local(p)[2] - float(self.handle[2])

    def effort(self, p: ca.SX, force: ca.SX, moment: ca.SX) -> ca.SX:
        """Generalised force on the coordinate [N m, N] by virtual work.

        Args:
            p: (3,) point to which `force` (3,) and `moment` (3,) on the handle belong; world axes.
        """
        axis = ca.DM(self.rotation[:, 2])
        if not self.angular:
            return ca.dot(axis, force)
        about = ca.dot(axis, moment + ca.cross(p - ca.DM(self.origin), force))
        return about + self.lead * ca.dot(axis, force)

    def open_ways(self, point: Matrix) -> tuple[Matrix, Matrix]:
        """Unit directions (3,) in which it yields to a force at a point (3,), and to a moment.

        Zero where there is none. A force on the axis turns nothing, nor does a moment on a handle
        off the axis: its turning goes with a distance along the circle.
        """
        axis, none = self.rotation[:, 2], np.zeros(3)
        turn = axis if self.free else none
        if not self.angular:
            return axis, turn
        across = cross(axis, point - self.origin)
        size = float(np.linalg.norm(across))
        if size > ON_AXIS:
            return across / size, turn
        return none, axis

    def free_twists(self, tip: Matrix, point: Matrix) -> Matrix:
        """(6, k) twists of a point (3,) of the tool that it leaves free, world axes.

        The first belongs to its coordinate, a second to a free knob about the handle at `tip` (3,).
        """
        axis = self.rotation[:, 2]
        columns = [np.concatenate([axis, np.zeros(3)])]
        if self.angular:
            moves = cross(axis, point - self.origin) + self.lead * axis
            columns = [np.concatenate([moves, axis])]
        if self.free:
            columns.append(np.concatenate([cross(axis, point - tip), axis]))
        return np.column_stack(columns)

    def twists(self, tip: ca.SX, point: ca.SX) -> ca.SX:
        """The same (6, k) of expressions."""
        axis = ca.DM(self.rotation[:, 2])
        if self.angular:
            columns = [ca.vertcat(ca.cross(axis, point - self.origin) + self.lead * axis, axis)]
        else:
            columns = [ca.vertcat(axis, ca.DM.zeros(3))]
        if self.free:
            columns.append(ca.vertcat(ca.cross(axis, point - tip), axis))
        return ca.horzcat(*columns)

    def handle_axes(self, p: ca.SX) -> ca.SX:
        """(3, 3) axes of a swinging handle at p (3,), world: radial, tangential, the axis."""
        x = self.local(p)
        rho = ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1e-30)
        radial = ca.vertcat(x[0], x[1], 0) / rho
        tangential = ca.vertcat(-x[1], x[0], 0) / rho
        return ca.DM(self.rotation) @ ca.horzcat(radial, tangential, ca.vertcat(0, 0, 1))

    def distance(self, p: ca.SX) -> ca.SX:
        """Distance rho [m] of a world point (3,) from the axis."""
        x = self.local(p)
        return ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1e-30)

    def turning(self, p: ca.SX, velocity: ca.SX) -> ca.SX:
        """Rate of the angle [rad/s] as a point p (3,) moves at a velocity (3,), world."""
        x, v = self.local(p), ca.DM(self.rotation.T) @ velocity
        return (x[0] * v[1] - x[1] * v[0]) / (x[0] ** 2 + x[1] ** 2 + 1e-30)

    def margin(self, p: ca.SX) -> ca.SX:
        """Positive while the handle frame has axes at p (3,): away from the mechanism's axis."""
        return self.distance(p) - _CORE * self.radius

    def deviation(self, p: ca.SX, angle: ca.SX, since: ca.SX) -> ca.SX:
        """Handle coordinates (3,) [m] of a point p (3,), world.

        (rho - r, r (angle - since), z - h_z - lead angle): off the circle, along it, along the
        axis off the thread.
        """
        x = self.local(p)
        return ca.vertcat(
            self.distance(p) - self.radius,
            self.radius * (angle - since),
            x[2] - float(self.handle[2]) - self.lead * angle,
        )

    def rate_map(self, p: ca.SX) -> ca.SX:
        """(3, 3) rates of the handle coordinates per velocity along the handle's axes."""
        rho = self.distance(p)
        return ca.vertcat(
            ca.horzcat(1, 0, 0),
            ca.horzcat(0, self.radius / rho, 0),
            ca.horzcat(0, -self.lead / rho, 1),
        )

    def velocity_map(self, p: ca.SX) -> ca.SX:
        """(3, 3) the inverse of `rate_map`."""
        r = self.radius
        return ca.vertcat(
            ca.horzcat(1, 0, 0),
            ca.horzcat(0, self.distance(p) / r, 0),
            ca.horzcat(0, self.lead / r, 1),
        )


def mechanism_models(task: Task) -> dict[str, MechanismModel]:
    """All mechanisms of a task, by name."""
    return {name: _model(name, declared) for name, declared in task.mechanisms.items()}


def _model(name: str, declared: Mechanism) -> MechanismModel:
    return MechanismModel(
        name=name,
        kind=declared.kind,
        rotation=rotation.from_rpy(declared.rpy),
        origin=np.array(declared.xyz, dtype=float),
        handle=np.array(declared.handle, dtype=float),
        lead=declared.lead,
        angular=declared.angular,
        free=declared.knob == "free",
    )
