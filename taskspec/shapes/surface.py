"""What a shape is: its sizes in a file, its distance, its parts, its body, its geom.

A surface is written on CasADi expressions of a point in world coordinates. Its sizes are numbers:
the nominal ones in the controller, the true ones in the plant.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.text.units import LENGTH, Dimension

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Vector = NDArray[np.float64]
    Numbers = NDArray[np.int_]

#: Largest radius of the spheres with which edges and rims touch [m].
POINT_RADIUS = 0.0005
#: How many of them stand for a round edge.
RIM_POINTS = 8


@dataclass(frozen=True, slots=True)
class SizeKey:
    """A key of a file that gives a size of a shape; every size is more than zero.

    Attributes:
        name: the key, and the shape's argument of that name [SI units].
        title: for editors.
        dimension: what it measures.
        entries: how many numbers it takes; with more than one they stand in a list.
        extent: what it is, after the names of the shapes that have it.
        description: what it is where those names are left out.
        example: a value, as a message shows it.
        shown: values that editors show.
        most: what it is at most [SI units].
        words: the choice, of what is a word.
        text: whether it is a text.
    """

    name: str
    title: str
    dimension: Dimension = LENGTH
    entries: int = 1
    extent: str = ""
    description: str = ""
    example: str = "50 mm"
    shown: tuple[Any, ...] = ()
    most: float | None = None
    words: tuple[str, ...] = ()
    text: bool = False


RADIUS = SizeKey("radius", "Radius", shown=("50 mm",))
SIZE = SizeKey(
    "size",
    "Full edges of a box",
    entries=3,
    description="Full edges along x, y and z; of a hole those of the block that it is in, which "
    "ends at z = 0. Without it the plate is endless",
    example="[100 mm, 100 mm, 50 mm]",
    shown=(["200 mm", "100 mm", "50 mm"],),
)
LENGTH_OF = SizeKey(
    "length",
    "Length from end to end",
    description="Of a cylinder along its z; of a slot or groove, which is endless without it, "
    "along its x",
    shown=("200 mm",),
)
DEPTH = SizeKey(
    "depth", "Depth below the plate", extent=", below the plate", example="20 mm", shown=("20 mm",)
)
CHAMFER = SizeKey(
    "chamfer",
    "Chamfer of 45 degrees",
    description="How far the edge is cut, at 45 degrees; by default it is sharp",
    example="1 mm",
    shown=("1 mm",),
)


@dataclass(frozen=True, eq=False)
class Geom:
    """A geom of MuJoCo as data, in the axes of the shape.

    Attributes:
        kind: MuJoCo's word for its type.
        size: (3,) as MuJoCo counts it [m].
        center: (3,) [m].
        corners: (n, 3) of a `mesh` [m].
        faces: (m, 3) numbers of the corners of its triangles, counterclockwise from outside.
    """

    kind: str
    size: tuple[float, float, float]
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    corners: Vector | None = None
    faces: Numbers | None = None


@dataclass(frozen=True, eq=False)
class WholeShape:
    """A shape as the plant knows it, touched by the tool's whole surface.

    Attributes:
        kind: the plant's word for it.
        sizes: as the plant takes them [m, rad].
    """

    kind: str
    sizes: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Surface(ABC):
    """A kind of shape, and of that kind one that is somewhere.

    A subclass is a kind; in addition to these attributes it takes its sizes, by the names of its
    keys.

    Attributes:
        origin: (3,) [m], world.
        rotation: (3, 3), columns are the shape's own axes in the world.
        name: the kind's word in a file.
        keys: its sizes in a file.
        optional: the names of those that may be left out.
        remark: what else an editor says of it.
        flat: whether every part of it that a frame follows is flat.
        level: whether its outward normal is the same everywhere.
        convex: whether it is; a straight line meets what is not more than once.
        start_over: where a tool starts that is to follow it; empty for anywhere.
        parts: what its parts are called of which a stage follows one; empty for one part alone.
        face_size: how many numbers describe the part that a stage follows; 0 for one part alone.
    """

    origin: Vector
    rotation: Vector

    name: ClassVar[str]
    keys: ClassVar[tuple[SizeKey, ...]] = ()
    optional: ClassVar[tuple[str, ...]] = ()
    remark: ClassVar[str] = ""
    flat: ClassVar[bool] = False
    level: ClassVar[bool] = False
    convex: ClassVar[bool] = True
    start_over: ClassVar[str] = ""
    parts: ClassVar[str] = ""
    face_size: ClassVar[int] = 0

    @abstractmethod
    def height(self, x: ca.SX) -> ca.SX:
        """Signed distance [m] of a point (3,) in the shape's own coordinates, positive outside."""

    @abstractmethod
    def chart(self, face: ca.SX | None = None) -> SurfaceChart:
        """The smooth part of the surface that a following frame moves on.

        Args:
            face: (face_size,) numbers of the part, chosen as the stage is entered.
        """

    @abstractmethod
    def geom(self) -> Geom:
        """The geom of the shape where it stands still."""

    @classmethod
    def placed(cls, origin: Vector, rotation: Vector, sizes: Mapping[str, Any]) -> Surface:
        """The shape that a file's sizes, by key, make of this kind."""
        return cls(origin, rotation, **sizes)

    @classmethod
    def fixed(cls, data: Mapping[str, Any]) -> str:
        """Why a shape with these keys in a file can be no loose body; empty where it can."""
        return "in a block that is fixed" if "size" in data else "endless"

    def local(self, point: ca.SX) -> ca.SX:
        """The world point (3,) in the shape's own coordinates (3,) [m]."""
        return ca.DM(self.rotation.T) @ (point - ca.DM(self.origin))

    def distance(self, point: ca.SX) -> ca.SX:
        """Signed distance [m] of a world point (3,) from the solid shape, positive outside."""
        return self.height(self.local(point))

    def gradient(self, point: ca.SX) -> ca.SX:
        """Direction (3,), world, in which the distance grows: the outward normal."""
        x = ca.SX.sym("x", 3)
        gradient = ca.Function("gradient", [x], [ca.gradient(self.distance(x), x)])
        return gradient(point)

    def face_at(self, point: ca.SX) -> ca.SX | None:  # noqa: ARG002
        """(face_size,) numbers of the part nearest to a world point (3,); None for one part."""
        return None

    def moving_geom(self) -> Geom:
        """The geom of the shape where it moves."""
        return self.geom()

    def whole(self) -> WholeShape | None:
        """It as the plant knows it; None where a ball touches it as MuJoCo's own geom."""
        return None

    def uncut(self) -> Surface:
        """The shape without what is cut into it: what predictions from its normal take it for."""
        return self

    def visible_geom(self, center: Vector, half: Vector) -> Geom | None:  # noqa: ARG002
        """What is drawn of a shape that is endless; None where its own geom is drawn.

        Args:
            center: (3,) about which, in the shape's own axes [m].
            half: (2,) how far along its x and y [m].
        """
        return None


