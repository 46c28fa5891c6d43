"""`robot.protection`: where the robot's own controller stops, and what its sensor measures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar

from pydantic import Field

from taskspec.spec.model import Model, complete
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, ForJoints
from taskspec.spec.words import Free
from taskspec.text.data import Map
from taskspec.text.units import (
    ANGULAR_ACCELERATION,
    ANGULAR_JERK,
    ANGULAR_VELOCITY,
    FORCE,
    JERK,
    LINEAR_ACCELERATION,
    MOMENT,
    POWER,
    VELOCITY,
)

Joints = tuple[float, ...]


class Protected(Model):
    """Bounds of one text: each kind of bound has its group.

    Attributes:
        source: where its numbers come from; None for what the whole protection says.
    """

    source: Annotated[str, Free(filled=True)] | None = Field(
        None, title="Source", description="Where these numbers come from: a text, an address"
    )

    @property
    def given(self) -> Iterator[tuple[str, float | Joints]]:
        """The bounds that it has, by their keys [SI]."""
        for key in type(self).model_fields:
            value = getattr(self, key)
            if key != "source" and value is not None:
                yield key, value


class ProtectedJoints(Protected):
    """Bounds on each joint, of either sign; one for all joints, or one for each.

    Attributes:
        speed: [rad/s].
        acceleration: of its reference [rad/s^2].
        jerk: of its reference [rad/s^3].
        torque_rate: of its torque [N*m/s].
    """

    noun = "a protection's joints"
    example = "joints: {speed: 2 rad/s}"

    speed: Annotated[Joints, ForJoints(ANGULAR_VELOCITY, above=0)] | None = Field(
        None, title="Speed of a joint"
    )
    acceleration: Annotated[Joints, ForJoints(ANGULAR_ACCELERATION, above=0)] | None = Field(
        None, title="Acceleration of a joint"
    )
    jerk: Annotated[Joints, ForJoints(ANGULAR_JERK, above=0)] | None = Field(
        None, title="Jerk of a joint"
    )
    torque_rate: Annotated[Joints, ForJoints(POWER, above=0)] | None = Field(
        None, title="Rate of a joint's torque"
    )


class ProtectedTip(Protected):
    """Bounds on the tip's velocity and its derivatives: `speed`, `acceleration`, `jerk` [m, s]."""

    noun = "a protection's tip"
    example = "tip: {speed: 1.7 m/s}"

    speed: Annotated[float, Constant(VELOCITY, above=0)] | None = Field(
        None, title="Speed of the tip"
    )
    acceleration: Annotated[float, Constant(LINEAR_ACCELERATION, above=0)] | None = Field(
        None, title="Acceleration of the tip"
    )
    jerk: Annotated[float, Constant(JERK, above=0)] | None = Field(None, title="Jerk of the tip")


class ProtectedTurn(Protected):
    """Bounds on how the tool turns: `speed`, `acceleration`, `jerk` [rad, s]."""

    noun = "a protection's turn"
    example = "turn: {speed: 2.5 rad/s}"

    speed: Annotated[float, Constant(ANGULAR_VELOCITY, above=0)] | None = Field(
        None, title="Rate at which the tool turns"
    )
    acceleration: Annotated[float, Constant(ANGULAR_ACCELERATION, above=0)] | None = Field(
        None, title="Angular acceleration of the tool"
    )
    jerk: Annotated[float, Constant(ANGULAR_JERK, above=0)] | None = Field(
        None, title="Angular jerk of the tool"
    )


class Wrenches(Protected):
    """Bounds on the contact's wrench at the tip: norms of `force` [N] and `torque` [N*m]."""

    force: Annotated[float, Constant(FORCE, above=0)] | None = Field(None, title="Force")
    torque: Annotated[float, Constant(MOMENT, above=0)] | None = Field(None, title="Moment")


class Reflex(Wrenches):
    """From which external force and torque on the robot's own controller stops."""

    noun = "a protection's reflex"
    example = "reflex: {force: 40 N}"


class SensorRange(Wrenches):
    """The greatest force and torque that the force sensor measures."""

    noun = "a protection's sensor"
    example = "sensor: {force: 100 N, torque: 10 N*m}"


class Protection(Model):
    """Where a robot's own controller stops, each number with its source.

    Attributes:
        about: in a few words; None for none.
        source: of all groups that name none of their own.
        joints, tip, turn, reflex, sensor: the bounds; None for none.
        name: of the built-in protection, or of the file; empty where it stands in the task.
    """

    noun = "a protection"
    example = "protection: {source: data sheet, reflex: {force: 40 N}}"
    short: ClassVar = Free(filled=True).json()

    about: Annotated[str, Free()] | None = Field(None, title="About")
    source: Annotated[str, Free(filled=True)] | None = Field(
        None, title="Source", description="Of all numbers whose group names no source of its own"
    )
    joints: ProtectedJoints | None = Field(None, title="Joints")
    tip: ProtectedTip | None = Field(
        None, title="Tip", description="Along a line, in any direction"
    )
    turn: ProtectedTurn | None = Field(None, title="Turn", description="About any axis")
    reflex: Reflex | None = Field(
        None, title="Reflex", description="From where on the robot's own controller stops"
    )
    sensor: SensorRange | None = Field(
        None, title="Force sensor", description="The greatest that it measures"
    )

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Requires a bound, and the source of each."""
        if not complete(data, context):
            return
        groups = [key for key in GROUPS if key in data]
        if not groups:
            message = f"a protection needs a bound: one of {', '.join(GROUPS)}"
            context.error("TS021", message, context.key_of(data), cls.example)
        for key in groups:
            group = data[key]
            if not isinstance(group, Map) or not complete(group, context):
                continue
            if set(group) <= {"source"}:
                keys = [k for k in cls._group(key).model_fields if k != "source"]
                message = f"'{key}' needs a bound: one of {', '.join(keys)}"
                context.error("TS021", message, data.node.key_span(key))
            elif "source" not in group and "source" not in data:
                context.error(
                    "TS021",
                    f"the numbers of '{key}' need the key 'source'",
                    data.node.key_span(key),
                    "say where they come from: a data sheet, an address, a measurement",
                )

    @classmethod
    def _group(cls, key: str) -> type[Protected]:
        return GROUPS[key]

    @property
    def groups(self) -> Iterator[tuple[str, Protected]]:
        """The groups that it has, by their keys."""
        for key in GROUPS:
            group = getattr(self, key)
            if group is not None:
                yield key, group

    def source_of(self, group: Protected) -> str:
        """Where the numbers of a group come from."""
        return group.source or self.source or ""


GROUPS: dict[str, type[Protected]] = {
    "joints": ProtectedJoints,
    "tip": ProtectedTip,
    "turn": ProtectedTurn,
    "reflex": Reflex,
    "sensor": SensorRange,
}
"""What a protection is made of."""
