"""The force sensor as a discrete-time model: one set of equations for the run and for analysis.

A reading goes through a first-order low-pass, a sampler that holds, and a delay, in this order,
each channel for itself. The update is one control period T long; its input is the wrench of the
step before, which is the one tick that a sensor is late in any case.
"""

from __future__ import annotations

import math

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.spec import Sensor

#: Ticks by which a delay or a sampling period may exceed a whole number and still count as it.
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class SensorModel:
    """A sensor's parameters in ticks.

        x[k] = b x[k-1] + (1 - b) w[k]             low-pass of pole b
        s[k] = x[k] if N divides k, else s[k-1]    sample and hold
        y[k] = s[k-d]                              delay

    The low-pass is exact for a wrench that is constant over a period. Rounding is to the slow side:
    a sensor is never better than the file says.

    Attributes:
        delay_ticks: d.
        hold_ticks: N, at least 1.
        pole: b in [0, 1), 0 for no low-pass.
    """

    delay_ticks: int = 0
    hold_ticks: int = 1
    pole: float = 0.0

    @staticmethod
    def of(sensor: Sensor, period: float) -> SensorModel:
        """The model of a declared sensor at control period T [s].

        d = ceil(delay / T); N = ceil(1 / (rate T)), so a rate that does not divide that of the
        controller becomes the next lower one that does; b = exp(-2 pi filter T).
        """
        hold = 1 if sensor.rate is None else _ceil(1.0 / (sensor.rate * period))
        pole = 0.0 if sensor.filter is None else math.exp(-2 * math.pi * sensor.filter * period)
        return SensorModel(_ceil(sensor.delay / period), max(hold, 1), pole)

    @property
    def direct(self) -> bool:
        """Whether a reading passes unchanged."""
        return self == SensorModel()

    @property
    def order(self) -> int:
        """Numbers that one channel remembers: x where there is a low-pass, s where it holds, d."""
        return (self.pole > 0) + (self.hold_ticks > 1) + self.delay_ticks

    def lag(self, period: float) -> float:
        """The mean age of a slowly changing wrench when the controller uses it [s].

        (1 + d + (N - 1)/2 + b/(1 - b)) T: the tick of every sensor, delay, hold and low-pass.
        """
        held = (self.hold_ticks - 1) / 2
        return (1 + self.delay_ticks + held + self.pole / (1 - self.pole)) * period

    def update(
        self, memory: ca.SX, wrench: ca.SX, samples: ca.SX, pole: ca.SX | None = None
    ) -> tuple[ca.SX, ca.SX]:
        """One tick, symbolically.

        Args:
            memory: (m, order) of m channels: x, s, then s[k-d] ... s[k-1], as far as they exist.
            wrench: (m,) w[k].
            samples: whether N divides k, 0 or 1.
            pole: that stands for b; None for the number.

        Returns:
            The memory after the tick, and y[k] (m,).
        """
        kept, at = [], 0
        value = wrench
        if self.pole > 0:
            b = self.pole if pole is None else pole
            value = b * memory[:, at] + (1 - b) * wrench
            kept.append(value)
            at += 1
        if self.hold_ticks > 1:
            value = ca.if_else(samples, value, memory[:, at])
            kept.append(value)
            at += 1
        if self.delay_ticks:
            line = [memory[:, i] for i in range(at, at + self.delay_ticks)]
            kept += [*line[1:], value]
            value = line[0]
        return ca.horzcat(ca.SX(wrench.shape[0], 0), *kept), value


def _ceil(ticks: float) -> int:
    return math.ceil(ticks - _ROUNDING)
