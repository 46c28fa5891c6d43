"""Contacts of a plain plant: points, or the whole tool, on a surface: spring, damper and friction.

    f = n max(-(k d + b d'), 0) - friction,    d the distance of a sphere from the surface,

with Coulomb's friction, viscous below its limit, and with the mass that the simulator's constraints
add along what acts. A slip v adds mu c v to the normal force, c the rate at which friction settles
times that mass: on the simulator's elliptic cone normal and slip are one constraint. Each point
bears its share of what a contact has declared. Of a whole tool -d is the depth of a patch of it.
"""

from __future__ import annotations

from dataclasses import field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.world.moving_base import BaseMotion
from taskspec.program.world.stiffness import Compliance, added_mass, creep
from taskspec.robot.types import ToolGeometry
from taskspec.shapes import Surface
from taskspec.shapes.overlap import CYLINDER, LEAST_FRICTION, LEAST_ROLLING, ROLLING
from taskspec.shapes.solid import half_sizes, rounding

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
        turning: the greatest that it has about any direction [1/(kg m^2)].
    """

    p: ca.SX
    R: ca.SX
    twist: ca.SX
    J: ca.SX
    mobility: float = 0.0
    turning: float = 0.0

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

    @property
    def turning(self) -> float:
        """The greatest that it has about any direction [1/(kg m^2)]."""
        return 0.0 if self.body is None else self.body.turning

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

    def spin(self, mover: Mover) -> ca.SX:
        """(3,) angular velocity of a mover against it [rad/s]."""
        rate = mover.twist[3:]
        if self.body is not None:
            return rate - self.body.twist[3:]
        return rate if self.base is None else rate - self.base.twist(mover.p)[3:]

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
class Slip:
    """A slip that its friction may turn back within a step.

    Attributes:
        way: (r,) rate of its speed of what moves, and of what friction exerts.
        speed: at the step's beginning, times the coefficients [m/s].
        mass: with which friction of the step's end resists along it; 0 of one that sticks.
    """

    way: ca.SX
    speed: ca.SX
    mass: ca.SX

    def resists(self, rate: ca.SX) -> ca.SX:
        """(r, r) what it adds where a rate of what moves (r,), per step, would turn it back."""
        back = self.speed + ca.dot(self.way, rate) < 0
        return ca.if_else(back, self.mass, 0) * self.way @ self.way.T


@dataclass(frozen=True, slots=True)
class Resistance:
    """What resists some of the ways in which the plant's coordinates may move.

    Attributes:
        rows: (r, c) these ways of the coordinates' rates.
        force: (r,) with which it resists at the step's beginning [N, N m].
        mass: (r, r) that it adds.
        slips: in it.
    """

    rows: ca.SX
    force: ca.SX
    mass: ca.SX
    slips: tuple[Slip, ...] = ()

    def held_back(self, a: ca.SX, period: float) -> Resistance:
        """The same with the slips held back that coordinates' accelerations a (c,) turn back."""
        rate = period * self.rows @ a
        mass = sum((slip.resists(rate) for slip in self.slips), self.mass)
        return Resistance(self.rows, self.force, mass)

    def answer(self, a: ca.SX) -> ca.SX:
        """(r,) what it exerts while the coordinates accelerate with a (c,)."""
        return -(self.force + self.mass @ (self.rows @ a))


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact of something that moves with a surface.

    Attributes:
        mover: what touches.
        ground: that it touches.
        declared: of the whole contact.
        friction: Coulomb's coefficient.
        mobility: the sum of both bodies' inverse masses as MuJoCo counts them [1/kg].
        period: of the plant [s].
        ratio: how much stiffer friction is against a slip than the contact is damped.
    """

    mover: Mover
    ground: Ground
    declared: Compliance
    friction: float
    mobility: float
    period: float
    ratio: float


@dataclass(frozen=True, slots=True)
class PointContact(Contact):
    """A contact of spheres.

    Attributes:
        spheres: with which the mover touches.
    """

    spheres: Spheres

    def resistance(self) -> Resistance:
        """Of the mover's twist (6,) about its own point against the ground."""
        mover, spheres, ground, period = self.mover, self.spheres, self.ground, self.period
        declared, friction, mobility = self.declared, self.friction, self.mobility
        k, b = declared.stiffness / spheres.share, declared.damping / spheres.share
        m = added_mass(mobility)
        slip_force, slip_mass = creep(b, mobility, period, self.ratio)
        lift = slip_force / self.ratio
        turns = spheres.share * (mover.mobility + ground.mobility) * period
        point = ca.SX.sym("point", 3)
        surface = ground.surface
        at = ca.Function("at", [point], [surface.distance(point), surface.gradient(point)])
        whole, inertia, slips = ca.SX.zeros(6), ca.SX.zeros(6, 6), list[Slip]()
        for center, radius in zip(spheres.centers, spheres.radii, strict=True):
            lever = mover.R @ ca.DM(center)
            distance, normal = at(ground.place(mover.p + lever))
            normal = ground.turned(normal)
            gap = distance - float(radius)
            touched = lever - float(radius) * normal
            rate = ground.against(mover, mover.p + touched)
            closing = ca.dot(normal, rate)
            inside = gap < 0
            push = -(k * gap + b * closing)
            slip = rate - closing * normal
            size = ca.norm_2(slip) + _NO_SLIP
            sticks = ca.logic_and(slip_force * size < friction * push, inside)
            push += ca.if_else(sticks, 0, lift * friction * size)
            push = ca.if_else(inside, ca.fmax(push, 0), 0)
            force, along, across = push * normal, ca.if_else(push > 0, m, 0), ca.SX(0)
            way = slip / size
            if friction > 0:
                most = friction * push
                force -= ca.if_else(sticks, slip_force * size, most) * way
                # Friction that would turn a slip back within the step is of the step's end: at
                # once across the slip, along it where it does turn it back.
                late = ca.if_else(size < turns * most, period * most / size, 0)
                across = ca.if_else(sticks, slip_mass, late)
                turned_back = ca.vertcat(way, ca.cross(touched, way))
                slips.append(Slip(turned_back, size, ca.if_else(sticks, 0, late)))
            mass = (along - across) * normal @ normal.T + across * ca.SX.eye(3)
            if friction > 0:
                mass -= slips[-1].mass * way @ way.T
            # About the mover's own point, for all of its spheres.
            S = ca.skew(touched)
            turned = S @ mass
            inertia += ca.blockcat([[mass, turned.T], [turned, -turned @ S]])
            whole += ca.vertcat(force, ca.cross(touched, force))
        return Resistance(ground.rows(mover), -whole, inertia, tuple(slips))


