"""The force sensor of a run: what it makes of the wrench on the tool, tick by tick."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import Wiring, evaluated
from taskspec.program.execution.sensor_zero import SensorZero
from taskspec.program.sensor import SensorModel
from taskspec.spec import Sensor

Vector = NDArray[np.float64]

#: Ticks whose noise is drawn at once.
_BLOCK = 500


class ForceSensor:
    """A sensor that turns with the tool: bias and noise, low-pass, sample and hold, delay.

    Attributes:
        function: the tick: the true wrench, what it remembers -> the reading.
        memory, kept: (6 order,) what it remembers before the tick and after it.
        samples: (1,) 1 in a tick in which it samples, else 0.
        hold_ticks: every so many it does.
        noise: (6,) of the tick, in the tool's axes [N, N m].
        drawn: (block, 6) noise of the next ticks; empty where there is none.
        used: rows of it that have been.
        ticks: so far.
    """

    def __init__(
        self,
        sensor: Sensor,
        wrench: Vector,
        tip_rotation: Vector,
        zero: SensorZero,
        period: float,
        seed: int = 0,
    ) -> None:
        """A sensor that has been switched on for long.

        Args:
            sensor: what is declared of it.
            wrench: (6,) that acts on it, about the tip, world axes [N, N m].
            tip_rotation: (9,) the tip's axes when that arose, row by row.
            zero: gets the readings.
            period: of control [s].
            seed: of the noise.
        """
        model = SensorModel.of(sensor, period)
        noise = sensor.noise
        deviations = (noise.force, noise.torque) if noise is not None else (0.0, 0.0)
        self._deviation = np.repeat(deviations, 3)
        # The generator is named, so that a seed means the same with every version of NumPy.
        self._random = np.random.Generator(np.random.PCG64(seed))
        self.drawn: Vector = np.zeros((_BLOCK if self._deviation.any() else 0, 6))
        self.used, self.ticks, self.hold_ticks = len(self.drawn), 0, model.hold_ticks
        self.noise, self.samples = np.zeros(6), np.zeros(1)
        self.memory, self.kept = np.zeros(6 * model.order), np.zeros(6 * model.order)
        wiring = Wiring()
        true, turned = wiring.reads("true", wrench), wiring.reads("turned", tip_rotation)
        bias = wiring.numbers("bias", *sensor.bias)
        R = ca.reshape(turned, 3, 3).T
        # In the axes that the tool had when the wrench arose.
        own = ca.vertcat(R.T @ true[:3], R.T @ true[3:]) + bias
        memory = ca.reshape(wiring.reads("memory", self.memory), 6, model.order)
        noisy = own + wiring.reads("noise", self.noise)
        samples, pole = wiring.reads("samples", self.samples), wiring.numbers("pole", model.pole)
        kept, reading = model.update(memory, noisy, samples, pole)
        wiring.writes(reading, zero.reading)
        wiring.writes(ca.vec(kept), self.kept)
        self.function = wiring.bound("sensor")
        own_reading = ca.Function("own", [true, turned, bias], [own])
        (rest,) = evaluated(own_reading, wrench, tip_rotation, np.array(sensor.bias))
        self.memory[:] = np.tile(rest, model.order)

    def read(self) -> None:
        """One tick; the reading goes to the controller."""
        if len(self.drawn):
            if self.used == len(self.drawn):
                self.draw()
            self.noise[:] = self.drawn[self.used]
            self.used += 1
        self.samples[0] = float(self.ticks % self.hold_ticks == 0)
        self.ticks += 1
        self.function.evaluate()
        self.memory[:] = self.kept

    def draw(self) -> None:
        """Draws the noise of the next ticks."""
        self.drawn[:] = self._random.standard_normal(self.drawn.shape) * self._deviation
        self.used = 0
