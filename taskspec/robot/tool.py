"""The tool: its tip, the spheres it touches with, its mass, its looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pinocchio as pin

from taskspec.robot.errors import RobotError
from taskspec.robot.poses import quaternion
from taskspec.robot.types import ToolGeometry, ToolLike
from taskspec.text.codes import register

register({"TS407": "a tool that is not complete or not possible"})

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

RADIUS = 0.010
LENGTH = 0.100
_POINT = 0.0005
_RIM_POINTS = 8
_STEM = 0.008
_STEEL = (0.62, 0.65, 0.69, 1.0)
_TIP = (0.90, 0.47, 0.13, 1.0)


@dataclass(frozen=True, slots=True)
class Part:
    """One solid of a tool, about its own centre on the tool's axis; z along the axis.

    Attributes:
        kind: "sphere", "cylinder" or "box".
        half: (3,) half extents [m]: radius thrice, radius twice and half length, half edges.
        z: Height of its centre in the tip frame [m], negative is towards the flange.
    """

    kind: str
    half: tuple[float, float, float]
    z: float

    @property
    def volume(self) -> float:
        """Volume [m³]."""
        factor = {"sphere": 4 / 3 * np.pi, "cylinder": 2 * np.pi, "box": 8.0}[self.kind]
        return float(factor * np.prod(self.half))

    def inertia(self, mass: float) -> pin.Inertia:
        """Inertia of this solid with `mass` [kg], uniform, in the tip frame."""
        a, b, c = np.square(self.half)
        if self.kind == "sphere":
            moments = np.full(3, 0.4 * a)
        elif self.kind == "cylinder":
            moments = np.array([a / 4 + c / 3, a / 4 + c / 3, a / 2])
        else:
            moments = np.array([b + c, a + c, a + b]) / 3
        return pin.Inertia(mass, np.array([0.0, 0.0, self.z]), np.diag(mass * moments))


@dataclass(frozen=True, slots=True)
class Tool:
    """A tool, ready to be attached.

    Attributes:
        length: Distance from the flange to the tip along the flange's z [m].
        parts: Its solids; the last is the head.
        geometry: What it touches with.
        mass: [kg]
    """

    length: float
    parts: tuple[Part, ...]
    geometry: ToolGeometry
    mass: float

    @property
    def inertia(self) -> pin.Inertia:
        """Inertia in the tip frame, the mass shared out by volume."""
        total = sum(part.volume for part in self.parts)
        body = pin.Inertia.Zero()
        for part in self.parts:
            body += part.inertia(self.mass * part.volume / total)
        return body


def make_tool(tool: ToolLike, planar: bool) -> Tool:
    """The tool that a task file describes.

    A flat face touches through small spheres whose lowest points lie in it and whose outer edge is
    the face's edge: eight on a cylinder's rim, four at a box's corners.

    Args:
        tool: The file's `robot.tool`.
        planar: Whether the arm is planar; its tool then ends where the last link does.

    Raises:
        RobotError: TS407 when a dimension is missing or not positive.
    """
    length = tool.length if tool.length is not None else (0.0 if planar else LENGTH)
    radius = tool.radius if tool.radius is not None else RADIUS
    _check("length", length, zero=True)
    _check("mass", tool.mass, zero=True)
    _check("radius", radius)
    if tool.shape == "sphere":
        head = Part("sphere", (radius, radius, radius), -radius)
        centers, radii = np.array([[0.0, 0.0, -radius]]), np.array([radius])
    elif tool.shape == "cylinder":
        head = Part("cylinder", (radius, radius, radius / 4), -radius / 4)
        point = min(_POINT, radius / 4)
        angles = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
        rim = radius - point
        centers = np.column_stack(
            (rim * np.cos(angles), rim * np.sin(angles), np.full(_RIM_POINTS, -point))
        )
        radii = np.full(_RIM_POINTS, point)
    else:
        if tool.size is None:
            raise RobotError(
                "TS407", "a box needs its size", "size: [40 mm, 20 mm, 10 mm]", ("tool", "size")
            )
        for edge in tool.size:
            _check("size", edge)
        x, y, z = (edge / 2 for edge in tool.size)
        head = Part("box", (x, y, z), -z)
        point = min(_POINT, x / 4, y / 4)
        signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        centers = np.column_stack((signs * (x - point, y - point), np.full(4, -point)))
        radii = np.full(4, point)
    geometry = ToolGeometry(centers, radii, flat=tool.shape != "sphere")
    stem = length + 2 * head.z if tool.shape != "sphere" else length - radius
    parts: tuple[Part, ...] = (head,)
    if stem > 0:
        thick = min(_STEM, 0.6 * min(head.half[:2]))
        parts = (Part("cylinder", (thick, thick, stem / 2), stem / 2 - length), head)
    return Tool(length, parts, geometry, tool.mass)


def attach(
    carrier: mujoco.MjsBody, flange: pin.SE3, tool: Tool, taken: set[str]
) -> tuple[str, tuple[str, ...]]:
    """Add the tool's body and geoms below `carrier`; the body's frame is the tip frame.

    Args:
        carrier: The body that carries the flange.
        flange: The flange's pose in it.
        tool: What to attach.
        taken: Body names already in use.

    Returns:
        The body's name and those of the contact spheres.
    """
    name = next(n for n in ("tool", *(f"tool{i}" for i in range(2, 1000))) if n not in taken)
    tip = flange * pin.SE3(np.eye(3), np.array([0.0, 0.0, tool.length]))
    body = carrier.add_body(name=name, pos=tip.translation, quat=quaternion(tip.rotation))
    inertia = tool.inertia
    body.explicitinertial = True
    body.mass = tool.mass
    body.ipos = inertia.lever if tool.mass else np.zeros(3)
    body.iquat = np.array([1.0, 0.0, 0.0, 0.0])
    body.inertia = np.diag(inertia.inertia) if tool.mass else np.zeros(3)
    for i, part in enumerate(tool.parts):
        if part.kind == "sphere":
            continue
        body.add_geom(
            type=_TYPES[part.kind],
            pos=[0.0, 0.0, part.z],
            size=_size(part),
            rgba=_TIP if i == len(tool.parts) - 1 else _STEEL,
            group=1,
            contype=0,
            conaffinity=0,
        )
    geoms = []
    for i, (center, radius) in enumerate(
        zip(tool.geometry.centers, tool.geometry.radii, strict=True)
    ):
        geoms.append(f"{name}:contact{i}")
        body.add_geom(
            name=geoms[-1],
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=center,
            size=[radius, 0.0, 0.0],
            rgba=_TIP,
            group=1,
            contype=0,
            conaffinity=0,
        )
    return name, tuple(geoms)


_TYPES = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}


def _size(part: Part) -> list[float]:
    if part.kind == "cylinder":
        return [part.half[0], part.half[2], 0.0]
    return list(part.half)


def _check(what: str, value: float, *, zero: bool = False) -> None:
    if not np.isfinite(value) or value < 0 or (value == 0 and not zero):
        raise RobotError(
            "TS407",
            f"the tool's {what} is {value:g}",
            "it must be zero or more" if zero else "it must be more than zero",
            ("tool", what),
        )
