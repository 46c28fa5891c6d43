"""`world`: mechanisms that the robot turns, pulls or screws by their handle."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from taskspec.shapes import SHAPES
from taskspec.spec import values
from taskspec.spec.alias import Direction
from taskspec.spec.fields import MECHANISMS, RPY, XYZ
from taskspec.spec.gripper import LOOSE
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, IntervalAroundZero
from taskspec.spec.words import Word
from taskspec.text.data import Map
from taskspec.text.units import (
    ANGLE,
    ANGULAR_DAMPING,
    DAMPING,
    FORCE,
    INERTIA,
    LENGTH,
    MASS,
    MOMENT,
)

Knob = Literal["free", "fixed"]


def _word(kind: str) -> Word:
    """The word of one kind of mechanism, which knows the other two."""
    return Word((kind,), "mechanism", others=tuple(k for k in MECHANISMS if k != kind))


class Detent(Model):
    """A snap: it resists before `at` and pulls along after it.

    The generalised force on the mechanism is F sin(pi (s - at) / width) for |s - at| < width.

    Attributes:
        at: coordinate of the snap [rad or m].
        force: greatest moment or force, F [N*m or N].
        width: to either side of `at` [rad or m].
    """

    noun = "a detent"

    at: float
    force: float
    width: float


class AngularDetent(Detent):
    """A snap of a hinge or a screw."""

    at: Annotated[float, Constant(ANGLE)] = Field(title="Angle of the snap")
    force: Annotated[float, Constant(MOMENT, above=0)] = Field(title="Greatest moment")
    width: Annotated[float, Constant(ANGLE, above=0)] = Field(title="To either side")


class LinearDetent(Detent):
    """A snap of a slide."""

    at: Annotated[float, Constant(LENGTH)] = Field(title="Travel of the snap")
    force: Annotated[float, Constant(FORCE, above=0)] = Field(title="Greatest force")
    width: Annotated[float, Constant(LENGTH, above=0)] = Field(title="To either side")


class Mechanism(Model):
    """One degree of freedom about or along z of its own axes, with a handle.

    Its coordinate is 0 as declared.

    Attributes:
        mechanism: `hinge` turns about z, `slide` goes along z, `screw` does both.
        xyz: position of its axes in the world [m].
        rpy: orientation of its axes in the world [rad].
        handle: the handle in its own axes at coordinate 0 [m].
        knob: `free` turns on the handle about an axis parallel to z; `fixed` does not.
        damping: viscous [N*m*s/rad, N*s/m].
        friction: Coulomb's, as a moment or a force [N*m, N].
        stop: least and greatest coordinate [rad, m]; None for none.
        detent: a snap.

    A hinge has an `inertia` about its axis [kg*m^2], a slide a `mass` [kg], a screw both and a
    `pitch`, its travel along z per angle [m/rad].
    """

    noun = "a mechanism"
    example = "crank: {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0]}"
    aliases: ClassVar = {"axis": Direction(), "normal": Direction()}
    advice: ClassVar = (
        dict.fromkeys(
            ("held", "grasped", "grasp"), "what the robot holds stands at robot.grasp: NAME.handle"
        )
        | dict.fromkeys(
            ("range", "travel", "angle", "limits", "limit", "lower", "upper"),
            "the coordinates between which it moves are its 'stop', such as stop: 0..300 mm",
        )
        | dict.fromkeys(
            ("radius", "arm", "lever"),
            "how far the handle is from the axis stands in 'handle', such as [120 mm, 0, 0]",
        )
    )
    coordinate: ClassVar[str] = "angle"

    mechanism: str
    xyz: XYZ = Field((0.0, 0.0, 0.0), title="Position in the world", description="[x, y, z]")
    rpy: RPY = Field((0.0, 0.0, 0.0), title="Orientation", description="[roll, pitch, yaw]")
    handle: XYZ = Field(
        (0.0, 0.0, 0.0), title="Handle", description="[x, y, z] in its own axes, at coordinate 0"
    )
    knob: Annotated[Knob, Word(("free", "fixed"), "knob")] = Field(
        "fixed", title="Knob", description="free turns on the handle, fixed does not"
    )
    damping: float = 0.0
    friction: float = 0.0
    stop: tuple[float, float] | None = None
    detent: Detent | None = None

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:
        """Reads no further into a mechanism of an unknown kind, or one that is a shape as well."""
        if not isinstance(data, Map):
            return data
        kind = data.get("shape")
        if isinstance(kind, str) and kind in MECHANISMS and "mechanism" not in data:
            message, span = f"a {kind} is no shape but a mechanism", data.node.key_span("shape")
            context.error("TS025", message, span, f"write mechanism: {kind}")
            renamed = Map({"mechanism" if k == "shape" else k: v for k, v in data.items()})
            renamed.node = data.node
            return renamed
        if "shape" in data:
            context.error(
                "TS026",
                "an object has a 'shape' or a 'mechanism', not both",
                data.node.key_span("shape"),
                "give the shape an object of its own",
            )
        elif data.get("mechanism", "") in MECHANISMS:
            return data
        elif (kind := data.get("mechanism")) in SHAPES:
            message, span = f"a {kind} is no mechanism but a shape", data.node.key_span("mechanism")
            context.error("TS025", message, span, f"write shape: {kind}")
            context.quiet.add(id(data.node))
            rest = Map()
            rest.node = data.node
            return rest
        context.quiet.add(id(data.node))
        rest = Map({key: value for key, value in data.items() if key == "mechanism"})
        rest.node = data.node
        return rest

    @property
    def lead(self) -> float:
        """Travel along z per angle about it [m/rad]; 0 for a hinge or slide."""
        return 0.0

    @property
    def kind(self) -> str:
        """The kind of its signals."""
        return self.mechanism

    @property
    def angular(self) -> bool:
        """Whether its coordinate is an angle."""
        return self.mechanism != "slide"

    @property
    def coordinate_inertia(self) -> float:
        """What resists to its coordinate [kg m^2, kg]."""
        inertia, mass = getattr(self, "inertia", 0.0), getattr(self, "mass", 0.0)
        return float(inertia + mass * (self.lead**2 if self.angular else 1.0))


class _Turning(Mechanism):
    damping: Annotated[float, Constant(ANGULAR_DAMPING, least=0)] = Field(0.0, title="Damping")
    friction: Annotated[float, Constant(MOMENT, least=0)] = Field(0.0, title="Friction")
    stop: Annotated[tuple[float, float], IntervalAroundZero(ANGLE)] | None = Field(
        None, title="Stop"
    )
    detent: AngularDetent | None = Field(None, title="Detent")


class Hinge(_Turning):
    """A mechanism that turns about its z."""

    noun = "a hinge"

    mechanism: Annotated[Literal["hinge"], _word("hinge")] = Field(title="Kind")
    inertia: Annotated[float, Constant(INERTIA, above=0)] = Field(0.01, title="Inertia")


class Slide(Mechanism):
    """A mechanism that goes along its z."""

    noun = "a slide"

    coordinate: ClassVar[str] = "travel"

    mechanism: Annotated[Literal["slide"], _word("slide")] = Field(title="Kind")
    mass: Annotated[float, Constant(MASS, above=0)] = Field(1.0, title="Mass")
    damping: Annotated[float, Constant(DAMPING, least=0)] = Field(0.0, title="Damping")
    friction: Annotated[float, Constant(FORCE, least=0)] = Field(0.0, title="Friction")
    stop: Annotated[tuple[float, float], IntervalAroundZero(LENGTH)] | None = Field(
        None, title="Stop"
    )
    detent: LinearDetent | None = Field(None, title="Detent")


class Pitch(Constant):
    """Travel per angle; a length is that of one turn, as the pitch of a thread is given."""

    def read(self, value: object, context: ParseContext) -> float:
        """The travel per angle [m/rad]."""
        if values.measures(value, LENGTH, context):
            return float(Constant(LENGTH).read(value, context)) / math.tau
        return float(super().read(value, context))


class Screw(_Turning):
    """A mechanism that turns about its z and goes along it."""

    noun = "a screw"
    example = "bolt: {mechanism: screw, pitch: 2 mm/turn}"

    mechanism: Annotated[Literal["screw"], _word("screw")] = Field(title="Kind")
    inertia: Annotated[float, Constant(INERTIA, above=0)] = Field(0.001, title="Inertia")
    mass: Annotated[float, Constant(MASS, above=0)] = Field(0.1, title="Mass")
    pitch: Annotated[float, Pitch(LENGTH / ANGLE)] = Field(
        title="Pitch", description="Travel along z in one turn, such as 2 mm/turn"
    )
    takes: Annotated[str, LOOSE] | None = Field(
        None,
        title="The loose body that is screwed on",
        description="Its centre is at the origin as the thread catches it",
    )

    @property
    def lead(self) -> float:
        """Travel along z per angle about it [m/rad]."""
        return self.pitch


OF_KIND: dict[str, Any] = {"hinge": Hinge, "slide": Slide, "screw": Screw}
