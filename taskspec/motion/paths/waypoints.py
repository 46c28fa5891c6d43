"""Straight legs through points, with round corners and orientations."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from taskspec.deferred import np
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.motion.paths.form import COORDINATES
from taskspec.motion.paths.key import PathKey, WrongPath
from taskspec.motion.paths.laid import LaidPath, Route
from taskspec.motion.paths.polyline import Polyline
from taskspec.motion.profile import PathSection
from taskspec.text.units import LENGTH, show

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taskspec.motion.polynomial import PiecewiseCubic

    Vector = NDArray[np.float64]

#: Two points in a row are at least so far apart [m].
_APART = 1e-6
#: Pieces of the turning between two points.
_PIECES = 32
#: The tool turns no faster than this [rad/s], the default speed of a rotation's move.
MOST_TURNING = math.radians(30.0)
#: The greatest slope of the smooth step.
_STEEPEST = 1.5


@dataclass(frozen=True, slots=True)
class Waypoints(LaidPath):
    """Straight legs through points of the frame, with round corners.

    Between two points the orientation takes the smallest angle about one axis, with a smooth step
    of the distance (3 u^2 - 2 u^3): so its rate has no jump.

    Attributes:
        points: x, y, z [m], rx, ry, rz [rad] of each, from the left.
        radius: of the corners [m]; without one it rests at each.
    """

    points: tuple[tuple[float, ...], ...]
    radius: float = 0.0

    name = "waypoints"
    keys = (
        PathKey(
            "points",
            "Points",
            "Where it leads through, each with as many coordinates of the frame as are wanted.",
            entries=COORDINATES,
            fewest=1,
            rows=2,
            description="A list of [x, y, z, rx, ry, rz]",
            examples=([[0, 0], ["60 mm", 0], ["60 mm", "40 mm"]],),
        ),
        PathKey(
            "radius",
            "Radius of the corners",
            "Of the arcs that round the corners; without one it rests at each corner.",
            LENGTH,
            least=0.0,
            default=0.0,
            optional=True,
            examples=("5 mm",),
        ),
    )
    noun = "a path through points"
    title = "Straight legs through points"
    meaning = "Straight legs through points, with round corners and orientations."
    examples = ({"points": [[0, 0], ["60 mm", 0], ["60 mm", "40 mm"]], "radius": "5 mm"},)
    relative = False

    @classmethod
    def wrong(cls, data: Mapping[str, Any]) -> WrongPath | None:
        """All points have as many coordinates as the first one."""
        counts = [len(point) for point in data["points"]]
        for i, count in enumerate(counts):
            if count != counts[0]:
                message = f"{count} coordinates, but {counts[0]} of the first point"
                return WrongPath("TS023", "points", message, "give all points as many", i)
        return None

    @property
    def own(self) -> tuple[Axis, ...]:
        """The axes of the coordinates."""
        return AXES[: len(self.points[0])]

    @property
    def _places(self) -> list[tuple[float, ...]]:
        return [point[:3] for point in self.points]

    def unfit(self, axes: Sequence[Axis]) -> WrongPath | None:  # noqa: ARG002
        """Points at one place, and corners that are too round for their legs."""
        places = self._places
        for i in range(1, len(places)):
            if math.dist(places[i - 1], places[i]) < _APART:
                message = f"points {i} and {i + 1} are at one place"
                hint = "a path has to lead on; for a turn alone make a stage of it"
                return WrongPath("TS235", "points", message, hint, i)
        tight = Polyline(places, self.radius).tight()
        if tight is not None:
            message = f"the corner at point {tight.point + 1} is too round for its legs"
            hint = f"a radius of up to {show(_down(tight.most), LENGTH, 3)} fits"
            return WrongPath("TS235", "radius", message, hint)
        return None

    def lay(self) -> Route:
        """Legs and arcs, and the rotation along them."""
        line = Polyline(self._places, self.radius)
        splines = dict(zip(AXES, line.splines(), strict=False))
        sections, reached = line.sections(), line.reached()
        vectors = [np.array((*point[3:], 0.0, 0.0, 0.0)[:3]) for point in self.points]
        if len(self.points[0]) > 3:
            turning = _turning(vectors, [distance / reached[-1] for distance in reached])
            splines |= {a: turning[i] for i, a in enumerate(self.own[3:])}
            sections = _slowed(sections, vectors, reached)
        return Route(splines, sections)


def _down(radius: float) -> float:
    """A little less, of three figures."""
    size = 10.0 ** (math.floor(math.log10(radius)) - 2)
    return math.floor(radius / size * (1 + 1e-9)) * size


def _between(one: Vector, other: Vector) -> Vector:
    """Rotation vector (3,) [rad] from one orientation to the other, in the axes of the first."""
    from taskspec.geometry.rotation import quaternion, turned, vector_of

    return vector_of(turned(quaternion(one), quaternion(other), back=True))


def _slowed(
    sections: tuple[PathSection, ...], vectors: Sequence[Vector], reached: Sequence[float]
) -> tuple[PathSection, ...]:
    """Sections with the speed at which the tool turns as fast as it may."""
    turns = [float(np.linalg.norm(_between(a, b))) for a, b in itertools.pairwise(vectors)]
    found, distance = [], 0.0
    for section in sections:
        on = [
            _STEEPEST * turn / (end - start)
            for turn, start, end in zip(turns, reached, reached[1:], strict=False)
            if start < distance + section.length and distance < end
        ]
        steepest = max(on)
        speed = MOST_TURNING / steepest if steepest > 0 else math.inf
        found.append(PathSection(section.length, section.curvature, speed, rests=section.rests))
        distance += section.length
    return tuple(found)


def _turning(vectors: Sequence[Vector], shares: Sequence[float]) -> list[PiecewiseCubic]:
    """Rotation vectors against the share of the distance, each coordinate in cubics."""
    from taskspec.geometry.rotation import quaternion, turned, vector_of
    from taskspec.motion.polynomial import PiecewiseCubic

    knots, values = [0.0], [np.array(vectors[0], dtype=float)]
    rates = [np.zeros(3)]
    for i, (one, other) in enumerate(itertools.pairwise(vectors)):
        start, step = shares[i], shares[i + 1] - shares[i]
        first, turn = quaternion(one), _between(one, other)

        def vector(
            u: float,
            near: Vector,
            first: Vector = first,
            turn: Vector = turn,
        ) -> Vector:
            smooth = u * u * (3 - 2 * u)
            return _nearest(vector_of(turned(first, quaternion(smooth * turn))), near)

        for j in range(1, _PIECES + 1):
            u = j / _PIECES
            here = vector(u, values[-1])
            instant = 1e-5
            ahead, behind = vector(min(u + instant, 1.0), here), vector(u - instant, here)
            rest = j == _PIECES
            rates.append(np.zeros(3) if rest else (ahead - behind) / (2 * instant * step))
            values.append(here)
            knots.append(start + u * step)
    knots[-1] = 1.0
    x, y, m = np.array(knots), np.array(values), np.array(rates)
    h = np.diff(x)[:, None]
    slope = np.diff(y, axis=0) / h
    table = np.stack(
        [y[:-1], m[:-1], (3 * slope - 2 * m[:-1] - m[1:]) / h, (m[:-1] + m[1:] - 2 * slope) / h**2]
    )
    return [PiecewiseCubic(x, table[:, :, i].T.copy()) for i in range(3)]


def _nearest(vector: Vector, near: Vector) -> Vector:
    """The rotation vector of the same orientation that lies nearest to another one."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-9:
        return vector
    axis = vector / angle
    turns = round((float(axis @ near) - angle) / (2 * math.pi))
    found: Vector = vector + 2 * math.pi * turns * axis
    return found
