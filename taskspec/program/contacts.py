"""Which object each axis of a stage presses on, or runs into.

What the file names comes first: `contact` on the axis, then on the stage; then the object whose
surface the frame follows, or on which it is fixed. Elsewhere it is the first object on the straight
line along which the axis pushes or moves, from where the tool is as the stage starts; an axis that
does neither, or whose direction the file leaves open, may be met from both sides. Where no object
lies ahead, the one behind counts: the tool may leave it, or pull at it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.modes import Known
from taskspec.program.world.moving_base import MovingBase
from taskspec.program.world.touch import Touch, WholeTool, whole_tool
from taskspec.robot import RobotModel
from taskspec.shapes import Surface
from taskspec.spec import AxisEntry

Vector = NDArray[np.float64]
#: A line that closes in by less than this share of itself passes by: 1 deg.
PASSING = math.sin(math.radians(1.0))
#: Nearer than this the tool is at an object [m].
_CONTACT_TOLERANCE = 1e-9
#: No arm reaches farther [m].
_LONGEST_REACH = 5.0
_MOST_FREE_STEPS = 2000
_MOST_STEPS = 60
#: When the sign of a reference is sampled [s].
_TIMES = (0.0, 0.13, 0.37, 1.0, 2.9)


@dataclass(frozen=True, slots=True)
class Encounter:
    """What a straight motion of the tool leads to.

    Attributes:
        contact: the object.
        way: how far that is [m].
        normal: (3,) its outward normal there, world axes.
    """

    contact: str
    way: float
    normal: Vector


class Obstacles:
    """The objects that the tool may touch, where they are as the run starts.

    Args:
        robot: for the tool.
        surfaces: of the objects, by name.
        bases: of those that move by themselves.
    """

    def __init__(
        self, robot: RobotModel, surfaces: Mapping[str, Surface], bases: Mapping[str, MovingBase]
    ) -> None:
        self._tool = robot.tool
        self._surfaces, self._bases = surfaces, bases
        self._functions: dict[str, ca.Function] = {}

    def distance(self, name: str, x: Vector) -> tuple[float, Vector]:
        """Distance of an object from a point (3,), and its outward normal (3,) there."""
        if name not in self._functions:
            point = ca.SX.sym("x", 3)
            surface = self._surfaces[name]
            self._functions[name] = ca.Function(
                "distance", [point], [surface.distance(point), surface.gradient(point)]
            )
        base = self._bases.get(name)
        A, a = (np.eye(3), np.zeros(3)) if base is None else base.pose(0.0)
        distance, normal = self._functions[name](A.T @ (x - a))
        return float(distance), A @ np.asarray(normal, dtype=float).ravel()

    def normal(self, name: str, p: Vector, R: Vector) -> Vector:
        """Outward normal (3,) of an object at the tool whose tip has a pose, world axes."""
        center = p if self._tool.flat else p + R @ self._tool.centers[0]
        return self.distance(name, center)[1]

    def gap(self, name: str, p: Vector, R: Vector) -> float:
        """Distance [m] of the tool whose tip has a pose (3,), (3, 3) from an object."""
        if self._whole(name) is not None:
            return -self._touch(name, p, R).depth
        spheres = zip(self._tool.centers, self._tool.radii, strict=True)
        return min(self.distance(name, p + R @ c)[0] - float(r) for c, r in spheres)

    def first(self, p: Vector, R: Vector, direction: Vector) -> Encounter | None:
        """The first object on a straight motion of the tool; None where it meets none.

        Args:
            p, R: (3,), (3, 3) pose of the tip as it starts.
            direction: (3,) unit vector, world axes.
        """
        met = [m for name in self._surfaces if (m := self._met(name, p, R, direction)) is not None]
        return min(met, key=lambda m: m.way, default=None)

    def _whole(self, name: str) -> WholeTool | None:
        """The tool where it touches an object with its whole surface."""
        return whole_tool(self._tool, self._surfaces[name])

    def _touch(self, name: str, p: Vector, R: Vector) -> Touch:
        """How the whole tool meets an object, at a pose of the tip (3,), (3, 3), world axes."""
        tool, base = self._whole(name), self._bases.get(name)
        assert tool is not None
        A, a = (np.eye(3), np.zeros(3)) if base is None else base.pose(0.0)
        return tool.touch(self._surfaces[name], A.T @ (p - a), A.T @ R).turned(A)

    def _met(self, name: str, p: Vector, R: Vector, direction: Vector) -> Encounter | None:
        if self._whole(name) is not None:
            return self._approached(
                name, direction, lambda way: self._distance_of(name, p + way * direction, R), True
            )
        found = [
            met
            for center, radius in zip(self._tool.centers, self._tool.radii, strict=True)
            if (met := self._sphere(name, p + R @ center, float(radius), direction)) is not None
        ]
        return min(found, key=lambda m: m.way, default=None)

    def _distance_of(self, name: str, p: Vector, R: Vector) -> tuple[float, Vector]:
        """Distance [m] of the whole tool from an object, and the object's normal (3,)."""
        touch = self._touch(name, p, R)
        return -touch.depth, touch.normal

    def _sphere(self, name: str, x: Vector, radius: float, direction: Vector) -> Encounter | None:
        """The motion of a sphere about a point (3,)."""

        def off(way: float) -> tuple[float, Vector]:
            distance, normal = self.distance(name, x + way * direction)
            return distance - radius, normal

        return self._approached(name, direction, off, self._surfaces[name].convex)

    def _approached(
        self,
        name: str,
        direction: Vector,
        off: Callable[[float], tuple[float, Vector]],
        convex: bool,
    ) -> Encounter | None:
        """Newton's method from outside: towards a convex shape it never goes beyond the distance.

        Of what is not convex the distance alone bounds the free travel.

        Args:
            name: of the object.
            direction: (3,) of the motion.
            off: distance [m] and normal (3,) after a travel [m].
            convex: whether the object is.
        """
        way = 0.0
        for _ in range(_MOST_STEPS if convex else _MOST_FREE_STEPS):
            distance, normal = off(way)
            closing = -float(normal @ direction)
            if (convex and not closing > PASSING) or way > _LONGEST_REACH:
                return None
            if distance <= _CONTACT_TOLERANCE:
                return Encounter(name, way, normal) if closing > PASSING else None
            way += distance / (closing if convex else 1.0)
        return None


def directions(entry: AxisEntry | None, known: Known) -> Iterator[tuple[int, ...]]:
    """In which direction along an axis to search its object: groups of signs, the first ones first.

    Args:
        entry: of the axis; None where the file has none.
        known: values of its expressions.
    """
    sign = _sign(entry, known)
    if sign == 0:
        yield (-1, 1)
    else:
        yield (sign,)
        yield (-sign,)


def _sign(entry: AxisEntry | None, known: Known) -> int:
    """The sign with which an axis pushes, else moves; 0 for neither, or if unknown."""
    if entry is None:
        return 0
    force = entry.set_point
    for t in _TIMES:
        if force is not None and (sign := _sign_of(known(force.wanted, _clocks(t)))):
            return sign
    for t in _TIMES:
        if sign := _sign_of(entry.mode.heading(_at(known, t))):
            return sign
    return 0


def _sign_of(value: float | None) -> int:
    if value is None or not math.isfinite(value) or not value:
        return 0
    return 1 if value > 0 else -1


def _clocks(t: float) -> dict[str, float]:
    return {"t": t, "clock": t}


def _at(known: Known, t: float) -> Known:
    return lambda expression, clocks: known(expression, _clocks(t) | dict(clocks or {}))
