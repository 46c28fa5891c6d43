"""`robot.servo`: how the robot's own controller follows what its joints are commanded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taskspec.spec.control import FASTEST, SLOWEST, USUAL, Control
from taskspec.spec.model import Model, mapping
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import Constant, ForJoints
from taskspec.spec.words import Free, Texts
from taskspec.text.data import Map
from taskspec.text.suggest import suggestion
from taskspec.text.units import (
    ANGULAR_ACCELERATION,
    ANGULAR_JERK,
    ANGULAR_STIFFNESS,
    ANGULAR_VELOCITY,
    FREQUENCY,
    NUMBER,
    TIME,
    scaled,
    show,
)

TORQUE: Literal["torque"] = "torque"
VELOCITY, POSITION = "velocity", "position"
COMMANDS = (TORQUE, VELOCITY, POSITION)
"""What the joints of an arm may be commanded."""
PLURALS = MappingProxyType({TORQUE: "torques", VELOCITY: "velocities", POSITION: "positions"})


def command_of(data: Map) -> str:
    """What the joints are commanded by a raw task; torques where it says nothing that reads."""
    command = mapping(data.get("robot")).get("command", TORQUE)
    return str(command) if command in COMMANDS else TORQUE


#: By which part a rate may be off a whole multiple.
_ROUNDING = 1e-9
Joints = tuple[float, ...]


class Servo(Model):
    """The joint servo of an arm that is commanded by velocity or by position.

    Attributes:
        about: in a few words; None for none.
        bandwidth: natural frequency of the reference that it makes of commands [Hz].
        damping: ratio of that reference and of what holds the joints to it.
        delay: from the controller's output to where the servo takes it [s].
        rate: of the servo [Hz]; a whole multiple of the controller's that divides the plant's.
        velocity, acceleration, jerk: the most of its reference [rad or m, s]: one for all, or one
            for each; None for no limit, of velocity for that of the robot's file.
        stiffness: of the drive, the torque for a joint that is off its reference [N*m/rad]: one for
            all, or one for each; None for what the bandwidth makes of the arm's inertia.
        sources: where numbers come from, by their keys; what is not named is an assumption.
    """

    noun = "a servo"
    example = "servo: {bandwidth: 20 Hz, delay: 4 ms}"
    short: ClassVar = Free(filled=True).json()
    advice: ClassVar = (
        {"model": "a servo of that name is 'servo: NAME'; of another one give all numbers"}
        | dict.fromkeys(("latency", "dead_time"), "what comes late is its 'delay'")
        | dict.fromkeys(("gain", "lookahead_time"), "what they make of it is 'bandwidth', 'delay'")
    )

    about: Annotated[str, Free()] | None = Field(None, title="About")
    bandwidth: Annotated[float, Constant(FREQUENCY, above=0, most=FASTEST)] = Field(
        20.0, title="Bandwidth", description="Natural frequency of how it follows commands"
    )
    damping: Annotated[float, Constant(NUMBER, least=0.1, most=10.0)] = Field(
        1.0, title="Damping ratio"
    )
    delay: Annotated[float, Constant(TIME, least=0, most=1.0)] = Field(
        0.004, title="Delay of commands", description="In whole ticks of the servo, the nearest"
    )
    rate: Annotated[float, Constant(FREQUENCY, least=SLOWEST, most=FASTEST)] = Field(
        USUAL,
        title="Rate of the servo",
        description="A whole multiple of the controller's rate that divides the plant's; by "
        "default the first from 1 kHz on",
    )
    velocity: Annotated[Joints, ForJoints(ANGULAR_VELOCITY, above=0)] | None = Field(
        None, title="Limit of velocity"
    )
    acceleration: Annotated[Joints, ForJoints(ANGULAR_ACCELERATION, above=0)] | None = Field(
        None, title="Limit of acceleration"
    )
    jerk: Annotated[Joints, ForJoints(ANGULAR_JERK, above=0)] | None = Field(
        None, title="Limit of jerk"
    )
    stiffness: Annotated[Joints, ForJoints(ANGULAR_STIFFNESS, above=0)] | None = Field(
        None, title="Stiffness of the drive"
    )
    sources: Annotated[dict[str, str], Texts("a source", "sources: {delay: measured}")] = Field(
        {}, title="Sources", description="Of its numbers, by their keys; others are assumptions"
    )

    @property
    def delay_ticks(self) -> int:
        """The delay in ticks of the servo, the nearest."""
        return round(self.delay * self.rate)

    @property
    def numbers(self) -> Mapping[str, float | Joints]:
        """The numbers that it has, by their keys [SI]."""
        values = {key: getattr(self, key) for key in NUMBERS}
        return {key: value for key, value in values.items() if value is not None}

    @property
    def written(self) -> Iterator[tuple[str, str]]:
        """Key and text of each number; one of joints that are alike stands once."""
        for key, values in self.numbers.items():
            each = values if isinstance(values, tuple) else (values,)
            shown = [scaled(float(value), self.dimension_of(key), 5) for value in each]
            yield key, ", ".join(shown[:1] if len(set(shown)) == 1 else shown)

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Reports sources of what is no number of a servo."""
        sources = mapping(data.get("sources"))
        for key in sources:
            if key not in NUMBERS:
                hint = suggestion(key, NUMBERS, "keys with a number")
                message = f"'{key}' is no number of a servo"
                context.error("TS020", message, sources.node.key_span(key), hint)


NUMBERS = tuple(key for key in Servo.model_fields if key not in ("about", "sources"))
"""Keys of a servo that hold numbers."""
VARIED = tuple(key for key in NUMBERS if key != "rate")
"""Those of them that may differ in truth."""


def settle_servo(servo: Servo, control: Control, data: Map, context: ParseContext) -> Servo:
    """The servo with its rate filled in; reports one that does not fit.

    Args:
        servo: as the file has it.
        control: with settled rates.
        data: the raw mapping of the servo, empty if the file has none.
        context: the pass.
    """
    steps = round(control.plant_rate / control.rate)
    fitting = [n * control.rate for n in range(1, steps + 1) if steps % n == 0]
    if "rate" not in data:
        usual = (rate for rate in fitting if rate >= USUAL * (1 - _ROUNDING))
        return servo.model_copy(update={"rate": next(usual, fitting[-1])})
    for rate in fitting:
        if abs(servo.rate - rate) <= _ROUNDING * rate:
            return servo.model_copy(update={"rate": rate})
    own, controller = show(servo.rate, "Hz"), show(control.rate, "Hz")
    if servo.rate < control.rate:
        message = f"the servo takes commands at {own}, the controller gives them at {controller}"
        hint = f"control: {{rate: {own}}}"
    else:
        message = (
            f"{own} is no whole multiple of the controller's {controller} that divides the plant's "
            f"{show(control.plant_rate, 'Hz')}"
        )
        near = ", ".join(show(rate, "Hz") for rate in fitting)
        hint = f"rates that fit: {near}; or choose another control.plant_rate"
    context.error("TS118", message, span_of(data["rate"]), hint)
    return servo
