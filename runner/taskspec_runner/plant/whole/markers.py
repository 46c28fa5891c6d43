"""Pairs of a tool and a shape, or a loose body's point and a cut: marker geoms in a scene."""

from __future__ import annotations

import mujoco
import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program.world.stiffness import IMPEDANCE, Compliance, settling_rate
from taskspec.robot.types import ToolGeometry
from taskspec.shapes import Surface, overlap
from taskspec.shapes.solid import half_sizes, kind_and_sizes, rounding
from taskspec_runner.errors import InputError
from taskspec_runner.plant.names import INERT, PREFIX
from taskspec_runner.plant.simulator import LayoutError
from taskspec_runner.plant.whole import collision

#: Ahead of a marker's name.
_MARKER = "whole/"


@dataclass(frozen=True, slots=True)
class WholeContact:
    """Data of a contact of whole surfaces.

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
        """The user numbers of the marker."""
        k, b = self.declared.stiffness, self.declared.damping
        rate = settling_rate(b, self.mobility, self.plant_period)
        return [k, b, self.friction, self.mobility, rate / IMPEDANCE, IMPEDANCE]


def add_pair(
    spec: mujoco.MjSpec,
    name: str,
    solid: Surface,
    touches: tuple[str, ToolGeometry | float],
    contact: WholeContact,
    center: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Adds markers and their pair.

    Args:
        spec: of the scene.
        name: of the shape.
        solid: its surface.
        touches: a geom of what touches it, of which contacts are reported, on the body that does;
            and what that is: a tool, or the radius of a ball at the geom's centre [m].
        contact: stiffness, damping and friction.
        center: (3,) of the shape's geom in the shape's axes [m].
    """
    try:
        collision.install()
    except LayoutError as error:
        raise InputError(f"'{name}' cannot be simulated here: {error}") from None
    collision.wide(spec)
    named, (other, tool) = spec.geom(PREFIX + name), touches
    on = spec.geom(other)
    pair = f"{name}|{other}"
    # The geom of an endless shape that moves is a block beside its origin.
    offset = np.zeros(3)
    mujoco.mju_rotVecQuat(offset, -np.array(center), np.array(named.quat))
    place = (np.array(named.pos) + offset).tolist()
    marker = _marker(named.parent, f"{_MARKER}{pair}|shape", place, named.quat)
    collision.mark_shape(marker, *kind_and_sizes(solid), contact.numbers)
    if isinstance(tool, ToolGeometry):
        found = half_sizes(tool.solid)
        assert found is not None
        (kind, half), place = found, [0.0, 0.0, tool.middle]
    else:
        kind, half, place = overlap.BALL, (tool, tool, tool), on.pos
    marker = _marker(on.parent, f"{_MARKER}{pair}|tool", place, [1.0, 0.0, 0.0, 0.0])
    collision.mark_tool(marker, kind, half, rounding(half))
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