class BoundedSurface(Surface):
    """A shape of finite size: it has a volume, and may be a loose body.

    Attributes:
        resting_points: how many of the contact points carry a body that lies flat.
    """

    resting_points: ClassVar[int]

    @classmethod
    def fixed(cls, data: Mapping[str, Any]) -> str:  # noqa: ARG003
        """Nothing fixes it."""
        return ""

    @property
    @abstractmethod
    def volume(self) -> float:
        """Volume [m^3]."""

    @abstractmethod
    def inertia(self, mass: float) -> list[float]:
        """Principal moments (3,) [kg m^2] about its own axes, of a mass [kg] spread evenly."""

    @abstractmethod
    def contact_points(self) -> tuple[Vector, float]:
        """Centres (k, 3) [m] of the spheres with which a body touches, own axes, and their radius.

        A face that lies flat rests on some of them, each with an equal share.
        """

    @property
    def half_sizes(self) -> Vector:
        """(3,) how far it reaches along its own axes [m]."""
        points, radius = self.extremes()
        return np.asarray(np.abs(points).max(axis=0) + radius)

    def support(self, n: ca.SX) -> ca.SX:
        """How far it reaches along a unit direction (3,), own axes [m]."""
        points, radius = self.extremes()
        return ca.mmax(ca.DM(points) @ n) + radius

    def flat_along(self, n: ca.SX) -> ca.SX:  # noqa: ARG002
        """(3,) how flat it is along its own axes where it is touched along n (3,): 1 flat, 0 round.

        None is flat along n.
        """
        return ca.SX.zeros(3)

    @abstractmethod
    def extremes(self) -> tuple[Vector, float]:
        """Points (k, 3) [m] that it reaches furthest with, own axes, and a radius about them."""


