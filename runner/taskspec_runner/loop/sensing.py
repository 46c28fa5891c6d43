"""What is measured of the plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.execution.machine import Machine
from taskspec.program.execution.sensor_zero import SensorZero
from taskspec.program.sensor import RunningSensor, SensorModel
from taskspec_runner.plant.plant import PlantArm

Vector = NDArray[np.float64]

#: Ticks whose noise is drawn at once.
_BLOCK = 500


class Sensing:
    """Joint state of this instant, and the contact wrench of the step before: one tick late.

    The wrench cannot come sooner: on a stiff contact it depends on the torque held when it arose.
    So do the reactions of constraints on joints.
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
        self._sensor = None if zero is None else ForceSensor(arm, zero, machine.period, seed)

    def read(self) -> None:
        """Copies the measurement into the controller's inputs."""
        (q, v, wrench), (measured_q, measured_v, measured_wrench) = self._from, self._to
        measured_q[:] = q
        measured_v[:] = v
        if self._reactions is not None:
            reactions, measured = self._reactions
            measured[:] = reactions
        if self._sensor is None:
            measured_wrench[:] = wrench
        else:
            self._sensor.read()


class ForceSensor:
    """A sensor that turns with the tool: bias and noise, low-pass, sample and hold, delay."""

    def __init__(self, arm: PlantArm, zero: SensorZero, period: float, seed: int) -> None:
        """The sensor of `arm`, whose readings `zero` gets; `period` is that of control [s]."""
        sensor = arm.sensor
        self._true = arm.wrench if arm.wrist is None else arm.wrist
        self._rotation = arm.tip_rotation
        self._to = zero.reading
        self._bias = np.array(sensor.bias)
        noise = sensor.noise
        deviations = (noise.force, noise.torque) if noise is not None else (0.0, 0.0)
        self._deviation = np.repeat(deviations, 3)
        # The generator is named, so that a seed means the same with every version of NumPy.
        self._random = np.random.Generator(np.random.PCG64(seed))
        self._noise: Vector = np.zeros((0, 6))
        self._drawn = 0
        # It has been switched on for long when the run begins.
        self._model = RunningSensor(SensorModel.of(sensor, period), self._biased())

    def read(self) -> None:
        """One tick; the reading goes to the controller."""
        raw = self._biased()
        if self._deviation.any():
            raw += self._next_noise()
        self._to[:] = self._model.step(raw)

    def _biased(self) -> Vector:
        """(6,) the true wrench in the axes that the tool had when it arose, with the bias."""
        parts = self._true.reshape(2, 3) @ self._rotation.reshape(3, 3)
        return np.asarray(parts.ravel() + self._bias)

    def _next_noise(self) -> Vector:
        if self._drawn == len(self._noise):
            self._noise = self._random.standard_normal((_BLOCK, 6)) * self._deviation
            self._drawn = 0
        self._drawn += 1
        return np.asarray(self._noise[self._drawn - 1])
