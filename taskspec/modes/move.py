"""`move`: an axis that goes a distance, from rest to rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass
from taskspec.modes.key import ModeKey
from taskspec.modes.mode import (
    AxisMode,
    HandOver,
    Known,
    Number,
    OwnReference,
    ReferenceInputs,
    StageStart,
    move_speed,
)
from taskspec.motion import blend
from taskspec.text.units import LENGTH, VELOCITY, show

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis
    from taskspec.motion.polynomial import PiecewiseCubic


@dataclass(frozen=True, slots=True)
class Move(AxisMode):
    """An axis that goes a distance from where its reference is, with limited jerk.

    Attributes:
        move: how far [m, rad].
        speed: at most [m/s, rad/s]; None for the default.
    """

    move: float
    speed: float | None = None

    name = "move"
    keys = (
        ModeKey(
            "move",
            "Distance to move",
            LENGTH,
            about="Angle to turn",
            meaning="A distance from the reference as it is, covered with limited jerk.",
        ),
        ModeKey(
            "speed",
            "Speed of the move",
            VELOCITY,
            about="Speed of the turn",
            above=0,
            companion="it is the speed of a 'move'",
            meaning="Greatest speed of the move; by default 50 mm/s or 30 deg/s.",
        ),
    )
    ends = True
    travels = True

    @property
    def top(self) -> float:
        """Its speed, given or not [m/s, rad/s]."""
        return self.speed or move_speed(rotation=self.rotation)

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r is a cubic of time; which one, its track writes into `segment` as time goes on."""
        from taskspec.motion import polynomial

        segment = at.parameters.add(f"segment.{at.axis}", polynomial.SEGMENT_SIZE)
        return at.in_time(polynomial.evaluate(segment, at.clock.t))

    def hand_over(self, at: StageStart) -> HandOver:
        """Nothing is left to blend: the move itself is planned from what is handed over."""
        return HandOver(0.0, 0.0, blend.BLEND_TIME, at.pressed)

    def track(self, start: Number, rate: Number) -> PiecewiseCubic | None:
        """The move from where the reference is, at its rate."""
        from taskspec.motion import profile

        return profile.move(start, rate, start + self.move, self.top)

    def reached_rate(self, known: Known) -> float | None:  # noqa: ARG002
        """Its speed, where it is given; a short move never gets as fast."""
        from taskspec.motion.profile import RISE_TIME

        if self.speed is None or abs(self.move) <= self.speed * RISE_TIME:
            return None
        return math.copysign(self.speed, self.move)

    def intended_rate(self, known: Known) -> float | None:  # noqa: ARG002
        """Its speed, signed [m/s, rad/s]."""
        return math.copysign(self.top, self.move)

    def heading(self, known: Known) -> float | None:  # noqa: ARG002
        """Its distance, signed [m, rad]."""
        return self.move

    @property
    def distance(self) -> tuple[float, float]:
        """Its distance [m, rad] and greatest rate [m/s, rad/s]."""
        return abs(self.move), self.top

    @property
    def pace(self) -> str:
        """Its speed where that is given."""
        return "move" if self.speed is None else "speed"

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """The artificial constraint in words: distance and speed."""
        return f"{axis} moves {show(self.move, axis.of(LENGTH))} at {self._speed(axis)}"

    def defaults(self, axis: Axis) -> Iterator[tuple[str, str]]:
        """The default speed, where the file gives none."""
        if self.speed is None:
            yield "speed", self._speed(axis)

    def _speed(self, axis: Axis) -> str:
        return show(self.top, axis.of(VELOCITY))
