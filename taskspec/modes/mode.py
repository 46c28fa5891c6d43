"""The mode of an axis: its keys, its reference, its hand-over, its nominal motion, its words.

A mode that a file gives is made of the values of its keys. A reference is written on CasADi
expressions, nominal motion on numbers. A hand-over is written on both: it is part of the function
that enters a stage, and of what is predicted.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.motion import blend

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis
    from taskspec.modes.coupling import Coupling
    from taskspec.modes.force import Force
    from taskspec.modes.key import Misuse, ModeKey
    from taskspec.modes.stage import PlannedStage, StageClock, StageSlots, TrackedAngle
    from taskspec.motion.polynomial import PiecewiseCubic

#: A number, or an expression of what is known when a stage is entered.
Number = Any
#: Displacement [m, rad] against time [s].
Displacement = Callable[[float], float]
#: What an expression is worth before a run, at given clocks; None where it is unknown.
Known = Callable[[Expression, Mapping[str, float] | None], float | None]

#: Speed of a motion along or about an axis that names none [m/s, rad/s] (docs/language/axes.md).
MOVE_SPEED = {"linear": 0.05, "angular": math.radians(30.0)}


def move_speed(*, rotation: bool) -> float:
    """Speed of a motion along or about an axis that names none [m/s, rad/s]."""
    return MOVE_SPEED["angular" if rotation else "linear"]


# What a reference is built from


class MovingReference(Protocol):
    """The reference of another axis, as far as one that depends on it needs to know.

    Attributes:
        value: r [m, rad].
        rate: r' [m/s, rad/s].
        acceleration: r'' [m/s^2, rad/s^2].
        released: the part of r that stands for a force which the last stage held [m, rad].
    """

    @property
    def value(self) -> ca.SX: ...  # noqa: D102
    @property
    def rate(self) -> ca.SX: ...  # noqa: D102
    @property
    def acceleration(self) -> ca.SX: ...  # noqa: D102
    @property
    def released(self) -> ca.SX: ...  # noqa: D102


class Translate(Protocol):
    """Makes CasADi of an expression of the file."""

    def __call__(  # noqa: D102
        self, expression: Expression, coordinates: Mapping[str, ca.SX] = ..., /
    ) -> ca.SX: ...


@dataclass(frozen=True, slots=True)
class ReferenceInputs:
    """The inputs of the reference of an axis.

    Attributes:
        axis: whose it is.
        plan: of the stage.
        clock: of the stage.
        parameters: where it takes slots for numbers that are chosen at the stage start.
        memory: where it takes slots for what it memorises.
        translate: makes CasADi of an expression of the file.
        period: of the controller [s].
        start: slot for where the axis starts [m, rad]; see `HandOver.start`.
        on_path: coordinates of the axes that the stage's path drives [m, rad].
        forces: set points of the stage's axes, as the robot applies them [N, N m].
        tracked: the mechanism that the stage keeps track of; None for none.
        others: references of the axes that are built before.
        measured: coordinate of an axis as it is measured, with its rate.
        from_rest: time of the references that start from rest in a time of their own [s].
    """

    axis: Axis
    plan: PlannedStage
    clock: StageClock
    parameters: StageSlots
    memory: StageSlots
    translate: Translate
    period: float
    start: ca.SX
    on_path: Mapping[Axis, ca.SX]
    forces: Mapping[Axis, ca.SX]
    tracked: TrackedAngle | None
    others: Mapping[Axis, MovingReference]
    measured: Callable[[Axis], MovingReference]
    from_rest: ca.SX

    def leader(self, axis: Axis) -> MovingReference:
        """What another axis follows of one: its reference, or without any what is measured."""
        return self.others[axis] if self.plan.plans[axis].leads else self.measured(axis)

    def in_time(self, value: ca.SX) -> OwnReference:
        """A reference that is an expression of time, with its rates."""
        rate = self.clock.rate(value)
        return OwnReference(value, rate, self.clock.rate(rate))


@dataclass(frozen=True, slots=True)
class OwnReference:
    """The reference of a mode before anything is blended in.

    Attributes:
        value: r [m, rad].
        rate: r' [m/s, rad/s].
        acceleration: r'' [m/s^2, rad/s^2].
        memory: what it memorises of this tick, by slot.
    """

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    memory: Mapping[str, ca.SX] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Blending:
    """The part that is added to a mode's reference after a stage start and fades out.

    Attributes:
        value: of what continues the reference that is handed over [m, rad].
        rate: [m/s, rad/s].
        acceleration: [m/s^2, rad/s^2].
        released: the displacement that stands for a force that the last stage held [m, rad].
    """

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    released: ca.SX


# What is handed over


@dataclass(frozen=True, slots=True)
class StageStart:
    """The state of an axis at a stage start, in numbers or expressions.

    Attributes:
        axis: which.
        plan: of the stage.
        starts: coordinates of the reference that is handed over, by axis [m, rad].
        rates: its rates [m/s, rad/s].
        pressed: displacement that stands for the force which the last stage held [m, rad].
        own: the mode's own reference at t = 0, with `start` at 0 [m, rad].
        own_rate: its rate [m/s, rad/s].
    """

    axis: Axis
    plan: PlannedStage
    starts: Mapping[Axis, Number]
    rates: Mapping[Axis, Number]
    pressed: Number
    own: Number
    own_rate: Number

    @property
    def start(self) -> Number:
        """Coordinate of the reference that is handed over [m, rad]."""
        return self.starts[self.axis]

    @property
    def rate(self) -> Number:
        """Rate of the reference that is handed over [m/s, rad/s]."""
        return self.rates[self.axis]


@dataclass(frozen=True, slots=True)
class HandOver:
    """The hand-over of a mode's reference from the one before.

    r(t) = own(t) + `motion.blend.added`(t, offset, slope, time) + pressed s_0(t/BLEND_TIME).

    Attributes:
        offset: from the mode's reference to where the one that is handed over comes to rest
            [m, rad].
        slope: of its rate [m/s, rad/s].
        time: in which the offset fades out [s].
        pressed: displacement that stands for a force that is released [m, rad].
        parameters: other slots to fill, such as where the reference starts.
        wait: before a reference with a time of its own starts [s].
    """

    offset: Number
    slope: Number
    time: Number
    pressed: Number
    parameters: Mapping[str, Number] = field(default_factory=dict)
    wait: Number = 0.0

    def added(self, t: float) -> float:
        """The added displacement at stage time t [s], without the pressed part [m, rad]."""
        more: float = blend.added(t, self.offset, self.slope, self.time)
        return more


def from_start(at: StageStart, own_rate: Number | None = None) -> HandOver:
    """Hand-over of a reference that counts from where the stage starts.

    It starts where the rate that is handed over runs out, so that nothing goes back.

    Args:
        at: the stage start.
        own_rate: the mode's rate then, where its expression does not determine it [m/s, rad/s].
    """
    slope = at.rate - (at.own_rate if own_rate is None else own_rate)
    parameters = {f"start.{at.axis}": at.start + slope * blend.BLEND_TIME / 2}
    return HandOver(0.0, slope, blend.BLEND_TIME, at.pressed, parameters)


def to_coordinate(at: StageStart) -> HandOver:
    """Hand-over of a reference that is a coordinate of the frame: it is gone to, at most as fast
    as a move.

    One with a time of its own waits at its start until it is reached. Any other goes on
    meanwhile, and is caught up with.
    """  # noqa: D205
    slope, speed = at.rate - at.own_rate, move_speed(rotation=at.axis.is_rotation)
    offset = at.start - at.own + slope * blend.BLEND_TIME / 2
    time = blend.blend_time(offset, speed)
    if at.axis not in at.plan.from_rest:
        return HandOver(offset, slope, ca.fmax(time, blend.CATCH_UP * (slope != 0)), at.pressed)
    wait = time * (ca.fabs(offset) > blend.NEGLIGIBLE * speed)
    return HandOver(offset, slope, time, at.pressed, wait=wait)


# The modes


@dataclass(frozen=True, slots=True)
class AxisMode(ABC):
    """The source of the reference of an axis, and all that depends on it.

    A subclass is a mode; in addition to these attributes it takes the values of its keys by their
    names, None for a companion that is left out. What it does not state follows from the base.

    Attributes:
        rotation: whether it is of a rotation.
        name: in messages.
        keys: in a file: its own, then its companions.
        word: value of its own key where a file writes the name of the mode alone; empty where that
            is no short form.
        moves: whether it commands a motion.
        ends: whether it comes to an end, so that a stage may last until then.
        travels: whether it goes away from where it starts, in one direction.
        goes_on: whether it keeps its rate for as long as the stage lasts.
        placed: whether its value is a coordinate of the frame.
        bends: whether its rate changes meanwhile.
        leads: whether another axis may follow its reference.
        lets_go: whether nothing holds it: laws without a force loop give it no stiffness.
    """

    rotation: bool

    name: ClassVar[str]
    keys: ClassVar[tuple[ModeKey, ...]] = ()
    word: ClassVar[str] = ""
    moves: ClassVar[bool] = True
    ends: ClassVar[bool] = False
    travels: ClassVar[bool] = False
    goes_on: ClassVar[bool] = False
    placed: ClassVar[bool] = False
    bends: ClassVar[bool] = False
    leads: ClassVar[bool] = True
    lets_go: ClassVar[bool] = False

    # What files may say

    @classmethod
    def of_keys(cls, values: Mapping[str, Any], *, rotation: bool) -> AxisMode:
        """The mode of the values of its keys in a file, None for a companion that is left out."""
        return cls(rotation, **values)

    @classmethod
    def misuse(cls, data: Mapping[str, Any], *, rotation: bool) -> Misuse | None:  # noqa: ARG003
        """What an axis of a file cannot mean, although each value for itself is right."""
        return None

    def expressions(self) -> Iterator[tuple[Expression, bool]]:
        """Its expressions, and whether each is a position, of which rates are taken."""
        yield from ()

    @property
    def set_point(self) -> Force | None:
        """The force set point that it is; None where it is a motion."""
        return None

    # What the controller is built of

    @abstractmethod
    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r, r' and r'' before blending, and what is memorised."""

    def blended(self, own: OwnReference, added: Blending) -> tuple[ca.SX, ca.SX, ca.SX]:
        """r, r' and r'' with what the stage start adds."""
        return (
            own.value + added.value + added.released,
            own.rate + added.rate,
            own.acceleration + added.acceleration,
        )

    @abstractmethod
    def hand_over(self, at: StageStart) -> HandOver:
        """The hand-over of its reference from the one before."""

    def track(self, start: Number, rate: Number) -> PiecewiseCubic | None:  # noqa: ARG002
        """The cubics that its reference runs through, which fill its slot `segment`.

        They are expressions where start and rate are.

        Args:
            start: coordinate that is handed over [m, rad].
            rate: its rate [m/s, rad/s].
        """
        return None

    @property
    def leaders(self) -> tuple[Axis, ...]:
        """The axes of which its reference is an expression."""
        return ()

    def coupling(self, stage: PlannedStage, axis: Axis) -> Coupling | None:  # noqa: ARG002
        """How a mechanism couples it to the other axes of a stage; None where none does.

        Raises:
            UncoupledError: the mechanism's geometry gives no motion of this axis.
        """
        return None

    @property
    def own_time(self) -> bool:
        """Whether its reference is of the stage's time alone, so that it may start from rest."""
        return False

    @property
    def world(self) -> bool:
        """Whether it holds an orientation against the world."""
        return False

    @property
    def loop(self) -> tuple[object, ...]:
        """What of it the stability of the closed loop depends on."""
        return ()

    # Its nominal motion

    def constant_rate(self, known: Known) -> float | None:  # noqa: ARG002
        """Rate that it has all the time [m/s, rad/s]; None where that changes, or is not known."""
        return None

    def reached_rate(self, known: Known) -> float | None:
        """Rate that it is given in a file and reaches [m/s, rad/s]; None for none."""
        return self.constant_rate(known)

    def settled_rate(self, known: Known) -> float | None:
        """Rate that it has once nothing of it changes [m/s, rad/s]; None where that never is."""
        return self.constant_rate(known)

    def intended_rate(self, known: Known) -> float | None:
        """Rate over most of its displacement [m/s, rad/s]; None where that is not known."""
        return self.constant_rate(known)

    def heading(self, known: Known) -> float | None:  # noqa: ARG002
        """A number with the sign of the direction in which it goes; None where it is unknown."""
        return None

    def displacement(self, known: Known, start: float) -> Displacement | None:  # noqa: ARG002
        """Displacement of its own reference against its time, where it has no track.

        None where that is not known.

        Args:
            known: values of expressions.
            start: coordinate at the stage start [m, rad].
        """
        return None

    def duration(self, rate: float) -> float | None:
        """How long its track takes from a rate [m/s, rad/s] to rest [s]; None without one."""
        planned = self.track(0.0, rate)
        return None if planned is None else float(planned.rests)

    @property
    def distance(self) -> tuple[float, float] | None:
        """How far it goes [m, rad] and how fast [m/s, rad/s]; None where it has no end."""
        return None

    @property
    def pace(self) -> str:
        """The key that decides how fast it goes; empty for none."""
        return self.keys[0].name if self.keys and self.moves else ""

    # In words

    @abstractmethod
    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:
        """The artificial constraint in words; empty where there is none.

        Args:
            axis: which.
            rate: symbol of its rate.
            turns: whether its frame turns meanwhile.
        """

    def defaults(self, axis: Axis) -> Iterator[tuple[str, str]]:  # noqa: ARG002
        """Keys that a file leaves out, and what stands in their place."""
        yield from ()
