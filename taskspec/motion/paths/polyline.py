"""Polygons whose corners are rounded by arcs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from taskspec.deferred import np
from taskspec.deferred_methods import dataclass
from taskspec.motion.profile import PathSection

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taskspec.motion.polynomial import PiecewiseCubic

    Vector = NDArray[np.float64]

#: Angle of a piece of an arc [rad]. A cubic through its ends with its tangents is off by
#: r a^4/384 there: 1e-6 r/6.
_PIECE = math.radians(5.0)
#: A corner that turns by less is none [rad].
_STRAIGHT = 1e-6
#: One that turns by more leads back [rad].
_BACK = math.pi - 1e-3
#: What rounding adds to a length, as a share.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class TightCorner:
    """A corner whose arc does not fit between its neighbours.

    Attributes:
        point: its number in the polygon, from 0.
        most: the greatest radius of all corners with which it would fit [m].
    """

    point: int
    most: float


@dataclass(frozen=True, slots=True)
class Piece:
    """A straight leg, or an arc.

    Attributes:
        start: where it begins (d,) [m].
        direction: unit tangent there (d,).
        length: [m].
        normal: unit vector to the center (d,); None for a leg.
        radius: of the arc; infinite for a leg [m].
    """

    start: Vector
    direction: Vector
    length: float
    normal: Vector | None = None
    radius: float = math.inf

    def at(self, distance: float) -> tuple[Vector, Vector]:
        """Place and unit tangent (d,) after a distance along it [m]."""
        if self.normal is None:
            return self.start + distance * self.direction, self.direction
        angle = distance / self.radius
        c, s = math.cos(angle), math.sin(angle)
        place = self.start + self.radius * (s * self.direction + (1 - c) * self.normal)
        return place, c * self.direction + s * self.normal


class Polyline:
    """Straight legs between points, joined by arcs that are tangent to both.

    Where the radius is 0, and where it leads straight back, the corner is a point at which the path
    rests.

    Args:
        points: (k, d), no two in a row at one place [m].
        radius: of the arcs [m].
    """

    def __init__(self, points: Sequence[Sequence[float]], radius: float) -> None:
        self.points, self.radius = np.array(points, dtype=float), radius
        steps = np.diff(self.points, axis=0)
        self.legs = np.linalg.norm(steps, axis=1)
        self.directions = steps / self.legs[:, None]
        #: How much of each leg the arc at each point takes [m].
        self.cuts = np.zeros(len(self.points))
        for i, angle in enumerate(self._angles(), start=1):
            if radius > 0 and _STRAIGHT < angle < _BACK:
                self.cuts[i] = radius * math.tan(angle / 2)

    def _angles(self) -> Iterator[float]:
        """By how much each inner corner turns [rad]."""
        for one, other in zip(self.directions[:-1], self.directions[1:], strict=True):
            yield 2 * math.atan2(
                float(np.linalg.norm(other - one)), float(np.linalg.norm(other + one))
            )

    def tight(self) -> TightCorner | None:
        """The corner that is too round for its legs; None where all fit."""
        taken = self.cuts[:-1] + self.cuts[1:]
        beyond = taken / self.legs
        worst = int(np.argmax(beyond))
        if beyond[worst] <= 1 + _ROUNDING:
            return None
        return TightCorner(worst if self.cuts[worst] else worst + 1, self.radius / beyond[worst])

    def pieces(self) -> list[Piece]:
        """Legs and arcs in order."""
        found: list[Piece] = []
        for i, (leg, along) in enumerate(zip(self.legs, self.directions, strict=True)):
            start = self.points[i] + self.cuts[i] * along
            left = float(leg - self.cuts[i] - self.cuts[i + 1])
            if left > _ROUNDING * leg:
                found.append(Piece(start, along, left))
            cut = float(self.cuts[i + 1])
            if cut > 0:
                turned = self.directions[i + 1] - along
                across = turned - (turned @ along) * along
                corner = self.points[i + 1] - cut * along
                angle = 2 * math.atan2(cut, self.radius)
                normal = across / np.linalg.norm(across)
                found.append(Piece(corner, along, self.radius * angle, normal, self.radius))
        return found

    def reached(self) -> list[float]:
        """The distance along the path to each point, or to the middle of its arc [m]."""
        distance, found = 0.0, [0.0]
        for i, leg in enumerate(self.legs):
            arcs = [self._arc(j) for j in (i, i + 1)]
            distance += arcs[0] / 2 + float(leg - self.cuts[i] - self.cuts[i + 1]) + arcs[1] / 2
            found.append(distance)
        return found

    def _arc(self, i: int) -> float:
        """Length of the arc at a point [m]."""
        return self.radius * 2 * math.atan2(self.cuts[i], self.radius) if self.cuts[i] else 0.0

    def sections(self) -> tuple[PathSection, ...]:
        """Legs and arcs for the timing; corners without an arc are rests."""
        pieces = self.pieces()
        found = [PathSection(piece.length, 1 / piece.radius) for piece in pieces]
        for i in range(1, len(pieces)):
            before = pieces[i - 1]
            end = before.at(before.length)[1]
            if float(end @ pieces[i].direction) < math.cos(_STRAIGHT * 10):
                found[i] = PathSection(found[i].length, found[i].curvature, rests=True)
        return tuple(found)

    def splines(self) -> list[PiecewiseCubic]:
        """Each coordinate against the share of the distance, 0 to 1; exact on legs."""
        from taskspec.motion.polynomial import PiecewiseCubic

        pieces = self.pieces()
        whole = math.fsum(piece.length for piece in pieces)
        knots, rows, distance = [0.0], [], 0.0
        for piece in pieces:
            angle = 0.0 if piece.normal is None else piece.length / piece.radius
            count = max(1, math.ceil(angle / _PIECE - _ROUNDING))
            step = piece.length / count
            for i in range(count):
                rows.append(hermite(*piece.at(i * step), *piece.at((i + 1) * step), step, whole))
                knots.append((distance + (i + 1) * step) / whole)
            distance += piece.length
        knots[-1] = 1.0
        table = np.array(rows)
        return [PiecewiseCubic(np.array(knots), table[:, :, i]) for i in range(table.shape[2])]


def hermite(
    p0: Vector, t0: Vector, p1: Vector, t1: Vector, step: float, whole: float
) -> list[Vector]:
    """Coefficients (4, d) of the cubic between two places with their tangents.

    Args:
        p0, p1: places (d,) [m].
        t0, t1: rates along the path (d,).
        step: from one to the other along the path [m].
        whole: the distance that the argument counts in [m].
    """
    slope = (p1 - p0) / step
    bend = (3 * slope - 2 * t0 - t1) / step
    jerk = (t0 + t1 - 2 * slope) / step**2
    return [p0, t0 * whole, bend * whole**2, jerk * whole**3]
