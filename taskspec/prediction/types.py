"""Predictions as data: SI values, signs as the file has them, axes of the stage's frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis

Vector = NDArray[np.float64]

#: Component of a varied value of the file -> its value there [SI], as `analysis.corners` has it.
Values = Mapping[tuple[str, int | None], float]

#: What a mode has come to after its settling time, as a share of where it began.
SETTLED = 0.02


@dataclass(frozen=True, slots=True)
class Extreme:
    """What becomes of a quantity in the world of `vary` that is worst for it.

    Attributes:
        value: there [SI].
        values: of that world; what makes no difference is left out.
    """

    value: float
    values: Values


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """A force or moment at rest, once ramps, blending and loops have settled.

    Attributes:
        signal: its name in the file: `force.z`, `torque.rx`, `rim.force`, `crank.torque`.
        value: what the robot applies [N, N m]; of a set point that moves, where it begins.
        low, high: between which it goes as its set point moves; both `value` where that stays.
        source: what it follows from, with the equation's number.
        worst: farthest from `value` in a world that `vary` allows; None where none changes it.
    """

    signal: str
    value: float
    low: float
    high: float
    source: str
    worst: Extreme | None = None

    @property
    def steady(self) -> bool:
        """Whether it stays where it is while the stage lasts."""
        return self.low == self.high


@dataclass(frozen=True, slots=True)
class Depth:
    """How far a contact is pressed in at the equilibrium.

    Attributes:
        on: the object or equation.
        push: what it bears [N, N m].
        depth: push / stiffness [m, rad].
        angular: on joints, so that it is an angle.
        worst: deepest in a world that `vary` allows.
        source: what it follows from.
    """

    on: str
    push: float
    depth: float
    angular: bool = False
    worst: Extreme | None = None
    source: str = "f / k"


@dataclass(frozen=True, slots=True)
class Settling:
    """How an axis comes to rest: by its slowest mode.

    Attributes:
        time_constant: in which it falls to 1/e [s]; infinite where it does not die away.
        frequency: of its swinging [Hz]; 0 where it does not swing.
        damping_ratio: of that mode.
    """

    time_constant: float
    frequency: float
    damping_ratio: float

    @property
    def settling_time(self) -> float:
        """Until it is within `SETTLED` of its end [s]."""
        return -math.log(SETTLED) * self.time_constant


@dataclass(frozen=True, slots=True)
class Impact:
    """A stage that meets its surface: a mass at a speed on a spring, v sqrt(h k).

    Attributes:
        contact: what it meets.
        axis: on which.
        speed: closing [m/s].
        mass: that strikes [kg].
        stiffness: of the contact [N/m].
        damping: of it [N s/m].
        drag: of a law whose damper acts on the velocity itself [N s/m]: its spring runs ahead by
            drag speed / stiffness and pushes on; 0 for other laws, None where it is not known.
        worst: in the world of `vary` with the stiffest contact.
        ended: the largest force by the time that the guard ends the stage [N]; None where it is
            not known when that holds.
    """

    contact: str
    axis: Axis
    speed: float
    mass: float
    stiffness: float
    damping: float
    drag: float | None = 0.0
    worst: Extreme | None = None
    ended: float | None = None

    @property
    def peak(self) -> float:
        """The largest force [N]: as if nothing but the contact's own damper took energy out."""
        return self.peak_on(self.stiffness)

    def peak_on(self, stiffness: float) -> float:
        """The same on a contact of another stiffness [N/m]."""
        struck = max(math.sqrt(self.mass * stiffness), self.damping)
        return self.speed * (struck + (self.drag or 0.0))

    @property
    def largest(self) -> float:
        """The largest force in the stage [N]: `ended`, or else the whole peak."""
        return self.peak if self.ended is None else self.ended

    def until(self, since: float) -> float:
        """The largest force up to a time after the touch [N], at least what the damper takes.

        Args:
            since: the touch [s].
        """
        phase = min(math.sqrt(self.stiffness / self.mass) * since, math.pi / 2)
        return max(self.peak * math.sin(phase), min(self.speed * self.damping, self.peak))


@dataclass(frozen=True, slots=True)
class Duration:
    """How long a stage or a task lasts.

    Attributes:
        expected: [s]; None where nothing tells.
        most: [s] after which it is over whatever happens; None where nothing bounds it.
        why: what it follows from, in words.
    """

    expected: float | None
    most: float | None
    why: str


class State(Enum):
    """How something of the world is there while a stage lasts."""

    THERE = "there"
    MET = "met"
    MAYBE = "maybe"


@dataclass(frozen=True, slots=True)
class Natural:
    """What the world imposes on one axis.

    Attributes:
        axis: of the stage's frame.
        decides: `velocity` or `force`.
        terms: (axis, factor) of the sum that it equals; none for zero.
        by: the object, equation or mechanism; empty where there is nothing.
        state: whether that is there.
        pushes: the sign of the velocity that it lets pass; 0 if none.
        friction: coefficient with which it rubs along this axis.
        against: the axis whose force presses there; empty without friction.
        effort: factor of the mechanism's own force or moment in the sum.
        turns: the direction is that where the stage, or the run, begins, and changes on the way.
    """

    axis: Axis
    decides: str
    terms: tuple[tuple[Axis, float], ...] = ()
    by: str = ""
    state: State = State.THERE
    pushes: int = 0
    friction: float = 0.0
    against: str = ""
    effort: float = 0.0
    turns: bool = False


@dataclass(frozen=True, slots=True)
class Selection:
    """Bases of what a law controls, in the axes of the stage's frame: S_f^T S_v = 0.

    Attributes:
        axes: (m,) names of the rows.
        force: (m, r) S_f, wrenches by unit set points [1, m].
        motion: (m, k) S_v, twists by rates of its motion loops.
        soft: axes with a spring of their own, which are in neither.
    """

    axes: tuple[Axis, ...]
    force: Vector
    motion: Vector
    soft: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class StagePrediction:
    """What one stage is expected to do.

    Attributes:
        equilibrium: by signal, in the order of its axes.
        depths: by object or equation.
        settling: by axis, equation or `null space`.
        impact: where it meets its surface.
        duration: of one visit.
        drift: speed at which set points that nothing returns drive the tool along [m/s]: infinite
            where it only grows, 0 where all are returned.
        natural: what the world imposes on each axis.
        selection: matrices of a law that selects.
        left_out: why a force that the stage asks for, by signal, is not among `equilibrium`.
    """

    name: str
    duration: Duration
    equilibrium: Mapping[str, Equilibrium] = field(default_factory=dict)
    depths: Mapping[str, Depth] = field(default_factory=dict)
    settling: Mapping[str, Settling] = field(default_factory=dict)
    impact: Impact | None = None
    drift: float = 0.0
    natural: tuple[Natural, ...] = ()
    selection: Selection | None = None
    left_out: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TaskPrediction:
    """What a task is expected to do.

    Attributes:
        stages: in the order of the file.
        duration: of the way through them that is planned.
    """

    stages: tuple[StagePrediction, ...]
    duration: Duration

    def __getitem__(self, name: str) -> StagePrediction:
        """A stage by its name.

        Raises:
            KeyError: there is no such stage.
        """
        for stage in self.stages:
            if stage.name == name:
                return stage
        raise KeyError(f"no stage {name!r}; the stages are {[s.name for s in self.stages]}")
