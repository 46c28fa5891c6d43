"""`axes`: what each axis of the task frame does during a stage."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from taskspec.geometry.axis import AXES, Axis
from taskspec.spec.fields import MechanismName, SurfaceName
from taskspec.spec.model import Model, complete, short_form
from taskspec.spec.parse_context import ParseContext as Reading
from taskspec.spec.quantities import Constant, Formula
from taskspec.spec.words import Word
from taskspec.text.codes import register
from taskspec.text.data import Map, Text
from taskspec.text.expression import Expression, ScopeKind
from taskspec.text.nodes import pointer
from taskspec.text.units import (
    ANGLE,
    ANGULAR_DAMPING,
    ANGULAR_STIFFNESS,
    ANGULAR_VELOCITY,
    DAMPING,
    FORCE,
    LENGTH,
    MOMENT,
    STIFFNESS,
    TIME,
    VELOCITY,
)

register(
    {
        "TS201": "an axis without a mode",
        "TS202": "two motions on one axis",
        "TS204": "a key that does not belong to the axis's mode",
        "TS205": "a force on a rotation, or a torque on a translation",
    }
)

MOTIONS = ("hold", "position", "velocity", "move", "follows")
FORCES = ("force", "torque")
_BELONGS = {
    "speed": (("move",), "it is the speed of a 'move'"),
    "ramp": (FORCES, "it is the time in which a force or torque is reached"),
}
_STIFF = ("stiffness", "damping")

Hold = Annotated[Literal["start", "world"], Word(("start", "world"), "hold")]
Ramp = Annotated[float, Constant(TIME, least=0)]


class AxisEntry(Model):
    """One axis: one motion or one force; both only under a parallel law.

    Attributes:
        hold: `start` keeps the carried reference; `world` the world's orientation.
        position: [m, rad] in the frame.
        velocity: [m/s, rad/s].
        move: distance from the carried reference [m, rad].
        speed: of the move [m/s, rad/s]; None for the default.
        follows: the mechanism whose geometry couples the axis to the others.
        force: that the robot applies to the environment [N].
        torque: that the robot applies to the environment [N*m].
        ramp: time in which the force is reached [s]; None for the default.
        stiffness: of a soft motion axis [N/m, N*m/rad].
        damping: of a soft motion axis [N*s/m, N*m*s/rad].
        contact: the object that it presses on, or runs into; None for the one ahead.
    """

    noun = "an axis"
    example = "such as {hold: start} or {force: -15 N}"
    short: ClassVar = {"const": "hold"}
    foreign: ClassVar[str] = ""
    """The force that belongs to the other kind of axis."""

    hold: Hold | None = Field(None, title="Hold", description="start, or world")
    position: Expression | None = None
    velocity: Expression | None = None
    move: float | None = None
    speed: float | None = None
    follows: MechanismName | None = Field(
        None, title="Mechanism", description="Its geometry couples this axis to the others"
    )
    force: Expression | None = None
    torque: Expression | None = None
    ramp: Ramp | None = Field(None, title="Time in which the force is reached")
    stiffness: float | None = None
    damping: float | None = None
    contact: SurfaceName | None = Field(
        None, title="Object that the axis presses on", description="By default the one ahead"
    )

    @property
    def has_force(self) -> bool:
        """Whether it has a force or torque set point."""
        return self.force is not None or self.torque is not None

    @property
    def is_soft(self) -> bool:
        """Whether it is a motion axis with a stiffness or damping of its own."""
        return self.stiffness is not None or self.damping is not None

    @classmethod
    def expand(cls, data: object, reading: Reading) -> object:
        """Read `hold` as `{hold: start}`; report the force of the other kind of axis."""
        if isinstance(data, Text) and data == "hold":
            start = Text("start")
            start.node = data.node
            return short_form(start, "hold")
        if not (isinstance(data, Map) and cls.foreign in data):
            return data
        other, kind = ("torque", "rotation") if cls.foreign == "force" else ("force", "translation")
        span = data.node.key_span(cls.foreign)
        reading.error("TS205", f"a {cls.foreign} on a {kind}", span, f"write '{other}'")
        reading.quiet.add(id(data.node))
        rest = Map({key: value for key, value in data.items() if key != cls.foreign})
        rest.node = data.node
        return rest

    @classmethod
    def rules(cls, data: Map, reading: Reading) -> None:
        """Ask for one mode, and for keys that belong to it."""
        if data.get("hold") == "world" and cls.foreign == "torque":
            span = data.node.entries["hold"][1].span
            hint = "a translation holds the reference: write 'hold'"
            reading.error("TS204", "'world' holds an orientation, not a place", span, hint)
        motions = [key for key in MOTIONS if key in data]
        forces = [key for key in FORCES if key in data]
        if not motions and not forces and complete(data, reading):
            modes = "hold, position, velocity, move, follows, force or torque"
            reading.error("TS201", "an axis needs a mode", pointer(data.node), modes)
            return
        if len(motions) > 1:
            reading.error(
                "TS202",
                f"'{motions[0]}' and '{motions[1]}' on one axis",
                data.node.key_span(motions[1]),
                "keep one of the two",
            )
        for key, (modes_of, why) in _BELONGS.items():
            if key in data and not data.keys() & set(modes_of) and complete(data, reading):
                reading.error("TS204", f"'{key}' without {' or '.join(modes_of)}",
                              data.node.key_span(key), why)  # fmt: skip
        for key in _STIFF:
            if key in data and forces and not motions:
                hint = "a soft axis is a motion axis; a law's gains stand under 'law'"
                reading.error("TS204", f"'{key}' on a force axis", data.node.key_span(key), hint)


class Translation(AxisEntry):
    """A translation: lengths and forces."""

    foreign: ClassVar[str] = "torque"

    position: Annotated[Expression, Formula(LENGTH, ScopeKind.PLANNED)] | None = Field(
        None, title="Position"
    )
    velocity: Annotated[Expression, Formula(VELOCITY, ScopeKind.REFERENCE)] | None = Field(
        None, title="Velocity"
    )
    move: Annotated[float, Constant(LENGTH)] | None = Field(None, title="Distance to move")
    speed: Annotated[float, Constant(VELOCITY, above=0)] | None = Field(
        None, title="Speed of the move"
    )
    force: Annotated[Expression, Formula(FORCE, ScopeKind.REFERENCE)] | None = Field(
        None, title="Force", description="What the robot applies to the environment"
    )
    torque: None = Field(None, exclude=True)
    stiffness: Annotated[float, Constant(STIFFNESS, above=0)] | None = Field(
        None, title="Stiffness of a soft axis"
    )
    damping: Annotated[float, Constant(DAMPING, least=0)] | None = Field(
        None, title="Damping of a soft axis"
    )


class Rotation(AxisEntry):
    """A rotation: angles and moments."""

    foreign: ClassVar[str] = "force"

    position: Annotated[Expression, Formula(ANGLE, ScopeKind.PLANNED)] | None = Field(
        None, title="Angle"
    )
    velocity: Annotated[Expression, Formula(ANGULAR_VELOCITY, ScopeKind.REFERENCE)] | None = Field(
        None, title="Rate of turn"
    )
    move: Annotated[float, Constant(ANGLE)] | None = Field(None, title="Angle to turn")
    speed: Annotated[float, Constant(ANGULAR_VELOCITY, above=0)] | None = Field(
        None, title="Speed of the turn"
    )
    force: None = Field(None, exclude=True)
    torque: Annotated[Expression, Formula(MOMENT, ScopeKind.REFERENCE)] | None = Field(
        None, title="Moment", description="What the robot applies to the environment"
    )
    stiffness: Annotated[float, Constant(ANGULAR_STIFFNESS, above=0)] | None = Field(
        None, title="Stiffness of a soft axis"
    )
    damping: Annotated[float, Constant(ANGULAR_DAMPING, least=0)] | None = Field(
        None, title="Damping of a soft axis"
    )


class AxesForm(Model):
    """The six axes of the task frame; those not named hold."""

    noun = "axes"

    x: Translation | None = Field(None, title="Translation along x")
    y: Translation | None = Field(None, title="Translation along y")
    z: Translation | None = Field(None, title="Translation along z")
    rx: Rotation | None = Field(None, title="Rotation about x")
    ry: Rotation | None = Field(None, title="Rotation about y")
    rz: Rotation | None = Field(None, title="Rotation about z")


class ByName:
    """Reads the form with six fields and yields a dict of the axes that are named."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        form = handler.generate_schema(AxesForm)
        named = core_schema.no_info_after_validator_function(_named, form)
        # A dict that is made in Python passes as it is.
        return core_schema.with_info_wrap_validator_function(_unless_final, named)


def _named(form: AxesForm) -> dict[Axis, AxisEntry]:
    return {name: entry for name in AXES if (entry := getattr(form, name))}


def _unless_final(
    value: Any, handler: core_schema.ValidatorFunctionWrapHandler, info: core_schema.ValidationInfo
) -> Any:
    return value if info.context is None else handler(value)
