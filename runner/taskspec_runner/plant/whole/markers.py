"""Pairs of a tool, or a loose body's point, and a shape with a cut: marker geoms in a scene."""

from __future__ import annotations

import mujoco

from taskspec.deferred_methods import dataclass
from taskspec.program.world.frames import surface
from taskspec.program.world.stiffness import IMPEDANCE, Compliance, settling_rate
from taskspec.robot.types import ToolGeometry
from taskspec.shapes import BoundedSurface, Box, Cylinder, PlateCut, Sphere
from taskspec.spec import Shape
from taskspec_runner.errors import InputError
from taskspec_runner.plant.names import INERT, PREFIX
from taskspec_runner.plant.simulator import LayoutError
from taskspec_runner.plant.whole import collision, patches

_CUTS = {"hole": patches.HOLE, "slot": patches.SLOT, "groove": patches.GROOVE}
#: How far flat faces bulge [m].
ROUNDING = 5e-6
#: Ahead of a marker's name.
_MARKER = "whole/"


@dataclass(frozen=True, slots=True)
class WholeContact:
    """What a contact of a shape with a cut has.

    Attributes:
        declared: stiffness and damping of each of its patches.
        friction: Coulomb's coefficient.
        mobility: A, the sum of both bodies' inverse masses as MuJoCo counts them [1/kg].
        plant_period: step of the plant [s].
    """

    declared: Compliance
    friction: float
    mobility: float
    plant_period: float

    @property
    def numbers(self) -> list[float]:
        """As a marker has them."""
        k, b = self.declared.stiffness, self.declared.damping
        rate = settling_rate(b, self.mobility, self.plant_period)
        return [k, b, self.friction, self.mobility, rate / IMPEDANCE, IMPEDANCE]


def cut_of(shape: Shape) -> PlateCut | None:
    """What is cut into a shape."""
    return surface(shape).cut()


def add_pair(
    spec: mujoco.MjSpec,
    name: str,
    cut: PlateCut,
    touches: tuple[str, ToolGeometry | float],
    contact: WholeContact,
) -> None:
    """Adds markers and their pair.

    Args:
        spec: of the scene.
        name: of the shape.
        cut: what is cut into it.
        touches: a geom of what touches it, of which contacts are reported, on the body that does;
            and what that is: a tool, or the radius of a ball at the geom's centre [m].
        contact: stiffness, damping and friction.
    """
    try:
        collision.install()
    except LayoutError as error:
        raise InputError(f"'{name}' cannot be simulated here: {error}") from None
    collision.wide(spec)
    named, (other, tool) = spec.geom(PREFIX + name), touches
    on = spec.geom(other)
    pair = f"{name}|{other}"
    marker = _marker(named.parent, f"{_MARKER}{pair}|shape", named.pos, named.quat)
    collision.mark_shape(marker, _CUTS[cut.kind], cut.sizes, contact.numbers)
    if isinstance(tool, ToolGeometry):
        kind, half = _solid(tool.solid)
        place = [0.0, 0.0, tool.middle]
    else:
        kind, half, place = patches.BALL, [tool] * 3, on.pos
    marker = _marker(on.parent, f"{_MARKER}{pair}|tool", place, [1.0, 0.0, 0.0, 0.0])
    collision.mark_tool(marker, kind, half, ROUNDING)
    spec.add_pair(geomname1=f"{_MARKER}{pair}|shape", geomname2=f"{_MARKER}{pair}|tool", condim=3)


def connect(model: mujoco.MjModel) -> None:
    """Has the contacts of markers reported as those of the geoms that they stand for."""
    for number in range(model.ngeom):
        name = model.geom(number).name
        if name.startswith(_MARKER):
            shape, other, which = name.removeprefix(_MARKER).split("|")
            reported = PREFIX + shape if which == "shape" else other
            collision.connect(model, number, model.geom(reported).id)


def _marker(body: mujoco.MjsBody, name: str, pos: list[float], quat: list[float]) -> mujoco.MjsGeom:
    return body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=[1e-3] * 3,
        pos=pos,
        quat=quat,
        rgba=[0.0] * 4,
        group=4,
        **INERT,
    )


def _solid(solid: BoundedSurface) -> tuple[int, list[float]]:
    if isinstance(solid, Sphere):
        return patches.BALL, [solid.radius] * 3
    if isinstance(solid, Cylinder):
        return patches.CYLINDER, [solid.radius, solid.radius, solid.length / 2]
    assert isinstance(solid, Box)
    return patches.BOX, [float(edge) for edge in solid.half]
