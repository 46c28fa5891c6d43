"""What an arm goes through in a stage, from its start to what ends it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.text.units import show

Vector = NDArray[np.float64]


class End(Enum):
    """What ends a passage.

    Attributes:
        DONE: its moves, path and time, or its guard for certain.
        BOUND: `within`, its guard never having been possible.
        STOP: the stop of the held mechanism, at which its guard may hold.
        OPEN: it is unknown how it goes on from there.
        JOINT: a joint comes to its limit.
        REACH: the arm does not get farther.
        STRAIN: a mechanism does not let an axis go on, and the limit on force is passed.
        EDGE: the frame ends, or what the stage presses on.
    """

    DONE = "done"
    BOUND = "bound"
    STOP = "stop"
    OPEN = "open"
    JOINT = "joint"
    REACH = "reach"
    STRAIN = "strain"
    EDGE = "edge"


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """The arm at an instant of a stage.

    Attributes:
        time: since the stage began [s].
        p, R: (3,), (3, 3) pose of the tip, world axes.
        frame: (3, 3) the stage's frame in the world.
        q: (n,) joint positions.
        v: (n,) their mean velocities since the instant before.
        twist: (6,) velocity of the tip at the fastest since then, in the frame's axes.
        coordinate: of the held mechanism [rad, m]; None without one, or where it is unknown.
        pivot: the least of J H^-1 J^T since the instant before [1/kg, 1/(kg m^2)].
        moved: displacement of the references since the stage began [m, rad].
        borne: what the robot applies on axes that the held mechanism takes off their references
            [N, N m].
    """

    time: float
    p: Vector
    R: Vector
    frame: Vector
    q: Vector
    v: Vector
    twist: Vector
    coordinate: float | None
    pivot: float
    moved: Mapping[Axis, float]
    borne: Mapping[Axis, float] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """When it is, in a sentence about its stage."""
        return f"at t = {show(self.time, 's', 3)}"


@dataclass(frozen=True, slots=True)
class Strain:
    """What a mechanism does not let an axis do, and what that presses with.

    Attributes:
        axis: which.
        mismatch: between its reference and what the mechanism allows [m, rad].
        force: that the grip bears for it [N, N m].
        time: when [s].
        drives: whether it is what moves the mechanism, with too little lever on it.
    """

    axis: Axis
    mismatch: float
    force: float
    time: float
    drives: bool = False


@dataclass(frozen=True, slots=True)
class Stopped:
    """A held mechanism that comes to its stop.

    Attributes:
        time: when [s].
        at: coordinate of the stop [rad, m].
        rate: at which it comes there [rad/s, m/s].
        beyond: how far the references would lead on until the stage ends [rad, m].
        axis: that drives it there.
        speed: at which that axis goes then [m/s, rad/s].
    """

    time: float
    at: float
    rate: float
    beyond: float
    axis: Axis
    speed: float


@dataclass(frozen=True, slots=True)
class HeldDrive:
    """The course of a held mechanism that a stage drives from rest, at coordinate 0.

    Attributes:
        times: (n,) since the stage began [s].
        coordinate: (n,) of the mechanism [rad, m].
        knob: (n,) angle of the tool on a free knob [rad]; 0 on a fixed one.
        force: (n,) size of the force that the grip bears [N]; None where that is not predicted.
    """

    times: Vector
    coordinate: Vector
    knob: Vector
    force: Vector | None

    @property
    def farthest(self) -> float:
        """Coordinate that is farthest from where it begins [rad, m]."""
        return float(self.coordinate[np.argmax(np.abs(self.coordinate))])

    def at(self, time: float) -> Vector:
        """(2,) coordinate and knob at a time [s]."""
        return np.array([np.interp(time, self.times, x) for x in (self.coordinate, self.knob)])


@dataclass(frozen=True, slots=True)
class Passage:
    """What an arm goes through in a stage.

    Attributes:
        instants: its start, and some later ones.
        end: what ends it.
        joint: index of the joint that comes to its limit; None for none.
        missed: (6,) by what the arm misses the place where it does not get farther [m, rad].
        strain: the greatest of an axis against the held mechanism.
        stopped: the held mechanism at its stop.
        edge: name of the object that the tool leaves.
        drive: how the law takes the held mechanism along; None where that is not predicted.
    """

    instants: tuple[Instant, ...]
    end: End
    joint: int | None = None
    missed: Vector | None = None
    strain: Strain | None = None
    stopped: Stopped | None = None
    edge: str = ""
    drive: HeldDrive | None = None

    @property
    def last(self) -> Instant:
        """Where it ends."""
        return self.instants[-1]
