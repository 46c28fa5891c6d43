"""The tool: its tip, the spheres it touches with, its mass, its geoms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.errors import RobotError
from taskspec.robot.geoms import add_geom
from taskspec.robot.poses import principal_axes, quaternion, symmetric
from taskspec.robot.types import ToolGeometry, ToolLike
from taskspec.shapes import BoundedSurface, Cylinder, tool_shapes
from taskspec.text.codes import register
from taskspec.text.units import show

register({"TS407": "a tool that is not complete or not possible"})

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

RADIUS = 0.010
LENGTH = 0.100
_STEM = 0.008
_STEEL = (0.62, 0.65, 0.69, 1.0)
_TIP = (0.90, 0.47, 0.13, 1.0)


@dataclass(frozen=True, slots=True)
class Part:
    """One solid of a tool, about its own centre on the tool's axis; z along the axis.

    Attributes:
        solid: Its shape.
        z: Height of its centre in the tip frame [m], negative is towards the flange.
        color: Red, green, blue, opacity.
        drawn: Whether it is more than what the tool touches with.
    """

    solid: BoundedSurface
    z: float
    color: tuple[float, float, float, float]
    drawn: bool = True

    def inertia(self, mass: float) -> pin.Inertia:
        """Inertia of this solid with `mass` [kg], uniform, in the tip frame."""
        moments = mass * np.array(self.solid.inertia(1.0))
        return pin.Inertia(mass, np.array([0.0, 0.0, self.z]), np.diag(moments))


@dataclass(frozen=True, slots=True)
class MountedTool:
    """A tool, ready to be attached.

    Attributes:
        length: Distance from the flange to the tip along the flange's z [m].
        parts: Its solids.
        geometry: What it touches with.
        inertia: In the tip frame.
        mass: [kg]; that of `inertia`, a sum of shares, may be off by its last digit.
    """

    length: float
    parts: tuple[Part, ...]
    geometry: ToolGeometry
    inertia: pin.Inertia
    mass: float


def make_tool(tool: ToolLike, planar: bool) -> MountedTool:
    """The tool that a task file describes.

    A flat face touches through small spheres whose lowest points lie in it and whose outer edge is
    the face's edge: eight on a cylinder's rim, four at a box's corners. A cylinder without a
    thickness is one over the whole length; of a tool without a length it is a disc, half as thick
    as its radius.

    Args:
        tool: The file's `robot.tool`.
        planar: Whether the arm is planar; its tool then ends where the last link does.

    Raises:
        RobotError: TS407 when a dimension is missing or not positive, or no body has its inertia.
    """
    length = tool.length if tool.length is not None else (0.0 if planar else LENGTH)
    radius = tool.radius if tool.radius is not None else RADIUS
    _check("length", length, zero=True)
    _check("mass", tool.mass, zero=True)
    _check("radius", radius)
    kind = tool_shapes()[tool.shape]
    if tool.size is None and "size" in kind.tool_keys:
        raise RobotError(
            "TS407",
            f"a {tool.shape} needs its size",
            "size: [40 mm, 20 mm, 10 mm]",
            ("tool", "size"),
        )
    for edge in tool.size or ():
        _check("size", edge)
    if tool.thickness is not None:
        _check("thickness", tool.thickness)
    thickness = tool.thickness or length or radius / 2
    end = kind.tool_end(radius, tool.size or (), thickness)
    geometry = ToolGeometry(end.centers, end.radii, end.flat, end.solid, end.center)
    head = Part(end.solid, end.center, _TIP, drawn=end.flat)
    stem = length + end.stem
    parts: tuple[Part, ...] = (head,)
    if stem > 0:
        thick = min(_STEM, 0.6 * end.half_width)
        rod = Cylinder(np.zeros(3), np.eye(3), thick, stem)
        parts = (Part(rod, stem / 2 - length, _STEEL), head)
    return MountedTool(length, parts, geometry, _weighed(tool, length, parts), tool.mass)


def _weighed(tool: ToolLike, length: float, parts: Sequence[Part]) -> pin.Inertia:
    """Inertia in the tip frame: as the file has it, else the mass shared out by volume."""
    total = sum(part.solid.volume for part in parts)
    body = pin.Inertia.Zero()
    for part in parts:
        body += part.inertia(tool.mass * part.solid.volume / total)
    if tool.com is None and tool.inertia is None:
        return body
    center = body.lever if tool.com is None else np.array(tool.com) - [0.0, 0.0, length]
    moments = body.inertia if tool.inertia is None else symmetric(tool.inertia)
    principal = np.linalg.eigvalsh(moments)
    # Of moments that are written with three digits the greatest may be off by as much.
    if tool.inertia is not None and not 0 < principal[2] <= (principal[0] + principal[1]) * 1.002:
        one, two, three = (show(value, "kg*m^2") for value in principal)
        raise RobotError(
            "TS407",
            f"no body has the principal moments of inertia {one}, {two} and {three}",
            "none is negative, and none greater than the two others together",
            ("tool", "inertia"),
        )
    return pin.Inertia(tool.mass, center, moments)


def attach(
    carrier: mujoco.MjsBody, flange: pin.SE3, tool: MountedTool, taken: set[str]
) -> tuple[str, tuple[str, ...]]:
    """Adds the tool's body and geoms below `carrier`; the body's frame is the tip frame.

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
    moments, axes = np.diag(inertia.inertia), np.eye(3)
    if np.any(inertia.inertia - np.diag(moments)):
        moments, axes = principal_axes(inertia.inertia)
    body.iquat = quaternion(axes)
    body.inertia = moments if tool.mass else np.zeros(3)
    for part in tool.parts:
        if part.drawn:
            add_geom(
                body,
                part.solid.geom(),
                [0.0, 0.0, part.z],
                rgba=part.color,
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


def _check(what: str, value: float, *, zero: bool = False) -> None:
    if not np.isfinite(value) or value < 0 or (value == 0 and not zero):
        raise RobotError(
            "TS407",
            f"the tool's {what} is {value:g}",
            "it must be zero or more" if zero else "it must be more than zero",
            ("tool", what),
        )