@dataclass(frozen=True, slots=True)
class Patch:
    """Where a tool touches with its whole surface.

    Attributes:
        normal: (3,) outward, in the ground's coordinates.
        point: (3,) from the tool's own point, in its axes [m].
        depth: [m].
        spin: lever of the friction that resists being turned about the normal [m].
        share: of what the contact has declared.
    """

    normal: ca.SX
    point: ca.SX
    depth: ca.SX
    spin: ca.SX
    share: ca.SX = field(default_factory=lambda: ca.SX(1))


def plane_patch(geometry: ToolGeometry, mover: Mover, ground: Ground) -> Patch:
    """Of a tool on a plane, in closed form."""
    sizes = half_sizes(geometry.solid)
    assert sizes is not None
    kind, half = sizes
    eps = rounding(half)
    normal = ground.surface.gradient(ground.place(mover.p))
    u = -mover.R.T @ ground.turned(normal)
    reach, levers = ca.SX(0), []
    point = [ca.SX(0)] * 3
    groups: list[tuple[int, ...]] = [(0, 1), (2,)] if kind == CYLINDER else [(0,), (1,), (2,)]
    for group in groups:
        h = half[group[0]]
        edge = eps / h
        size = ca.sqrt(sum((u[i] ** 2 for i in group), ca.SX(edge**2)))
        reach += h * size - eps
        levers.append(h * edge / size)
        for i in group:
            point[i] = h * u[i] / size
    middle = ca.DM([0.0, 0.0, geometry.middle])
    depth = reach + eps - ground.surface.distance(ground.place(mover.p + mover.R @ middle))
    if kind == CYLINDER:
        spin = 2 / 3 * levers[0] + 0.5 * levers[1]
    else:
        spin = 0.5 * ca.sqrt(sum((lever**2 for lever in levers), ca.SX(0)))
    return Patch(normal, ca.vertcat(*point) + middle, depth, spin)


