"""A disturbance observer beside a law: the residual of the generalised momentum, low-passed.

What moves the arm beside its torque u and the measured wrench f is, as p = H q' has
p' = u + C^T q' - g + J^T f + d (De Luca and Mattone, 2003), over a period T with u held

    r[k] = H (q'[k] - q'[k-1]) / T + n[k-1] - u[k-1] - J^T f[k],    n = C q' + g,

in which H q'' = p' - H' q' leaves no derivative of the inertia. The estimate

    d[k] = b d[k-1] + (1 - b) r[k],    b = exp(-2 pi f_o T),

follows d as a first-order low-pass of the bandwidth f_o does, as the residual of De Luca and
Mattone with the gain 2 pi f_o. It is taken off, clipped joint by joint to its bounds; along
force axes F not at all, whose own loops hold their forces:

    u = u_law - (d - J^T Lambda S_F J H^-1 d),    Lambda = (J H^-1 J^T)^-1.

u[k-1] is what joints were commanded in fact, so that what limits cut off is no disturbance, and the
estimate winds nothing up. The contact's force is measured, so that it is no disturbance either.

Stability: of an arm whose inertia is H / rho and whose torques or velocities are D ticks late,

    z^(D+1) - z^D + (1 - b) rho = 0,

which is stable for (1 - b) rho < 2 sin(pi / (2 (2 D + 1))). In contact a wrench that is a time tau
late leaves a part w tau / (w tau + 1) of it in the estimate at most, w = 2 pi f_o.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.deferred_methods import dataclass
from taskspec.text.units import TIME, scaled, show

if TYPE_CHECKING:
    from taskspec.laws.case import Case

#: What it remembers: the estimate d, and of the tick before q', n and u.
ESTIMATE, VELOCITY, BIAS, TORQUE = (
    f"disturbance.{name}" for name in ("estimate", "velocity", "bias", "torque")
)

#: Of its limit, what is taken off a joint at most where a file gives no bound.
_SHARE = 0.25


@dataclass(frozen=True, slots=True)
class ObservedDisturbance:
    """The observer in one tick.

    Attributes:
        estimate: (n,) d [N m, N].
        torque: (n,) what is added to the law's [N m, N].
        memory: what it remembers but for the torque, by slot.
    """

    estimate: ca.SX
    torque: ca.SX
    memory: Mapping[str, ca.SX]


@dataclass(frozen=True, slots=True)
class MomentumObserver:
    """The observer of a stage.

    Attributes:
        bandwidth: f_o [Hz].
        period: T [s].
        most: (n,) what is taken off joints at most [N m, N].
        turns: of each joint, whether it turns.
    """

    bandwidth: float
    period: float
    most: tuple[float, ...]
    turns: tuple[bool, ...]

    @staticmethod
    def limits(given: Sequence[float] | None, limits: NDArray[np.float64]) -> tuple[float, ...]:
        """(n,) the most that is taken off joints [N m, N].

        Args:
            given: by the file, one for all joints or one for each; None for a quarter of `limits`.
            limits: (n,) what joints can exert [N m, N].
        """
        most = _SHARE * limits if given is None else np.broadcast_to(given, limits.shape)
        return tuple(most.tolist())

    @property
    def pole(self) -> float:
        """b."""
        return math.exp(-2 * math.pi * self.bandwidth * self.period)

    def rows(self) -> Iterator[tuple[str, str]]:
        """What it follows, and what it takes off."""
        lag = scaled(1 / (2 * math.pi * self.bandwidth), TIME, 3)
        shown = [
            show(each, "N*m" if turns else "N", 3)
            for each, turns in zip(self.most, self.turns, strict=True)
        ]
        groups = [[i for i, _ in each] for _, each in groupby(enumerate(shown, 1), _text)]
        joints = [
            f"{shown[i - 1]} of joint{f's {i} to {j}' if j > i else f' {i}'}"
            for i, *_, j in ([*each, each[-1]] for each in groups)
        ]
        taken = f"{shown[0]} of each joint" if len(groups) == 1 else ", ".join(joints)
        yield (
            "observes",
            f"disturbances up to {show(self.bandwidth, 'Hz', 3)}, {lag} behind them; takes off at "
            f"most {taken}, and nothing along force axes",
        )


def _text(numbered: tuple[int, str]) -> str:
    return numbered[1]


def observe(
    case: Case, observer: MomentumObserver, *, applied: ca.SX, begins: ca.SX
) -> ObservedDisturbance:
    """One tick; `case` remembers `ESTIMATE`, `VELOCITY` and `BIAS`.

    Args:
        case: the stage, with its bias.
        observer: of the stage.
        applied: (n,) u[k-1] [N m, N].
        begins: whether the stage has its first tick, which has none before it.
    """
    pole, most = observer.pole, ca.DM(observer.most)
    state, v, n = case.state, case.joint_velocity, len(observer.most)
    d, before, bias = (case.remembered(name, n) for name in (ESTIMATE, VELOCITY, BIAS))
    H = state.H_factor @ state.H_factor.T
    residual = H @ (v - before) / case.period + bias - applied - state.J.T @ state.f
    d = ca.if_else(begins, d, pole * d + (1 - pole) * residual)
    taken = ca.fmax(-most, ca.fmin(most, d))
    forced = state.rows(case.force)
    if forced:
        moved = ca.SX.zeros(len(state.axes))
        moved[forced] = (state.J @ linear.solve(state.H_factor, taken))[forced]
        taken = taken - state.J.T @ linear.solve(linear.cholesky(state.mobility), moved)
    return ObservedDisturbance(d, -taken, {ESTIMATE: d, VELOCITY: v, BIAS: case.bias})


def largest_step(late: int) -> float:
    """What (1 - b) rho has to stay below where torques or velocities are so many ticks late."""
    return 2 * math.sin(math.pi / (2 * (2 * late + 1)))


def share_left(bandwidth: float, lag: float) -> float:
    """The greatest part of a wrench that is late by `lag` [s] that the estimate has.

    |Q(jw) (1 - F(jw))| of two low-passes Q and F, at its greatest where w has no bounds.
    """
    w = 2 * math.pi * bandwidth * lag
    return w / (1 + w)
