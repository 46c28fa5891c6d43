"""What is measured of the plant."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from taskspec.program.execution.force_sensor import ForceSensor
from taskspec.program.execution.sensor_zero import SensorZero
from taskspec_runner.plant.plant import PlantArm

Vector = NDArray[np.float64]


class Sensed(Protocol):
    """Where what is measured goes, as a `Machine` has it."""

    @property
    def q(self) -> Vector: ...  # noqa: D102

    @property
    def v(self) -> Vector: ...  # noqa: D102

    @property
    def wrench(self) -> Vector: ...  # noqa: D102

    @property
    def reactions(self) -> Vector: ...  # noqa: D102

    @property
    def sensor(self) -> SensorZero | None: ...  # noqa: D102

    @property
    def period(self) -> float: ...  # noqa: D102


class Sensing:
    """Joint state of this instant, and the contact wrench of the step before: one tick late.

    The wrench cannot come sooner: on a stiff contact it depends on the torque held when it arose.
    So do the reactions of constraints on joints.

    Attributes:
        sensor: makes the readings; None where the wrench is measured as it is.
    """

    def __init__(self, arm: PlantArm, reactions: Vector, machine: Sensed, seed: int = 0) -> None:
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
        felt = arm.wrench if arm.wrist is None else arm.wrist
        self.sensor = (
            None
            if zero is None
            else ForceSensor(arm.sensor, felt, arm.tip_rotation, zero, machine.period, seed)
        )

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
