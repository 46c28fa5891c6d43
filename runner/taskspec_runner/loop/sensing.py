"""What is measured of the plant."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import Wiring, evaluated
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.sensor_zero import SensorZero
from taskspec.program.sensor import SensorModel
from taskspec_runner.plant.plant import PlantArm

Vector = NDArray[np.float64]

#: Ticks whose noise is drawn at once.
_BLOCK = 500


class Sensing:
    """Joint state of this instant, and the contact wrench of the step before: one tick late.

    The wrench cannot come sooner: on a stiff contact it depends on the torque held when it arose.
    So do the reactions of constraints on joints.

    Attributes:
        sensor: makes the readings; None where the wrench is measured as it is.
    """

    def __init__(self, arm: PlantArm, reactions: Vector, machine: Machine, seed: int = 0) -> None:
        """Connects an arm to its controller.

        Args:
            arm: that is measured.
            reactions: (equations,) of constraints on it.
            machine: that gets what is measured.
            seed: of the sensor's noise.
        """
        self._from = (arm.q, arm.v, arm.wrench)
        self._to = (machine.q, machine.v, machine.wrench)
        self._reactions = (reactions, machine.reactions) if reactions.size else None
        zero = machine.sensor
        self.sensor = None if zero is None else ForceSensor(arm, zero, machine.period, seed)

    def read(self) -> None:
        """Copies the measurement into the controller's inputs."""
        (q, v, wrench), (measured_q, measured_v, measured_wrench) = self._from, self._to
        measured_q[:] = q
        measured_v[:] = v
        if self._reactions is not None:
            reactions, measured = self._reactions
            measured[:] = reactions
        if self.sensor is None:
            measured_wrench[:] = wrench
        else:
            self.sensor.read()


class ForceSensor:
    """A sensor that turns with the tool: bias and noise, low-pass, sample and hold, delay.

    Attributes:
        function: the tick: what it feels, what it remembers -> the reading.
        memory, kept: (6 order,) what it remembers before the tick and after it.
        samples: (1,) 1 in a tick in which it samples, else 0.
        hold_ticks: every so many it does.
        noise: (6,) of the tick, in the tool's axes [N, N m].
        drawn: (block, 6) noise of the next ticks; empty where there is none.
        used: rows of it that have been.
        ticks: so far.
    """

    def __init__(self, arm: PlantArm, zero: SensorZero, period: float, seed: int) -> None:
        """The sensor of `arm`, whose readings `zero` gets; `period` is that of control [s]."""
        sensor = arm.sensor
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
        felt = arm.wrench if arm.wrist is None else arm.wrist
        wiring = Wiring()
        true, turned = wiring.reads("true", felt), wiring.reads("turned", arm.tip_rotation)
        R = ca.reshape(turned, 3, 3).T
        # In the axes that the tool had when the wrench arose.
        own = ca.vertcat(R.T @ true[:3], R.T @ true[3:]) + ca.DM(list(sensor.bias))
        memory = ca.reshape(wiring.reads("memory", self.memory), 6, model.order)
        noisy = own + wiring.reads("noise", self.noise)
        kept, reading = model.update(memory, noisy, wiring.reads("samples", self.samples))
        wiring.writes(reading, zero.reading)
        wiring.writes(ca.vec(kept), self.kept)
        self.function = wiring.bound("sensor")
        # It has been switched on for long when the run begins.
        (rest,) = evaluated(ca.Function("own", [true, turned], [own]), felt, arm.tip_rotation)
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
