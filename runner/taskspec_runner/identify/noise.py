"""What is left of a log beside a model: its size, and how each tick depends on those before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Ticks that what is left may depend on at most.
_MOST_ORDER = 12
#: Of a channel, what is left is at least this share of what it has: the last digits of a sum.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class ChannelNoise:
    """A channel's noise as an autoregression: e[k] = sum c_i e[k-i] + s w[k], w white of unit size.

    Attributes:
        coefficients: (order,) c.
        deviation: s.
    """

    coefficients: Vector
    deviation: float

    @classmethod
    def of(cls, left: Vector, present: Mask, size: float, order: int | None = None) -> ChannelNoise:
        """That of what is left (n,) where it is present, of the order that Akaike's criterion has.

        Args:
            left: (n,) residuals.
            present: (n,) where there are any.
            size: of the channel itself, for its rounding.
            order: the order; None for the best.
        """
        e = np.where(present, left, 0.0)
        most = _MOST_ORDER if order is None else order
        pairs = [
            (
                float(e[lag:] @ e[: len(e) - lag]),
                float((present[lag:] & present[: len(e) - lag]).sum()),
            )
            for lag in range(most + 1)
        ]
        covariance = np.array([total / max(count, 1.0) for total, count in pairs])
        count = pairs[0][1]
        floor = (_ROUNDING * size) ** 2 + 1e-300
        if covariance[0] <= floor or count < 10 * _MOST_ORDER:
            return cls(np.zeros(0), float(np.sqrt(max(covariance[0], floor))))
        best, chosen = np.inf, (np.zeros(0), covariance[0])
        for coefficients, variance in _levinson(covariance):
            score = count * np.log(max(variance, floor)) + 2 * len(coefficients)
            if score < best - 2:
                best, chosen = score, (coefficients, variance)
        return cls(chosen[0], float(np.sqrt(max(chosen[1], floor))))

    def whitened(self, values: Vector) -> Vector:
        """(n, ...) of values (n, ...): what is new in each tick, in units of s."""
        made = np.array(values)
        for i, c in enumerate(self.coefficients, 1):
            made[i:] -= c * values[:-i]
        return np.asarray(made / self.deviation)

    def usable(self, present: Mask) -> Mask:
        """(n,) the ticks whose own past is present as far as it counts."""
        made = present.copy()
        order = len(self.coefficients)
        made[:order] = False
        for i in range(1, order + 1):
            made[i:] &= present[:-i]
        return made


def _levinson(covariance: Vector) -> list[tuple[Vector, float]]:
    """Coefficients and variance of the autoregressions of order 0, 1, ... (Durbin's recursion)."""
    found = [(np.zeros(0), float(covariance[0]))]
    a, variance = np.zeros(0), float(covariance[0])
    for order in range(1, len(covariance)):
        reflection = (covariance[order] - a @ covariance[order - 1 : 0 : -1][: len(a)]) / variance
        if abs(reflection) >= 1:
            break
        a = np.concatenate([a - reflection * a[::-1], [reflection]])
        variance *= 1 - reflection**2
        found.append((a, variance))
    return found
