"""Theorem 4.1 with a rate: how fast the parallel PID regulator (4.50) settles at least.

The theorem's function V of (4.62) has V' <= 0 only, and its proof ends with La Salle's theorem,
which has no rate. One more term makes it strict. With H_x' = C_x + C_x^T (Property 4.2), (4.56) and
(4.58)

    W  = w a^T H_x e' + d_n w a^T e + (k_n + k_F' k_e) w^2 / 2
    W' = (a^T e)(a^T H_x e') + w a^T C_x^T e' + d_n (a^T e)^2 - k_I k_e w^2

so that V + epsilon W falls with w too. By (4.10) and (4.11) it lies between z^T P_low z / 2 and
z^T P_high z / 2, and falls by at least z^T Q z. The three matrices are constant and split into
blocks: (e', e) of each tangential axis, (e', e, w) of the normal one. With r the least generalised
eigenvalue of Q and P_high,

    V(t) <= V(0) exp(-2 r t),    ||e(t)|| <= Phi exp(-r t),    Phi^2 = 2 V(0) max (P_low^-1)_ee

Phi is the radius of the region Z (4.65): the solution does not leave the set V <= V(0), which lies
in it. rho and epsilon are free; those with the lowest bound after a given time are taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

Array = NDArray[np.float64]

#: Values of rho, and of epsilon for each, around the best of which the grid is halved some times.
_TRIED, _HALVINGS = 10, 7
#: rho is tried between these, in shares of the way from the least that (4.70) allows to the most.
_RHO = (1e-2, 0.9)
#: epsilon is tried between these, in shares of rho.
_SHARES = (1e-2, 1e3)


@dataclass(frozen=True, slots=True)
class RegulatedAxis:
    """Gains of one axis: k_m [N/m] and d_m [N s/m]."""

    stiffness: float
    damping: float


@dataclass(frozen=True, slots=True)
class PressedContact:
    """The force loop along the normal: k_e [N/m], k_F, k_I [1/s]."""

    stiffness: float
    proportional: float
    integral: float


@dataclass(frozen=True, slots=True)
class ArmBounds:
    """lambda_m, lambda_M of (4.10) [kg] and k_Cx of (4.11) [kg/m], along a motion."""

    least: float
    largest: float
    coriolis: float


@dataclass(frozen=True, slots=True)
class RegulatorState:
    """The state z of (4.59) at the start.

    Attributes:
        error: (m,) e = x_E - x, the normal axis first [m].
        rate: (m,) e' [m/s].
        integral: w [m s].
    """

    error: Array
    rate: Array
    integral: float


@dataclass(frozen=True, slots=True)
class RegulatorBound:
    """||e(t)|| <= region exp(-rate t).

    Attributes:
        rate: r [1/s].
        region: Phi of (4.65) [m].
        rho: of (4.63) [1/s].
        epsilon: of the term that makes V strict [1/s].
    """

    rate: float
    region: float
    rho: float
    epsilon: float

    def at(self, time: Array) -> Array:
        """The bound on ||e|| [m] at times (k,) since the start [s]."""
        return np.asarray(self.region * np.exp(-self.rate * time))


def regulator_bound(
    axes: Sequence[RegulatedAxis],
    contact: PressedContact,
    arm: ArmBounds,
    start: RegulatorState,
    time: float,
) -> RegulatorBound | None:
    """The bound that is lowest after a time; None where no rho and epsilon give one.

    Args:
        axes: the normal one first, then the tangential ones.
        contact: along the normal.
        arm: bounds of its terms along the motion.
        start: where it starts.
        time: after which it is to be low [s].
    """
    most = min(each.damping for each in axes) / arm.largest
    least = contact.integral / (1 + contact.proportional)
    if not 0 < least < most:
        return None
    case = partial(_with, axes, contact, arm, start)

    def level(chosen: Array) -> float:
        # Of the logarithms of rho's way from the least to the most, and of epsilon / rho.
        rho = least + (most - least) * float(np.exp(chosen[0]))
        bound = case((rho, rho * float(np.exp(chosen[1])))) if rho < most else None
        return np.inf if bound is None else _level(bound, time)

    tried = itertools.product(
        np.log(np.geomspace(*_RHO, _TRIED)), np.log(np.geomspace(*_SHARES, _TRIED))
    )
    first = min((np.array(each) for each in tried), key=level)
    if not np.isfinite(level(first)):
        return None
    best, step = first, np.log([_RHO[1] / _RHO[0], _SHARES[1] / _SHARES[0]]) / (_TRIED - 1)
    for _ in range(_HALVINGS):
        step = step / 2
        around = (best + step * np.array(way) for way in itertools.product((0, -1, 1), repeat=2))
        best = min(around, key=level)
    rho = least + (most - least) * float(np.exp(best[0]))
    return case((rho, rho * float(np.exp(best[1]))))


def _level(bound: RegulatorBound, time: float) -> float:
    """The logarithm of a bound after a time [s]."""
    return float(np.log(bound.region) - bound.rate * time)


def _with(
    axes: Sequence[RegulatedAxis],
    contact: PressedContact,
    arm: ArmBounds,
    start: RegulatorState,
    free: tuple[float, float],
) -> RegulatorBound | None:
    """The bound with a rho and an epsilon; None where one of the matrices is not positive."""
    rho, epsilon = free
    low, high = (
        [_function(axis, contact if i == 0 else None, masses, free) for i, axis in enumerate(axes)]
        for masses in ((arm.least, arm.largest), (arm.largest, arm.least))
    )
    if any(np.linalg.eigvalsh(P)[0] <= 0 for P in low):
        return None
    z = [np.array([v, e]) for v, e in zip(start.rate, start.error, strict=True)]
    z[0] = np.append(z[0], start.integral)
    V = sum(float(each @ P @ each) / 2 for each, P in zip(z, high, strict=True))
    inverse = [np.linalg.inv(P) for P in low]
    region = np.sqrt(2 * V * max(P[1, 1] for P in inverse))
    integral = np.sqrt(2 * V * inverse[0][2, 2])
    bend = (rho * region + epsilon * integral) * arm.coriolis
    rate = np.inf
    for i, (axis, P) in enumerate(zip(axes, high, strict=True)):
        Q = _decay(axis, contact if i == 0 else None, arm, free, float(bend))
        root = np.linalg.inv(np.linalg.cholesky(P))
        rate = min(rate, float(np.linalg.eigvalsh(root @ Q @ root.T)[0]))
    return RegulatorBound(rate, float(region), rho, epsilon) if rate > 0 else None


def _function(
    axis: RegulatedAxis,
    contact: PressedContact | None,
    masses: tuple[float, float],
    free: tuple[float, float],
) -> Array:
    """A block of the matrix of V + epsilon W, with bounds in the place of H_x.

    H_x stands in (e' + s)^T H_x (e' + s) - s^T H_x s, s = rho e + epsilon w a: each has one bound.

    Args:
        axis: whose block it is.
        contact: along the normal; None for a tangential axis.
        masses: in the place of H_x in the first and in the second of the two.
        free: rho and epsilon.
    """
    rho, epsilon = free
    k, d = axis.stiffness, axis.damping
    first, second = masses
    if contact is None:
        s = np.array([0.0, rho])
        P = np.diag([0.0, k + rho * d])
        moved = np.array([1.0, rho])
    else:
        k_e, k_I, stiff = contact.stiffness, contact.integral, (1 + contact.proportional)
        s = np.array([0.0, rho, epsilon])
        moved = np.array([1.0, rho, epsilon])
        P = np.diag([0.0, k + rho * d + stiff * k_e, rho * k_I * k_e + epsilon * (k + stiff * k_e)])
        P[1, 2] = P[2, 1] = k_I * k_e + epsilon * d
    return np.asarray(P + first * np.outer(moved, moved) - second * np.outer(s, s))


def _decay(
    axis: RegulatedAxis,
    contact: PressedContact | None,
    arm: ArmBounds,
    free: tuple[float, float],
    bend: float,
) -> Array:
    """A block of Q; rho e'^T H_x e' + epsilon (a^T e)(a^T H_x e') is a square less a square too."""
    rho, epsilon = free
    k, d = axis.stiffness, axis.damping
    if contact is None:
        return np.diag([d - rho * arm.largest - bend, rho * k])
    k_e, k_I = contact.stiffness, contact.integral
    stiff = rho * k + (rho * (1 + contact.proportional) - k_I) * k_e - epsilon * d
    Q = np.diag([d - bend, stiff + epsilon**2 / (4 * rho) * arm.least, epsilon * k_I * k_e])
    moved = np.array([1.0, epsilon / (2 * rho), 0.0])
    return np.asarray(Q - rho * arm.largest * np.outer(moved, moved))
