"""Sliding control of the motion axes of a hybrid law, within a boundary layer.

With s = e' + L e on an axis, its motion loop e'' + K_D e' + K_P e = 0 of real roots L <= M reads
s' = -M s. The sliding term adds K sat(s/phi) to it,

    x'' = x''_d + K_D e' + K_P e + K sat(s / phi),    s' = -M s - K sat(s / phi) + delta,

with delta [m/s^2] whatever the model lacks (Slotine and Li, Applied Nonlinear Control, 7.1-7.3).
Where K >= |delta| no s leaves the layer |s| <= phi, one beyond comes into it at M phi at least, and

    |e(t)| <= |e(0)| exp(-L t) + (1 - exp(-L t)) max(phi, |s(0)|) / L,

which is phi/L from where a reference begins at rest at the tool on. Sampled, with the torque held
over a period T, s goes by 1 - (M + K/phi) T (1 + L T) from tick to tick: within a layer thinner
than what makes that 0 every tick overshoots s = 0, and where it is below -1 no s comes to rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from taskspec.control import linear
from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import value_of

if TYPE_CHECKING:
    from taskspec.control.state import TaskState
    from taskspec.laws.case import Case
    from taskspec.laws.gains import Gains
    from taskspec.laws.uncertainty import Uncertainty

#: Of free fall [m/s^2].
GRAVITY = 9.81
#: What a root is taken beside, so that it has a derivative at 0.
_TINY = 1e-12
#: K is infinite, and with it nothing, where less than this is left of 1.
_LEFT = 1e-3


@dataclass(frozen=True, slots=True)
class Reach:
    """The switching gains that reach the layer, K_i = D_i + R sqrt(M_ii), M = J H^-1 J^T.

    D_i = sum_j |M_ij| w_j + sum_k |J H^-1|_ik t_k is what wrenches w and joint torques t move axis
    i by at most. A payload m then pushes with its weight and inertia, and the inertia of the arm is
    another; what such an unknown torque y moves by is |J_i H_true^-1 y| <= sqrt(M_ii) |y| in the
    metric of H_true^-1 (Cauchy and Schwarz). With a of `Uncertainty` and beta = a / (1 - a)

        R left = beta B (1 + kappa mu) + kappa (g + |x''| + 2 |D|),
        left = 1 - beta c - kappa mu (1 + beta c),
        kappa^2 = m^2 l / ((1 - a) + m l),    B = |q''|_H + |n|_(H^-1) + |y|_(H^-1) + |D|_Lambda,

    where l bounds the eigenvalues of M of translations, n = C q' + g, and x'', q'' are commanded
    without K. What K commands moves the payload by |D| + mu R and the arm by |D|_Lambda + c R, with
    mu^2 = sum of M_ii and c^2 = sum of |M^-1|_ij sqrt(M_ii M_jj) over axes that slide.

    Attributes:
        direct: (m,) D [m/s^2, rad/s^2].
        needed: R left [m/s^2 sqrt(kg)].
        left: where it is not positive, no gain is enough.
    """

    direct: ca.SX
    needed: ca.SX
    left: ca.SX

    def gains(self, state: TaskState) -> ca.SX:
        """K (m,) [m/s^2, rad/s^2]."""
        R = self.needed / ca.fmax(self.left, _LEFT)
        return self.direct + R * ca.sqrt(ca.diag(state.mobility))


def reach(
    state: TaskState,
    bounds: Uncertainty,
    slides: Sequence[Axis],
    *,
    acceleration: ca.SX,
    bias: ca.SX,
    posture: ca.SX | None,
) -> Reach:
    """The least gains for these bounds.

    Args:
        state: the arm.
        bounds: of what is not known.
        slides: the axes that slide.
        acceleration: (m,) what the law commands without the sliding term.
        bias: (n,) C q' + g [N m].
        posture: (n,) acceleration of a redundant arm in its null space, else None.
    """
    M, L, a, n = state.mobility, state.H_factor, bounds.inertia, bias.shape[0]
    on = state.rows(slides)
    lengths = [i for i, axis in enumerate(state.axes) if not axis.is_rotation]
    w = ca.DM([bounds.wrench.get(axis, 0.0) for axis in state.axes])
    given = bounds.joint_torque or (0.0,)
    t = ca.DM([*given] * (n if len(given) == 1 else 1))
    D, none = ca.fabs(M) @ w, ca.SX(0)
    if any(given):
        D += ca.fabs(linear.solve(L, state.J.T).T) @ t
    beta_B = beta_c = kappa = kappa_mu = push = none
    if a:
        beta, factor = a / (1 - a), linear.cholesky(M)
        B = _norm(linear.forward(factor, acceleration - state.drift)) + _root(w.T @ ca.fabs(M) @ w)
        B += _norm(linear.forward(L, bias))
        if posture is not None:
            B += _norm(L.T @ posture)
        if any(given):
            B += _root(t.T @ ca.fabs(linear.solve(L, ca.SX.eye(n))) @ t)
        Lambda = ca.fabs(linear.solve(factor, ca.SX.eye(len(state.axes))))[on, on]
        roots = ca.sqrt(ca.diag(M)[on])
        beta_B = beta * (B + _root(D[on].T @ Lambda @ D[on]))
        beta_c = beta * ca.sqrt(roots.T @ Lambda @ roots)
    if bounds.payload:
        m, block = bounds.payload, M[lengths, lengths]
        most = ca.fmin(ca.trace(block), ca.mmax(ca.sum2(ca.fabs(block))))
        kappa = m * ca.sqrt(most / ((1 - a) + m * most))
        kappa_mu = kappa * ca.sqrt(sum(M[i, i] for i in on if i in lengths))
        push = kappa * (GRAVITY + _norm(acceleration[lengths]) + 2 * _norm(D[lengths]))
    needed = beta_B * (1 + kappa_mu) + push
    return Reach(D, needed, 1 - beta_c - kappa_mu * (1 + beta_c))


def sliding_axes(gains: Gains) -> list[Axis]:
    """The motion axes that have a layer."""
    having = gains.get("sliding.layer", {})
    return [axis for axis in AXES if axis in having]


def slopes(K_P: float, K_D: float) -> tuple[float, float]:
    """L and M [1/s], the roots of a motion loop of damping ratio 1 or more."""
    apart = math.sqrt(max(K_D**2 - 4 * K_P, 0.0))
    return (K_D - apart) / 2, (K_D + apart) / 2


def term(case: Case, acceleration: ca.SX) -> ca.SX:
    """K sat(s / phi) (m,) [m/s^2, rad/s^2], zero on axes without a layer.

    Args:
        case: the stage.
        acceleration: (m,) what the law commands without it.
    """
    state, reference = case.state, case.reference
    found = ca.SX.zeros(len(state.axes))
    K = None
    for axis in sliding_axes(case.gains):
        i = state.axes.index(axis)
        K_P, K_D = case.gain("K_P", axis), case.gain("K_D", axis)
        slope = (K_D - ca.sqrt(ca.fmax(K_D**2 - 4 * K_P, 0))) / 2
        s = reference.velocity[i] - state.velocity[i] + slope * reference.error[i]
        if axis in case.gains.get("sliding.gain", {}):
            gain = case.gain("sliding.gain", axis)
        else:
            if K is None:
                assert case.bias is not None
                K = reach(
                    state, case.uncertainty, sliding_axes(case.gains),
                    acceleration=acceleration, bias=case.bias, posture=case.posture,
                ).gains(state)  # fmt: skip
            gain = K[i]
        found[i] = gain * ca.fmax(-1, ca.fmin(1, s / case.gain("sliding.layer", axis)))
    return found


def steps(gains: Gains, axis: Axis, K: float, period: float) -> float:
    """(M + K/phi) T (1 + L T), the share of s that a tick takes off within the layer of an axis.

    1 and less never overshoot; from 2 on it grows.

    Args:
        gains: of the stage.
        axis: that slides.
        K: its switching gain [m/s^2, rad/s^2].
        period: T [s].
    """
    slow, fast = slopes(value_of(gains, "K_P", axis), value_of(gains, "K_D", axis))
    taken = fast + K / value_of(gains, "sliding.layer", axis)
    return taken * period * (1 + slow * period)


def least_layer(gains: Gains, axis: Axis, K: float, period: float) -> float:
    """The thinnest layer that no tick overshoots [m/s, rad/s]; arguments as of `steps`."""
    slow, fast = slopes(value_of(gains, "K_P", axis), value_of(gains, "K_D", axis))
    T = period * (1 + slow * period)
    return K * T / max(1 - fast * T, _LEFT)


def error_bound(gains: Gains, axis: Axis) -> float:
    """phi / L, what the error of an axis never exceeds [m, rad]."""
    slow, _ = slopes(value_of(gains, "K_P", axis), value_of(gains, "K_D", axis))
    return value_of(gains, "sliding.layer", axis) / slow


def _norm(vector: ca.SX) -> ca.SX:
    return _root(ca.sumsqr(vector))


def _root(square: ca.SX) -> ca.SX:
    return ca.sqrt(square + _TINY)
