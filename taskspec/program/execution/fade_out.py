"""Torques of an arm while the program that keeps its limits has no answer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.control.qp import Status
from taskspec.program.events import LIMIT, Event
from taskspec.program.execution.stage_solver import HELD_TICKS

Vector = NDArray[np.float64]


class FadeOut:
    """The last torque that kept its limits, as it fades to what carries the arm.

    Attributes:
        over: whether its time has passed, and there still is no answer.
    """

    def __init__(self, joints: int) -> None:
        self._from, self._ticks = np.zeros(joints), 0

    @property
    def over(self) -> bool:
        """Whether the time in which it fades has passed."""
        return self._ticks > HELD_TICKS

    def reset(self) -> None:
        """Forgets the fade-out: there is an answer again."""
        self._ticks = 0

    def step(self, applied: Vector, rest: Vector) -> Vector:
        """The torque (n,) to aim at in one more tick without an answer [N m].

        Args:
            applied: (n,) of the tick before.
            rest: (n,) what is commanded of an arm at rest.
        """
        share = self._more(applied)
        faded: Vector = rest + share * (self._from - rest)
        return faded

    def slow(self, applied: Vector, earlier: Vector) -> Vector:
        """The position (n,) to aim at in one more tick, of an arm whose motion fades.

        Args:
            applied: (n,) of the tick before.
            earlier: (n,) of the one before that.
        """
        share = self._more(applied - earlier)
        slowed: Vector = applied + share * self._from
        return slowed

    def _more(self, fades: Vector) -> float:
        """The share that is left after one more tick of what is to fade, (n,) in the first one."""
        if self._ticks == 0:
            self._from[:] = fades
        self._ticks += 1
        return max(0.0, 1.0 - self._ticks / HELD_TICKS)


def unanswered(status: Status) -> Event:
    """The event that ends a run when it has faded; `status` is the solver's last one."""
    text = f"the program that keeps the limits has had no answer for {HELD_TICKS} ticks"
    return Event(LIMIT, "solver", f"{text}: {status.value}")