@dataclass(frozen=True, slots=True)
class WholeToolContact(Contact):
    """A contact of a whole tool: one resultant of a patch.

    Friction is Coulomb's of all that slips at once: along the surface, turning about its normal
    and, by a little, rocking: with the coefficients mu_j of each rate v_j

        f_j = -f mu_j^2 v_j / S,    S^2 = sum (mu_j v_j)^2.

    Attributes:
        patch: where the mover touches.
    """

    patch: Patch

    def resistance(self) -> Resistance:
        """Of the mover's twist (6,) about its own point against the ground."""
        mover, ground, patch = self.mover, self.ground, self.patch
        m = patch.share * added_mass(self.mobility)
        k, b = patch.share * self.declared.stiffness, patch.share * self.declared.damping
        slips = creep(self.declared.damping, self.mobility, self.period, self.ratio)
        slip_force, slip_mass = (patch.share * each for each in slips)
        lift = slip_force / self.ratio
        n, lever = ground.turned(patch.normal), mover.R @ patch.point
        rate, spin = ground.against(mover, mover.p + lever), ground.spin(mover)
        closing, about = ca.dot(n, rate), ca.dot(n, spin)
        inside = patch.depth > 0
        push = k * patch.depth - b * closing
        slip, rock = rate - closing * n, spin - about * n
        least = max(self.friction, LEAST_FRICTION)
        slide = self.friction**2
        twirl = (self.friction * patch.spin) ** 2
        roll = (ROLLING * max(self.friction, LEAST_ROLLING) * patch.spin) ** 2
        S = ca.sqrt(
            slide * ca.sumsqr(slip) + twirl * about**2 + roll * ca.sumsqr(rock) + _NO_SLIP**2
        )
        sticks = ca.logic_and(slip_force / least**2 * S < push, inside)
        push = ca.if_else(inside, ca.fmax(push + ca.if_else(sticks, 0, lift * S), 0), 0)
        share = ca.if_else(sticks, slip_force / least**2, push / S)
        force = push * n - share * slide * slip
        moment = -share * (twirl * about * n + roll * rock)
        # Friction that would turn a slip back within the step is of the step's end: at once across
        # the slip, along it where it does turn it back.
        most = slide * (mover.mobility + ground.mobility)
        most += (twirl + roll) * (mover.turning + ground.turning)
        late = ca.if_else(self.period * push * most > S, self.period * push / S, 0)
        across = ca.if_else(sticks, slip_mass / least**2, late)
        along = ca.if_else(push > 0, m, 0)
        N = n @ n.T
        mass = along * N + across * slide * (ca.SX.eye(3) - N)
        turning = across * (twirl * N + roll * (ca.SX.eye(3) - N))
        L = ca.skew(lever)
        turned = L @ mass
        inertia = ca.blockcat([[mass, turned.T], [turned, turning - turned @ L]])
        whole = ca.vertcat(force, ca.cross(lever, force) + moment)
        moves, turns = slide * slip / S, (twirl * about * n + roll * rock) / S
        way = ca.vertcat(moves, ca.cross(lever, moves) + turns)
        back = Slip(way, S, ca.if_else(sticks, 0, late))
        inertia -= back.mass * way @ way.T
        return Resistance(ground.rows(mover), -whole, inertia, (back,))