@dataclass(frozen=True, eq=False)
class ToolEnd:
    """The end of a tool, in the tip frame: z out of the tool, its lowest points in z = 0.

    Attributes:
        solid: about its own centre, z along the tool's axis.
        center: height of that centre [m], negative is towards the flange.
        half_width: least across the tool's axis [m].
        stem: height at which the tool's stem meets it [m].
        centers: (k, 3) of the spheres with which it touches [m].
        radii: (k,) [m].
        flat: whether those spheres stand for a flat face.
    """

    solid: BoundedSurface
    center: float
    half_width: float
    stem: float
    centers: Vector
    radii: Vector
    flat: bool = True


class ToolSurface(BoundedSurface):
    """A shape that can be the end of a tool.

    Attributes:
        tool_keys: its sizes as the end of a tool, and whether a file has to give each.
    """

    tool_keys: ClassVar[dict[str, bool]]

    @classmethod
    @abstractmethod
    def tool_end(cls, radius: float, size: Sequence[float], thickness: float) -> ToolEnd:
        """The end of a tool.

        Args:
            radius: of what is round [m].
            size: (3,) full edges of what has edges [m], the third along the tool's axis.
            thickness: of a cylinder, along the tool's axis [m].
        """


class SurfaceChart(ABC):
    """Distance, foot, normal and frame of the part of a surface that the tool follows."""

    @abstractmethod
    def distance(self, point: ca.SX) -> ca.SX:
        """Signed distance [m] from the chart, continued beyond its edges."""

    @abstractmethod
    def normal(self, point: ca.SX) -> ca.SX:
        """Outward unit normal (3,), world, at the foot of a world point (3,)."""

    @abstractmethod
    def own_x(self) -> ca.SX:
        """The world direction (3,) that becomes x where a frame has no heading."""

    @abstractmethod
    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """Positive while the foot of a world point (3,) is on the chart and x is defined there."""

    def numbers(self, point: ca.SX) -> ca.SX | None:  # noqa: ARG002
        """What `near` takes at a world point (3,); None where the chart itself is as quick."""
        return None

    def near(self, numbers: ca.SX) -> SurfaceChart:  # noqa: ARG002
        """A chart with the values and the first derivatives of this one at a point."""
        return self

    def foot(self, point: ca.SX) -> ca.SX:
        """The surface point (3,) [m], world, nearest to a world point (3,)."""
        return point - self.distance(point) * self.normal(point)

    def frame(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """The following frame (3, 3) at the foot of a point: z the outward normal.

        x is `heading` (world, (3,)) laid on the tangent plane, by default the surface's own x,
        for a cylinder its axis (docs/language/frames.md).
        """
        n = self.normal(point)
        x = _tangent(ca.SX(self.reference_direction(heading)), n)
        return ca.horzcat(x, ca.cross(n, x), n)

    def reference_direction(self, heading: Vector | None) -> ca.SX:
        """The world direction (3,) that is laid on the tangent plane to become x."""
        if heading is not None:
            return ca.SX(ca.DM(np.asarray(heading, dtype=float)))
        return self.own_x()

    def away_from_pole(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """Positive where x is defined: where the reference direction is not along the normal."""
        return self._away(self.normal(point), heading)

    def _away(self, n: ca.SX, heading: Vector | None) -> ca.SX:
        """The same of a normal (3,)."""
        x = self.reference_direction(heading)
        return 1 - ca.fabs(ca.dot(n, x)) / ca.norm_2(x) - 1e-3


def banded(lines: Sequence[Vector]) -> Geom:
    """A mesh of bands, each between two polylines (n, 3) [m] that follow each other."""
    corners: list[Vector] = []
    faces: list[tuple[int, int, int]] = []
    for first, second in zip(lines[::2], lines[1::2], strict=True):
        begin, n = sum(map(len, corners)), len(first)
        corners += [first, second]
        for i in range(n - 1):
            a, b, c, d = begin + i, begin + i + 1, begin + n + i, begin + n + i + 1
            faces += [(a, c, b), (b, c, d)]
    return Geom("mesh", (1.0, 1.0, 1.0), corners=np.vstack(corners), faces=np.array(faces))


def _tangent(direction: ca.SX, n: ca.SX) -> ca.SX:
    x = direction - ca.dot(direction, n) * n
    return x / ca.sqrt(ca.sumsqr(x) + 1e-30)


def outside(excess: ca.SX) -> ca.SX:
    """Signed distance [m] from a solid that its coordinates leave by `excess` (k,) [m]."""
    away = ca.sqrt(ca.sumsqr(ca.fmax(excess, 0)) + 1e-30)
    return away + ca.fmin(ca.mmax(excess), 0)


def radius_about_z(x: ca.SX) -> ca.SX:
    """Distance [m] of a point (3,) from the z axis."""
    return ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1e-30)
