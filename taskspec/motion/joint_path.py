"""A path in joint space: straight from one set of joint positions to the next, at rest in each.

All joints begin and arrive together: q(s) = q_k + (s - k)(q_{k+1} - q_k) for s from k to k + 1, and
the joint with the longest travel on a piece goes with the path's speed there. s(t) of a piece is a
`profile.move`: the fastest one under limits of the speed v, the acceleration 2 v/T and the jerk
4 v/T^2 of that joint, with the rise time T of all moves.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.motion.polynomial import PiecewiseCubic
from taskspec.motion.profile import RISE_TIME, move

#: A travel that is no longer than what rounding leaves [rad, m].
_NOWHERE = 1e-12

#: (n,) numbers, or an expression of where the stage is entered.
Joints = Any


@dataclass(frozen=True, slots=True)
class JointPath:
    """A path through joint positions, in SI units.

    Attributes:
        targets: (n,) joint positions of each, one after the other [rad, m].
        speed: of the joint that has the longest travel [rad/s]; or
        time: that all of it takes [s].
    """

    targets: tuple[tuple[float, ...], ...]
    speed: float | None = None
    time: float | None = None

    def timing(self, start: Joints) -> PiecewiseCubic:
        """s against time [s], from 0 at rest to the number of targets at rest.

        Args:
            start: (n,) joint positions as the stage is entered; numbers, or an expression.
        """
        travels = [_longest(travel) for travel in self._travels(start)]
        whole = sum(travels[1:], start=travels[0])
        moves = []
        for k, travel in enumerate(travels):
            if self.time is None:
                assert self.speed is not None
                moves.append(move(float(k), 0.0, k + 1.0, self.speed / travel))
                continue
            share = self.time * travel / whole
            half = share / 2
            rise = ca.fmin(RISE_TIME, half) if _symbolic(share) else min(RISE_TIME, half)
            moves.append(move(float(k), 0.0, k + 1.0, 1.0 / (share - rise), rise))
        return _joined(moves)

    def at(self, start: Joints, s: Any) -> Joints:
        """Joint positions (n,) at s; numbers, or an expression."""
        q = start
        for k, travel in enumerate(self._travels(start)):
            passed = s - k
            if _symbolic(passed):
                passed = ca.fmin(ca.fmax(passed, 0.0), 1.0)
            else:
                passed = min(max(passed, 0.0), 1.0)
            q = q + passed * travel
        return q

    def piece(self, start: Joints, s: float) -> Joints:
        """dq/ds (n,) at s, of numbers."""
        travels = self._travels(start)
        return travels[min(max(int(s), 0), len(travels) - 1)]

    def _travels(self, start: Joints) -> list[Joints]:
        places = [start, *(_like(start, target) for target in self.targets)]
        return [there - here for here, there in pairwise(places)]


def _symbolic(value: Any) -> bool:
    return isinstance(value, ca.SX)


def _like(start: Joints, target: tuple[float, ...]) -> Joints:
    """A target as numbers, or as an expression where the start is one."""
    return ca.SX(ca.DM(target)) if _symbolic(start) else np.array(target)


def _longest(travel: Joints) -> Any:
    """The travel of the joint that has most to go [rad, m]."""
    if _symbolic(travel):
        return ca.fmax(ca.mmax(ca.fabs(travel)), _NOWHERE)
    return max(float(np.max(np.abs(travel))), _NOWHERE)


def _joined(moves: list[PiecewiseCubic]) -> PiecewiseCubic:
    """Moves one after the other, each without its rest but the last."""
    if len(moves) == 1:
        return moves[0]
    pieces = moves[0].coefficients.shape[0]
    began, knots, rows = 0.0, [], []
    for i, each in enumerate(moves):
        kept = pieces if i == len(moves) - 1 else pieces - 1
        knots += [began + each.knots[k] for k in range(kept)]
        rows += [each.coefficients[k, :] for k in range(kept)]
        last = began + each.knots[pieces]
        began = began + each.rests
    knots.append(last)
    if any(_symbolic(knot) for knot in knots):
        return PiecewiseCubic(ca.vertcat(*knots), ca.vertcat(*map(ca.SX, rows)))
    return PiecewiseCubic(np.array(knots, dtype=float), np.array(rows))
