"""Contacts of a plain plant: points of what moves on a surface, with spring, damper and friction.

    f = n max(-(k d + b d'), 0) - friction,    d the distance of a sphere from the surface,

with Coulomb's friction, viscous below its limit, and with the mass that the simulator's constraints
add along what acts. Each point bears its share of what a contact has declared.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.world.moving_base import BaseMotion
from taskspec.program.world.stiffness import Compliance, added_mass, creep
from taskspec.shapes import Surface

Vector = NDArray[np.float64]

#: A slip that is no slip [m/s].
_NO_SLIP = 1e-12


@dataclass(frozen=True, slots=True)
class Mover:
    """What moves with coordinates of the plant: the tool, or a loose body.

    Attributes:
        p, R: (3,) [m], (3, 3) its pose in the world.
        twist: (6,) of that point, world axes [m/s, rad/s].
        J: (6, c) that twist of the coordinates' rates.
        mobility: the greatest that a point of it has along any direction [1/kg].
    """

    p: ca.SX
    R: ca.SX
    twist: ca.SX
    J: ca.SX
    mobility: float = 0.0

    def place(self, point: ca.SX) -> ca.SX:
        """A world point (3,) in its own axes [m]."""
        return self.R.T @ (point - self.p)

    def velocity(self, point: ca.SX) -> ca.SX:
        """(3,) of what it has at a world point (3,) [m/s]."""
        return self.twist[:3] + ca.cross(self.twist[3:], point - self.p)

    def rows(self, point: ca.SX) -> ca.SX:
        """(6, c) its twist at a world point (3,) of the coordinates' rates."""
        linear = self.J[:3, :] - ca.skew(point - self.p) @ self.J[3:, :]
        return ca.vertcat(linear, self.J[3:, :])


@dataclass(frozen=True, slots=True)
class Ground:
    """A surface that points touch, and what carries it.

    Attributes:
        surface: where it stands still; of a loose body in that body's own axes.
        base: the motion of an object that moves by itself.
        body: the loose body that it is of.
    """

    surface: Surface
    base: BaseMotion | None = None
    body: Mover | None = None

    @property
    def mobility(self) -> float:
        """The greatest that a point of it has along any direction [1/kg]."""
        return 0.0 if self.body is None else self.body.mobility

    def place(self, point: ca.SX) -> ca.SX:
        """A world point (3,) in the surface's coordinates [m]."""
        if self.body is not None:
            return self.body.place(point)
        return point if self.base is None else self.base.place(point)

    def turned(self, direction: ca.SX) -> ca.SX:
        """A direction (3,) of the surface's coordinates in the world."""
        if self.body is not None:
            return self.body.R @ direction
        return direction if self.base is None else self.base.A @ direction

    def against(self, mover: Mover, point: ca.SX) -> ca.SX:
        """(3,) velocity of a mover's point against it [m/s]."""
        rate = mover.velocity(point)
        if self.body is not None:
            return rate - self.body.velocity(point)
        return rate if self.base is None else rate - self.base.twist(point)[:3]

    def rows(self, mover: Mover) -> ca.SX:
        """(6, c) twist of a mover against it, at the mover's own point, of the rates."""
        return mover.J if self.body is None else mover.J - self.body.rows(mover.p)


@dataclass(frozen=True, slots=True)
class Spheres:
    """Points with which something touches.

    Attributes:
        centers: (k, 3) in its own axes [m].
        radii: (k,) [m].
        share: on how many of them it rests.
    """

    centers: Vector
    radii: Vector
    share: int


@dataclass(frozen=True, slots=True)
class Resistance:
    """What resists some of the ways in which the plant's coordinates may move.

    Attributes:
        rows: (r, c) these ways of the coordinates' rates.
        force: (r,) with which it resists at the step's beginning [N, N m].
        mass: (r, r) that it adds.
    """

    rows: ca.SX
    force: ca.SX
    mass: ca.SX

    def answer(self, a: ca.SX) -> ca.SX:
        """(r,) what it exerts while the coordinates accelerate with a (c,)."""
        return -(self.force + self.mass @ (self.rows @ a))


@dataclass(frozen=True, slots=True)
class PointContact:
    """A contact of spheres with a surface.

    Attributes:
        mover: what touches with `spheres`.
        spheres: of it.
        ground: that they touch.
        declared: of the whole contact.
        friction: Coulomb's coefficient.
        mobility: the sum of both bodies' inverse masses as MuJoCo counts them [1/kg].
        period: of the plant [s].
    """

    mover: Mover
    spheres: Spheres
    ground: Ground
    declared: Compliance
    friction: float
    mobility: float
    period: float

    def resistance(self) -> Resistance:
        """Of the mover's twist (6,) about its own point against the ground."""
        mover, spheres, ground, period = self.mover, self.spheres, self.ground, self.period
        declared, friction, mobility = self.declared, self.friction, self.mobility
        k, b = declared.stiffness / spheres.share, declared.damping / spheres.share
        m = added_mass(mobility)
        slip_force, slip_mass = creep(b, mobility, period)
        turns = spheres.share * (mover.mobility + ground.mobility) * period
        point = ca.SX.sym("point", 3)
        surface = ground.surface
        at = ca.Function("at", [point], [surface.distance(point), surface.gradient(point)])
        whole, inertia = ca.SX.zeros(6), ca.SX.zeros(6, 6)
        for center, radius in zip(spheres.centers, spheres.radii, strict=True):
            lever = mover.R @ ca.DM(center)
            distance, normal = at(ground.place(mover.p + lever))
            normal = ground.turned(normal)
            gap = distance - float(radius)
            touched = lever - float(radius) * normal
            rate = ground.against(mover, mover.p + touched)
            closing = ca.dot(normal, rate)
            inside = gap < 0
            push = ca.if_else(inside, ca.fmax(-(k * gap + b * closing), 0), 0)
            force, along, across = push * normal, ca.if_else(push > 0, m, 0), ca.SX(0)
            if friction > 0:
                slip = rate - closing * normal
                size = ca.norm_2(slip) + _NO_SLIP
                most = friction * push
                sticks = ca.logic_and(slip_force * size < most, inside)
                force -= ca.if_else(sticks, slip_force, most / size) * slip
                # Friction that would turn a slip back within the step is of the step's end.
                late = ca.if_else(size < turns * most, period * most / size, 0)
                across = ca.if_else(sticks, slip_mass, late)
            mass = (along - across) * normal @ normal.T + across * ca.SX.eye(3)
            # About the mover's own point, for all of its spheres.
            S = ca.skew(touched)
            turned = S @ mass
            inertia += ca.blockcat([[mass, turned.T], [turned, -turned @ S]])
            whole += ca.vertcat(force, ca.cross(touched, force))
        return Resistance(ground.rows(mover), -whole, inertia)
