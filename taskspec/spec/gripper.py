"""`robot.gripper`: two jaws at the tool tip; `grip` and `release`: what a stage commands them."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import MECHANISMS
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import Constant
from taskspec.spec.words import NameReference, Word
from taskspec.text.codes import register
from taskspec.text.data import Text, TruthValue
from taskspec.text.units import FORCE, LENGTH, VELOCITY

register({"TS144": "something that no gripper holds"})

REPORTED = ("grip.force", "grip.slip")
"""What a gripper reports: the signals, in the order of `Machine.reactions`."""
ALL = ""
"""What is released where a stage names no object."""


def _instead(name: str, context: ParseContext) -> str:
    """What to write for an object that exists but lies nowhere loose."""
    if name in context.of_kind("shape"):
        return f"{name!r} stands where it is; a loose body has 'free: true' and a mass"
    if name not in context.of_kind(*MECHANISMS):
        return ""
    return f"a gripper holds loose bodies; a mechanism is held from the start: robot.grasp: {name}"


LOOSE = NameReference(
    lambda r: r.loose,
    "loose body",
    "TS144",
    "loose bodies",
    "'{}' is no loose body",
    _instead,
)


class Released(FieldType):
    """`true`, or the loose body that is let go."""

    def read(self, value: object, context: ParseContext) -> str:
        """Its name; `ALL` for whatever is held."""
        if isinstance(value, TruthValue):
            if not value.value:
                hint = "leave 'release' out where nothing is let go"
                context.error("TS022", "'release: false' says nothing", span_of(value), hint)
            return ALL
        if not isinstance(value, Text):
            message = f"'true' or a loose body is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "release: true")
            return ALL
        return LOOSE.read(value, context)

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        return {"anyOf": [{"const": True}, LOOSE.json()]}


class Gripper(Model):
    """Two parallel jaws at the tool tip, driven alike by one motor.

    Attributes:
        axis: of the tool, along which they close.
        stroke: distance between the open jaws [m].
        speed: at which that distance shrinks and grows [m/s].
        force: the most that each jaw presses with [N].
        pad: radius of the round pads [m].
    """

    noun = "a gripper"
    example = "gripper: {axis: y, stroke: 80 mm, force: 70 N}"
    advice: ClassVar = {
        "friction": "pads have the friction of what they hold: world.NAME.friction",
        "stiffness": "pads have the stiffness of what they hold: world.NAME.stiffness",
        "width": "the distance between its open jaws is its 'stroke'",
    }

    axis: Annotated[Literal["x", "y"], Word(("x", "y"), "axis")] = Field(
        "y", title="Axis of the tool along which the jaws close"
    )
    stroke: Annotated[float, Constant(LENGTH, above=0)] = Field(
        0.08, title="Distance between the open jaws"
    )
    speed: Annotated[float, Constant(VELOCITY, above=0)] = Field(
        0.1, title="At which that distance changes"
    )
    force: Annotated[float, Constant(FORCE, above=0)] = Field(
        70.0, title="The most that each jaw presses with"
    )
    pad: Annotated[float, Constant(LENGTH, above=0)] = Field(0.008, title="Radius of the pads")

    @property
    def row(self) -> int:
        """Row of its axis in the tool's axes."""
        return 0 if self.axis == "x" else 1


class GripCommand(Model):
    """Closes the gripper on a loose body.

    Attributes:
        object: it.
        force: with which each jaw presses [N].
    """

    noun = "a grip"
    example = "grip: {object: cap, force: 20 N}"
    advice: ClassVar = {
        "mass": "the body has its mass in 'world'",
        "width": "the jaws close until they touch",
    }

    object: Annotated[str, LOOSE] = Field(title="The loose body")
    force: Annotated[float, Constant(FORCE, above=0)] = Field(title="With which each jaw presses")
