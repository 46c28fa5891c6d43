"""Measurements of the plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction, Wiring
from taskspec.program.execution.force_sensor import ForceSensor
from taskspec.program.execution.sensor_zero import SensorZero
from taskspec_runner.plant.plant import PlantArm

Vector = NDArray[np.float64]


class Sensed(Protocol):
    """The inputs of a `Machine` that measurements are written to."""

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
        encoder: makes the readings of the joints; None where these are exact.
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
        zero = machine.sensor
        # One function copies all of them in a third of the time that four assignments take.
        wiring = Wiring()
        self.encoder = None
        if arm.encoder is None:
            wiring.writes(wiring.reads("q", arm.q), machine.q)
        else:
            self.encoder = _encoder(arm.q, arm.encoder.resolution, machine.q)
        wiring.writes(wiring.reads("v", arm.v), machine.v)
        if reactions.size:
            wiring.writes(wiring.reads("reactions", reactions), machine.reactions)
        if zero is None:
            wiring.writes(wiring.reads("wrench", arm.wrench), machine.wrench)
        self._copied = wiring.bound("measured")
        wrench = arm.wrench if arm.wrist is None else arm.wrist
        self.sensor = (
            None
            if zero is None
            else ForceSensor(arm.sensor, wrench, arm.tip_rotation, zero, machine.period, seed)
        )

    def read(self) -> None:
        """Copies the measurement into the controller's inputs."""
        self._copied.evaluate()
        if self.encoder is not None:
            self.encoder.evaluate()
        if self.sensor is not None:
            self.sensor.read()


def _encoder(q: Vector, resolution: Sequence[float], shown: Vector) -> BoundFunction:
    """Has `shown` (n,) be positions q (n,) at the nearest lines, r floor(q / r + 1/2) [rad, m].

    A joint whose resolution r is 0 is shown as it is.
    """
    wiring = Wiring()
    true = wiring.reads("q", q)
    lines = wiring.numbers("resolution", *np.broadcast_to(resolution, len(q)))
    apart = lines > 0
    nearest = lines * ca.floor(true / (lines + (1 - apart)) + 0.5)
    wiring.writes(ca.if_else(apart, nearest, true), shown)
    return wiring.bound("encoder")
