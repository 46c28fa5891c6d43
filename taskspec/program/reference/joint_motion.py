"""A motion in joint space that a file states as expressions of time, q_d(t) of (4.101)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.modes import HandOver, move_speed
from taskspec.motion import blend
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.program.clock import Clock

Vector = NDArray[np.float64]

#: (n,) expressions, or numbers of CasADi.
Joints = Any


@dataclass(frozen=True, slots=True)
class JointMotion:
    """Joint positions against time; it begins as a `position` of an axis does.

    Attributes:
        positions: of each joint, as expressions of t, clock and params [rad, m].
        time: after which it is done, by its own time [s].
        turns: which joints are hinges.
        from_rest: whether it starts from rest in a time of its own.
        params: their values [SI].
    """

    positions: tuple[Expression, ...]
    time: float
    turns: tuple[bool, ...]
    from_rest: bool
    params: Mapping[str, float]

    @property
    def predictable(self) -> bool:
        """Whether it depends on the stage's own time alone."""
        return not any(each.uses("clock") for each in self.positions)

    def stated(self, translate: Callable[[Expression], ca.SX]) -> ca.SX:
        """(n,) what the file states, an expression of t and clock."""
        return ca.vertcat(*(translate(each) for each in self.positions))

    def hand_over(self, q: Joints, rate: Joints, stated: Joints, stated_rate: Joints) -> HandOver:
        """Hand-over from joints that are at q (n,) and move at a rate (n,).

        All joints arrive together, none faster than a move.

        Args:
            q, rate: of the joints as the stage is entered [rad, m, and by s].
            stated, stated_rate: what the file states at t = 0.
        """
        speeds = [move_speed(rotation=turns) for turns in self.turns]
        slope = rate if self.from_rest else rate - stated_rate
        offset = q - stated + slope * blend.BLEND_TIME / 2
        times = [blend.blend_time(offset[i], speed) for i, speed in enumerate(speeds)]
        time = ca.mmax(ca.vertcat(*times))
        if self.from_rest:
            away = [ca.fabs(offset[i]) > blend.NEGLIGIBLE * v for i, v in enumerate(speeds)]
            return HandOver(offset, slope, time, 0.0, wait=time * ca.mmax(ca.vertcat(*away)))
        moves = ca.mmax(ca.fabs(slope)) != 0
        return HandOver(offset, slope, ca.fmax(time, blend.CATCH_UP * moves), 0.0)

    def reference(self, stated: ca.SX, clock: Clock, handed: HandOver) -> ca.SX:
        """q_d (n,) against the time of a stage that was entered so."""
        if self.from_rest:
            own_time = blend.from_rest(clock.t - handed.wait)
            stated = ca.substitute(stated, clock.t, own_time)
        return stated + blend.added(clock.t, handed.offset, handed.slope, handed.time)

    def lasts(self, wait: Joints) -> Joints:
        """How long it takes [s]: what it waits for its start, and what it is behind then."""
        return wait + self.time + (blend.BLEND_TIME / 2 if self.from_rest else 0.0)

    def at(self, start: Vector, instants: int) -> tuple[Vector, tuple[Vector, ...]]:
        """Even times (k,) along it [s], and q_d, q'_d and q''_d (k, n) from rest at `start`.

        Only of one that is predictable.
        """
        clock = Clock(ca.SX.sym("t"), ca.SX.sym("clock"))
        known = {**constants(self.params), "t": clock.t}
        algebra = CasadiAlgebra(None, 0.0)
        stated = self.stated(lambda each: algebra.translate(each, lambda n: known[n.path[0]]))
        begins = ca.Function("begins", [clock.t], [stated, clock.rate(stated)])(0.0)
        handed = self.hand_over(ca.DM(start), ca.DM.zeros(len(start)), *begins)
        place = self.reference(stated, clock, handed)
        rate = clock.rate(place)
        results = [place, rate, clock.rate(rate)]
        times = np.linspace(0.0, float(self.lasts(handed.wait)), instants)
        found = ca.Function("motion", [clock.t], results).map(instants)(times.reshape(1, -1))
        return times, tuple(np.array(each).T for each in found)
