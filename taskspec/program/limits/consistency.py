"""The nearest forces to those of a stage that its contacts can return.

A contact returns what it is made of: pushes along its normal, and along its surface no more than
friction holds. On every point where the tool touches there is one such generator of force, on a
grip and on an equation that holds in both directions one of either sign. The requested forces are
replaced by the nearest sum of generators that the caps and the motors allow; what is left over is
reported.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.control.state import ARM_LENGTH
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.limits.contacts import ContactRow
from taskspec.program.reference.infeasible_forces import is_moment
from taskspec.spec import Limits

#: Share of the limit on force that a set point may take; the rest is for transients.
SET_POINT_SHARE = 0.95
#: Share of the motors' torque that static forces may take; the rest is for motion.
STATIC_SHARE = 0.9
#: Share of its friction that a contact has to hold: at the edge of the cone it creeps.
FRICTION_SHARE = 0.9
#: A sum of generators that differs from the request by this share of it counts as equal.
EQUAL = 1e-6
_CAP = "the limit on force"
#: Weight of a generator's own size, so that equal sums differ.
_GENERATOR_WEIGHT = 1e-8


@dataclass(frozen=True, slots=True)
class Generator:
    """A force of unit size on the tool or the joints.

    Attributes:
        effect: (r,) what it contributes to each requested force.
        torque: (n,) that it takes.
        friction: of the contact; for a normal, with its two tangents following.
        kind: `normal`, `tangent`, `free`, or `moment`, which no limit on force caps.
        of: the object, the equation or the grip.
    """

    effect: ca.SX
    torque: ca.SX
    friction: float
    kind: str
    of: str


@dataclass(frozen=True, slots=True)
class Requests:
    """The forces that a stage requests.

    Attributes:
        names: (r,) of axes and equations.
        rows: (r, n) velocity along each per joint velocity.
        values: (r,) as the robot would apply them.
    """

    names: tuple[str, ...]
    rows: ca.SX
    values: ca.SX


@dataclass(frozen=True, slots=True)
class Consistency:
    """The nearest forces as a program on the generators' sizes s, and whether it is needed.

        min |W (E s - f)|^2 + small |s|^2    lower <= A s <= upper

    Attributes:
        needed: 1 where a plain least-squares s does not already do.
        P: (g, g).
        g: (g,).
        A: (m, g).
        lower, upper: (m,).
        effect: (r, g) E.
        texts: what each of the m conditions is.
    """

    needed: ca.SX
    P: ca.SX
    g: ca.SX
    A: ca.SX
    lower: ca.SX
    upper: ca.SX
    effect: ca.SX
    texts: tuple[str, ...]


def consistency(
    context: Context,
    limits: Limits,
    requests: Requests,
    generators: Sequence[Generator],
    gravity: ca.SX,
) -> Consistency | None:
    """The program of a stage; None where it requests nothing, or nothing is known to return it."""
    if not requests.names or not generators:
        return None
    conditions = _Conditions(len(generators))
    conditions.add_contacts(generators)
    if limits.force is not None:
        conditions.add_caps(generators, SET_POINT_SHARE * limits.force)
    conditions.add_torques(generators, STATIC_SHARE * context.robot.torque_limit, gravity)
    return _program(requests, ca.horzcat(*(made.effect for made in generators)), conditions)


class _Conditions:
    """lower <= A s <= upper on the sizes s of generators, row by row."""

    def __init__(self, count: int) -> None:
        self._eye = ca.SX.eye(count)
        self.rows: list[ca.SX] = []
        self.lower: list[ca.SX] = []
        self.upper: list[ca.SX] = []
        self.texts: list[str] = []

    def add(self, text: str, row: ca.SX, lower: ca.SX, upper: ca.SX) -> None:
        self.texts.append(text)
        self.rows.append(row)
        self.lower.append(lower)
        self.upper.append(upper)

    def add_contacts(self, generators: Sequence[Generator]) -> None:
        """A contact pushes, and friction holds what lies in the pyramid about its normal."""
        for i, made in enumerate(generators):
            if made.kind != "normal":
                continue
            push = self._eye[i, :]
            self.add(f"{made.of} only pushes back", push, ca.SX(0), ca.SX(ca.inf))
            if made.friction > 0:
                along, across = self._eye[i + 1, :], self._eye[i + 2, :]
                for face in (along + across, along - across, across - along, -along - across):
                    row = made.friction * push + face
                    self.add(f"friction of {made.of}", row, ca.SX(0), ca.SX(ca.inf))

    def add_caps(self, generators: Sequence[Generator], cap: float) -> None:
        """All pushes with their friction, and each force of either sign, stay below the cap [N]."""
        pushes = [i for i, made in enumerate(generators) if made.kind == "normal"]
        if pushes:
            sizes = [np.hypot(1, generators[i].friction / FRICTION_SHARE) for i in pushes]
            total = ca.DM(sizes).T @ self._eye[pushes, :]
            self.add(_CAP, total, ca.SX(-ca.inf), ca.SX(cap))
        for i, made in enumerate(generators):
            if made.kind == "free":
                self.add(_CAP, self._eye[i, :], ca.SX(-cap), ca.SX(cap))

    def add_torques(
        self, generators: Sequence[Generator], most: NDArray[np.float64], gravity: ca.SX
    ) -> None:
        """The motors can hold the forces beside gravity; gravity alone is always allowed."""
        torque = ca.horzcat(*(made.torque for made in generators))
        for j, limit in enumerate(most):
            if np.isfinite(limit):
                low, high = -limit - gravity[j], limit - gravity[j]
                low, high = ca.fmin(low, 0), ca.fmax(high, 0)
                self.add(f"static torque of joint {j + 1}", torque[j, :], low, high)


def _program(requests: Requests, E: ca.SX, conditions: _Conditions) -> Consistency:
    f, A = requests.values, ca.vertcat(*conditions.rows)
    lower, upper = ca.vertcat(*conditions.lower), ca.vertcat(*conditions.upper)
    scales = [1 / ARM_LENGTH if is_moment(name) else 1.0 for name in requests.names]
    W = ca.diag(ca.DM(scales) ** 2)
    gram = E @ E.T + _GENERATOR_WEIGHT * ca.SX.eye(len(requests.names))
    guess = E.T @ linear.solve(linear.cholesky(gram), f)
    missed = ca.norm_2(E @ guess - f) - EQUAL * (1 + ca.norm_2(f))
    outside = ca.mmax(ca.vertcat(lower - A @ guess, A @ guess - upper))
    return Consistency(
        needed=ca.logic_or(missed > 0, outside > EQUAL),
        P=ca.densify(E.T @ W @ E + _GENERATOR_WEIGHT * ca.SX.eye(E.shape[1])),
        g=ca.densify(-E.T @ W @ f),
        A=ca.densify(A),
        lower=ca.densify(lower),
        upper=ca.densify(upper),
        effect=ca.densify(E),
        texts=tuple(conditions.texts),
    )


def wrench_generators(
    *,
    context: Context,
    objects: Sequence[str],
    normals: Sequence[ca.SX],
    points: Sequence[ca.SX],
    about: ca.SX,
    tip: ca.SX,
    J: ca.SX,
    resolve: ca.SX,
    requested: ca.SX,
) -> list[Generator]:
    """Generators of the tool's points on the shapes that the stage touches; world axes.

    Args:
        context: of the task.
        objects: touched.
        normals: (3,) outward, of each.
        points: (3,) centres of the tool's spheres.
        about: (3,) the control point.
        tip: (3,).
        J: (6, n) of the tip.
        resolve: (r, 6) from a wrench at the control point to the requested forces.
        requested: (3,) the requested force; the pyramid's first edge lies along it.
    """
    found = []
    for name, normal in zip(objects, normals, strict=True):
        friction = FRICTION_SHARE * context.loaded.task.shapes[name].friction
        for p in points:
            directions = [(-normal, "normal")]
            if friction > 0:
                directions += [(t, "tangent") for t in tangents(normal, requested)]
            for direction, kind in directions:
                wrench = ca.vertcat(direction, ca.cross(p - about, direction))
                at_tip = ca.vertcat(direction, ca.cross(p - tip, direction))
                found.append(Generator(resolve @ wrench, J.T @ at_tip, friction, kind, name))
    return found


def tangents(normal: ca.SX, towards: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Two unit tangents (3,), the first along what `towards` has in the surface.

    The nearest point of a cone lies in the plane of its axis and the request, so with an edge of
    the inscribed pyramid in that plane the pyramid is exact for one contact. Elsewhere its faces
    allow 1 / sqrt(2) of the friction at worst.
    """
    # Where nothing is requested along the surface any direction will do.
    other = ca.if_else(ca.fabs(normal[0]) < 0.7, 1, 0)
    aid = 1e-6 * ca.vertcat(other, 1 - other, 0)
    along = towards + aid
    along = along - normal * ca.dot(normal, along)
    first = along / ca.fmax(ca.norm_2(along), 1e-12)
    return first, ca.cross(normal, first)


def equation_generator(contact: ContactRow, effect: ca.SX) -> Generator:
    """The generator of an equation: of either sign where it holds in both directions."""
    both_ways = "moment" if contact.angular else "free"
    kind = both_ways if contact.both_ways else "normal"
    return Generator(effect, contact.J.T, 0.0, kind, contact.name)


def grip_generators(resolve: ca.SX, J: ca.SX) -> list[Generator]:
    """Generators of a grip: any force and moment at the control point, `J` (6, n) there."""
    kinds = ("free",) * 3 + ("moment",) * 3
    return [
        Generator(resolve[:, i], J[i, :].T, 0.0, kind, "the grip") for i, kind in enumerate(kinds)
    ]
