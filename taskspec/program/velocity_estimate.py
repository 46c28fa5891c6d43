"""The velocity of joints of which only positions are measured: one model for run and analysis.

A predictor goes ahead by the arm's model, and the position q of the next tick corrects it. With T
the period of control,

    p- = p + T v + T^2/2 a,       v- = v + T a
    e = q[k] - p-                 p = p- + l e,         v = v- + (m / T) e.

Filtered differences know no model: a = 0, l = 1, m = 1 - b with b = exp(-2 pi f T), which is

    v[k] = b v[k-1] + (1 - b) (q[k] - q[k-1]) / T,

the "dirty derivative" w s/(s + w) of w = 2 pi f; b = 0 leaves plain differences. The observer is
that of Nicosia and Tomei (1990) with gains that go with the inertia, sampled,

    H(q) a + C(q, v) v + g(q) = u + J^T f,

with u the torque that is held, and f the measured wrench on the tip. Both of its poles are
z = exp(-w T), by l = 1 - z^2 and m = (1 - z)^2: what p and v lack of the truth obeys

    x[k+1] = [[1 - l, (1 - l) T], [-m / T, 1 - m]] x[k] + ((1 - l) T/2, 1 - m/2) T d[k],

with d the acceleration that the model lacks, whatever the law does. So an exact model leaves the
law's poles where they are, and d = 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import casadi as ca

from taskspec.control import linear
from taskspec.deferred_methods import dataclass
from taskspec.spec.joint_velocity import VelocitySource
from taskspec.text.units import TIME, scaled, show


@dataclass(frozen=True, slots=True)
class VelocityEstimate:
    """Filtered differences, or an observer, of the joints' velocities.

    Attributes:
        pole: z, 0 of plain differences.
        period: T [s].
        modelled: whether the arm's model predicts accelerations.
    """

    pole: float
    period: float
    modelled: bool

    @staticmethod
    def of(velocity: VelocitySource, period: float) -> VelocityEstimate | None:
        """What a file declares at control period T [s]; None where velocities are measured."""
        if velocity.measured:
            return None
        corner = velocity.corner
        pole = 0.0 if corner is None else math.exp(-2 * math.pi * corner * period)
        return VelocityEstimate(pole, period, velocity.observer is not None)

    def rows(self, lines: Sequence[float] = ()) -> Iterator[tuple[str, str]]:
        """How velocities are estimated, and by how much they are off.

        Args:
            lines: of encoders, from one to the next, of each joint or one for all [rad, m].
        """
        how = "filtered differences" if self.pole else "differences"
        how = "an observer with the arm's model" if self.modelled else how
        corner = -math.log(self.pole) / (2 * math.pi * self.period) if self.pole else None
        at = "" if corner is None else f", corner at {show(corner, 'Hz', 3)}"
        lag = scaled(self.of_acceleration, TIME, 3)
        lacks = "an acceleration that the model lacks" if self.modelled else "what accelerates"
        yield "velocity", f"of positions, by {how}{at}; {lag} behind {lacks}"
        off = sorted({self.of_position * each / 2 for each in lines if each})
        if off:
            said = " to ".join(show(x, "mrad/s", 3) for x in dict.fromkeys([off[0], off[-1]]))
            ends = dict.fromkeys([min(lines), max(lines)])
            between = " to ".join(show(x, "mrad", 3) for x in ends)
            yield "noise", f"lines of encoders, {between} apart, make it up to {said} off"

    @property
    def position(self) -> float:
        """l, how much of e corrects positions."""
        return 1 - self.pole**2 if self.modelled else 1.0

    @property
    def rate(self) -> float:
        """m, how much of e, over T, corrects velocities."""
        return (1 - self.pole) ** 2 if self.modelled else 1 - self.pole

    def correct(self, predicted: ca.SX, q: ca.SX) -> ca.SX:
        """(2n,) positions and velocities of now, of those that were predicted and of q (n,)."""
        n = q.shape[0]
        error = q - predicted[:n]
        position = predicted[:n] + self.position * error
        return ca.vertcat(position, predicted[n:] + self.rate / self.period * error)

    def predict(self, corrected: ca.SX, acceleration: ca.SX | None) -> ca.SX:
        """(2n,) positions and velocities of the next tick, of those of now (2n,).

        Args:
            corrected: of now.
            acceleration: (n,) by `acceleration`; None of an estimate without a model.
        """
        n, T = corrected.shape[0] // 2, self.period
        p, v = corrected[:n], corrected[n:]
        if acceleration is None:
            return ca.vertcat(p + T * v, v)
        return ca.vertcat(p + T * (v + T / 2 * acceleration), v + T * acceleration)

    @staticmethod
    def acceleration(H: ca.SX, bias: ca.SX, J: ca.SX, torque: ca.SX, wrench: ca.SX) -> ca.SX:
        """(n,) H^-1 (u + J^T f - C v - g).

        Args:
            H: (n, n) joint inertia; bias: (n,) C v + g; J: (6, n) of the tip.
            torque: (n,) u; wrench: (6,) f, by the environment on the tip, world axes.
        """
        return linear.solve(linear.cholesky(H), torque + J.T @ wrench - bias)

    @property
    def of_acceleration(self) -> float:
        """By how much v lags in the end where the model lacks an acceleration of 1 rad/s^2 [s].

        T (1 + b) / (2 (1 - b)) of a filter, near 1/w, T/2 of plain differences;
        T (1 + 3 z) / (2 (1 - z)) of an observer, near 2/w. The response to an acceleration has one
        sign, so it is also the most by which v lags where up to 1 rad/s^2 is not known.
        """
        behind = 3 if self.modelled else 1
        return self.period * (1 + behind * self.pole) / (2 * (1 - self.pole))

    @property
    def of_position(self) -> float:
        """By how much v is off at most where positions are off by up to 1 rad [1/s].

        The sum of |h|, h being the response to an impulse of q, of which the response to a step is
        the running sum: (m/T) b^k of a filter, (m/T) (k + 1) z^k of an observer. It rises to a peak
        and falls to nothing, so the sum of |h| is twice the peak: 2 (1 - b) / T, and near 2 w / e
        of a slow observer, e being Euler's number.
        """
        peak = 1.0
        if self.modelled and self.pole:
            at = max(math.floor(-1 / math.log(self.pole)), 1)
            peak = max(k * self.pole ** (k - 1) for k in (at, at + 1))
        return 2 * peak * self.rate / self.period

    @property
    def of_noise(self) -> float:
        """The same of standard deviations, of errors of position that are white [1/s].

        The root of the sum of h^2: sqrt(2/(1 + b)) m/T of a filter, and
        sqrt(2 (1 - z)^2 / (1 - z^2)^3) m/T of an observer.
        """
        z = self.pole
        power = 2 * (1 - z) ** 2 / (1 - z * z) ** 3 if self.modelled else 2 / (1 + z)
        return math.sqrt(power) * self.rate / self.period
