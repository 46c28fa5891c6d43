"""`world`: the objects that the robot may touch."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taskspec.spec.fields import RPY, XYZ
from taskspec.spec.model import Model
from taskspec.spec.quantities import Constant, Entries
from taskspec.spec.reading import Reading
from taskspec.spec.sizes import check_sizes
from taskspec.spec.words import Word
from taskspec.text.data import Map
from taskspec.text.units import DAMPING, LENGTH, NUMBER, STIFFNESS

ShapeName = Literal["plane", "box", "cylinder", "sphere"]

_LATER = ("equation", "mechanism")


class Shape(Model):
    """An object: a shape at a place, with the contact that it makes.

    Attributes:
        shape: `plane` (z = 0, outward normal z), `box`, `cylinder` (axis z) or `sphere`.
        xyz: position in the world [m].
        rpy: orientation in the world [rad].
        size: full edges of a box [m].
        radius: of a cylinder or sphere [m].
        length: of a cylinder [m].
        stiffness: of the whole contact [N/m], or `rigid`.
        damping: of the whole contact [N*s/m]; None for 0.1 * 2 * sqrt(stiffness * 1 kg).
        friction: Coulomb's coefficient.
    """

    noun = "an object"
    example = "table: {shape: plane, xyz: [0, 0, 300 mm]}"
    reserved = frozenset(
        {"equation", "frame", "mechanism", "handle", "knob", "inertia", "stop", "detent", "pitch"}
        | {"motion", "free", "mass", "angle", "depth", "chamfer"}
    )
    sizes: ClassVar[dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
        "plane": ((), ()),
        "box": (("size",), ()),
        "cylinder": (("radius", "length"), ()),
        "sphere": (("radius",), ()),
    }

    shape: Annotated[
        ShapeName,
        Word(("plane", "box", "cylinder", "sphere"), "shape", reserved=("groove", "hole")),
    ] = Field(title="Shape")
    xyz: XYZ = Field((0.0, 0.0, 0.0), title="Position in the world", description="[x, y, z]")
    rpy: RPY = Field((0.0, 0.0, 0.0), title="Orientation", description="[roll, pitch, yaw]")
    size: Annotated[tuple[float, float, float], Entries((LENGTH,) * 3, above=0)] | None = Field(
        None, title="Full edges of a box"
    )
    radius: Annotated[float, Constant(LENGTH, above=0)] | None = Field(None, title="Radius")
    length: Annotated[float, Constant(LENGTH, above=0)] | None = Field(
        None, title="Length of a cylinder"
    )
    stiffness: Annotated[
        float | Literal["rigid"], Constant(STIFFNESS, above=0, words=("rigid",))
    ] = Field(20e3, title="Stiffness of the whole contact")
    damping: Annotated[float, Constant(DAMPING, least=0)] | None = Field(
        None, title="Damping of the whole contact"
    )
    friction: Annotated[float, Constant(NUMBER, least=0)] = Field(
        0.0, title="Coefficient of friction"
    )

    @classmethod
    def expand(cls, data: object, reading: Reading) -> object:
        """Report an object of a kind that comes later, and look no further into it."""
        if not isinstance(data, Map):
            return data
        later = [key for key in _LATER if key in data]
        shape = data.get("shape")
        if not later and shape not in ("groove", "hole"):
            return data
        reading.quiet.add(id(data.node))
        rest = Map({key: data[key] for key in later[:1] or ["shape"]})
        rest.node = data.node
        return rest

    @classmethod
    def rules(cls, data: Map, reading: Reading) -> None:
        """Ask for the sizes of the shape."""
        check_sizes("object", data.get("shape"), cls.sizes, data, reading)
