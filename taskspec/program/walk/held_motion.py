"""Motions of a stage against what a held mechanism lets move: natural and artificial constraints.

A mechanism leaves the tool the twists T s, with one s for its coordinate and one for a free knob.
Motion axes S_v with rates v_d are consistent if S_v T s = v_d has a solution. That is a matter of
rank and of power, for the reactions do no work on T s; no axis is compared with another by angle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.plan import StagePlan

Vector = NDArray[np.float64]

#: Share of the largest rate by which rates may differ: an axis is no more exact than a few deg.
DIFFERS = 0.1


@dataclass(frozen=True, slots=True)
class HeldMotion:
    """A s = b of the motion axes of a stage that have a constant rate.

    Attributes:
        rates: of those axes [m/s, rad/s].
        scales: lengths that make their rates comparable [m].
        A: (m, k) rates of those axes per s, scaled.
        b: (m,) their constant rates, scaled.
        moved: rows of the axes whose rate is not zero.
        s: (k,) what gives these their rates and moves held axes least.
    """

    rates: Mapping[Axis, float]
    scales: Mapping[Axis, float]
    A: Vector
    b: Vector
    moved: tuple[int, ...]
    s: Vector

    @property
    def contradicted(self) -> Axis | None:
        """The axis whose rate the mechanism misses most; None where it allows them all."""
        missing = np.abs(self.A @ self.s - self.b)
        worst = int(np.argmax(missing))
        if missing[worst] <= DIFFERS * float(np.max(np.abs(self.b))):
            return None
        return list(self.rates)[worst]

    def allowed(self, axis: Axis) -> float:
        """Rate that the mechanism gives an axis as the others have theirs [m/s, rad/s].

        Where no other axis moves, that of the best compromise.
        """
        row, s = list(self.rates).index(axis), self.s
        others = [i for i in self.moved if i != row]
        if others:
            s = np.asarray(np.linalg.lstsq(self.A[others], self.b[others], rcond=DIFFERS)[0])
        return float((self.A @ s)[row]) / self.scales[axis]


def coordinate_rate(stage: StagePlan) -> float | None:
    """Rate at which a stage moves the mechanism that the robot holds [rad/s, m/s].

    None where it holds none, or where no constant rate of a motion axis moves it.
    """
    motion = held_motion(stage)
    return None if motion is None else float(motion.s[0])


def held_motion(stage: StagePlan) -> HeldMotion | None:
    """The motion of the held mechanism by a stage's constant rates; None without any."""
    if not stage.context.held:
        return None
    rates = {a: rate for a in stage.axes if (rate := _rate(stage, a)) is not None}
    moved = [a for a, rate in rates.items() if rate]
    if not moved:
        return None
    T = resolved_twists(stage, stage.context.start_p, stage.rotation)
    scales = {a: ARM_LENGTH if a.is_rotation else 1.0 for a in rates}
    A = np.array([scales[a] * T[a.row] for a in rates])
    b = np.array([scales[a] * rate for a, rate in rates.items()])
    rows = [list(rates).index(a) for a in moved]
    s = np.asarray(np.linalg.lstsq(A[rows], b[rows], rcond=DIFFERS)[0], dtype=np.float64)
    if len(rates) > len(moved):
        s = _with_holds(A, b, rows, s)
    return HeldMotion(rates, scales, A, b, tuple(rows), s)


def _with_holds(A: Vector, b: Vector, rows: list[int], s: Vector) -> Vector:
    """Of all rates that give the commanded motion, those that move held axes least."""
    _, sizes, V = np.linalg.svd(A[rows])
    rank = int(np.sum(sizes > DIFFERS * sizes[0])) if sizes[0] > 0 else 0
    free = V[rank:].T
    held = [i for i in range(len(A)) if i not in rows]
    if free.shape[1] == 0:
        return s
    more = np.linalg.lstsq(A[held] @ free, b[held] - A[held] @ s, rcond=DIFFERS)[0]
    return np.asarray(s + free @ more)


def _rate(stage: StagePlan, axis: Axis) -> float | None:
    """The constant rate of a stiff motion axis [m/s, rad/s]; None of any other."""
    entry = stage.spec.axes.get(axis)
    mode = None if entry is None else entry.given
    if entry is None or (mode is not None and not mode.moves):
        return 0.0
    if mode is None or entry.has_force or entry.stiffness is not None:
        return None
    rate = mode.intended_rate(stage.known)
    return rate if rate is None or math.isfinite(rate) else None


def resolved_twists(stage: StagePlan, tip: Vector, rotation: Vector) -> Vector:
    """(6, k) T of the held mechanism at the control point, in the axes of a stage's frame.

    A frame that turns with the handle turns held and commanded axes along
    (docs/language/frames.md); `hold: world` does not.

    Args:
        stage: the stage.
        tip: (3,) where the tip is [m].
        rotation: (3, 3) the frame there, world axes.
    """
    context = stage.context
    mechanism = context.mechanisms[context.held]
    T = mechanism.free_twists(tip, tip + rotation @ stage.rotation.T @ stage.kinematics.lever)
    axis = mechanism.rotation[:, 2]
    if stage.frame.mechanism is not None:
        T = T.copy()
        T[:3, 0] -= mechanism.lead * axis
    resolved = np.kron(np.eye(2), rotation.T) @ T
    if stage.frame.mechanism is not None:
        for i, a in enumerate(AXES[3:]):
            entry = stage.spec.axes.get(a)
            if entry is None or not entry.mode.world:
                resolved[3 + i, 0] -= float(rotation[:, i] @ axis)
    return np.asarray(resolved)
