"""The nominal trajectory of a stage: where the tool goes by the text alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import Way
from taskspec.program.passage import Passage

Vector = NDArray[np.float64]

#: Of the difference quotient of a rate [s].
_TIME_STEP = 1e-6
#: Samples of a trajectory among which the fastest is searched.
_SAMPLES = 201
#: Shares of a stage's duration, not those at which a sine of a few periods is zero.
SAMPLES = (0.13, 0.37, 0.61, 0.83, 1.0)


def rate_from(way: Way, time: float) -> float:
    """The rate of a displacement from a time on [m/s, rad/s]."""
    return (way(time + _TIME_STEP) - way(time)) / _TIME_STEP


def rate_until(way: Way, time: float) -> float:
    """The rate of a displacement until a time [m/s, rad/s]."""
    return (way(time) - way(time - _TIME_STEP)) / _TIME_STEP


@dataclass(frozen=True, slots=True)
class Course:
    """A planned motion.

    Attributes:
        duration: until its moves, its path and its time are done [s].
        ways: displacement of each axis against time [m, rad].
        bends: whether its velocity changes along it.
    """

    duration: float
    ways: Mapping[Axis, Way]
    bends: bool

    def moved(self, time: float) -> dict[Axis, float]:
        """Displacement along and about each axis since the stage began."""
        return {axis: way(time) for axis, way in self.ways.items()}

    def fastest(self) -> tuple[float, float] | None:
        """When the tip is fastest along the frame's axes [s], and how fast [m/s]; None at rest."""
        times = np.linspace(0.0, self.duration, _SAMPLES)
        instants = times.tolist()
        ways = [[way(t) for t in instants] for a, way in self.ways.items() if not a.is_rotation]
        if not ways or not self.duration > 0 or not np.isfinite(ways).all():
            return None
        steps = np.linalg.norm(np.diff(np.array(ways), axis=1), axis=0)
        i = int(np.argmax(steps))
        return (float(times[i + 1]), float(steps[i] / times[1])) if steps[i] else None

    def farthest(self) -> set[float]:
        """When a motion that turns back is farthest along or against an axis of the frame [s]."""
        if not self.bends or not 0 < self.duration < math.inf:
            return set()
        times = np.linspace(0.0, self.duration, _SAMPLES).tolist()
        found = set()
        for axis, way in self.ways.items():
            moved = np.array([way(t) for t in times])
            if not axis.is_rotation and np.isfinite(moved).all() and np.ptp(moved) > 0:
                found |= {times[int(np.argmin(moved))], times[int(np.argmax(moved))]}
        return found - {0.0}

    def instants(self) -> list[float]:
        """Times at which the arm is sampled [s]: some, when the tip is fastest, and farthest."""
        found, fastest = {share * self.duration for share in SAMPLES}, self.fastest()
        if fastest is not None:
            found.add(fastest[0])
        return sorted(found | self.farthest())


@dataclass(frozen=True, slots=True)
class Place:
    """The arm at one instant of a stage.

    Attributes:
        words: where in the stage.
        rotation: (3, 3) the stage's frame in the world.
        q: (n,) joint positions; None where they are unknown, or where there are none.
        rates: what is known of the motion axes' velocities, in the frame's axes [m/s, rad/s].
        missed: by how much the tool misses a place out of reach, in words; empty otherwise.
    """

    words: str
    rotation: Vector
    q: Vector | None
    rates: Mapping[Axis, float] = field(default_factory=dict)
    missed: str = ""


@dataclass(frozen=True, slots=True)
class Nominal:
    """The nominal trajectory of one stage.

    Attributes:
        rotation: (3, 3) its frame as it starts, world axes.
        gap: from its contact as it starts [m]; None where that is unknown.
        start: (3,) where the tip is then [m]; None where that is unknown.
        coordinates: of the tip in its frame then [m, rad]; None where they are unknown.
        course: how it moves from there; None where that is not planned.
        places: its start, and samples of its path.
        carried: rates of the reference that is handed over, in its frame's axes [m/s, rad/s].
        passage: what the arm goes through; None where that is unknown.
        unbraked: the course of the same stage from rest, with nothing that is carried to be braked.
        about: of a path of joints that begins where nobody knows, the passage from where the arm is
            last known to be; None of others.
    """

    rotation: Vector
    gap: float | None
    start: Vector | None
    coordinates: Mapping[Axis, float] | None
    course: Course | None
    places: tuple[Place, ...]
    carried: Mapping[Axis, float] = field(default_factory=dict)
    passage: Passage | None = None
    unbraked: Course | None = None
    about: Passage | None = None

    def way(self) -> list[tuple[float, Vector]]:
        """Times [s] and places of the tip (3,) on the planned path."""
        return self._places(self.course)

    def lasting(self) -> list[Vector]:
        """Places of the tip (3,) that a stage goes to by itself, and where it ends.

        What it goes on by while it brakes the rate that it took over, and goes back, is left out:
        that belongs to the stage before it.
        """
        return [p for _, p in (*self._places(self.unbraked), *self.way()[-1:])]

    def _places(self, course: Course | None) -> list[tuple[float, Vector]]:
        if course is None or self.start is None:
            return []
        times = [share * course.duration for share in (0.0, *SAMPLES)]
        moved = [(time, course.moved(time)) for time in times]
        steps = [(time, np.array([m.get(a, 0.0) for a in AXES[:3]])) for time, m in moved]
        return [(t, self.start + self.rotation @ d) for t, d in steps if np.isfinite(d).all()]
