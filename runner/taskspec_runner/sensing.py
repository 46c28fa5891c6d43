"""What the robot gets to see of the plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.machine import Machine
from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]


class Sensing:
    """Joint state of this instant, and the contact wrench of the step before: one tick late.

    The wrench cannot come sooner: on a stiff contact it depends on the torque held when it arose.
    """

    def __init__(self, plant: Plant, machine: Machine) -> None:
        self._from = (plant.q, plant.v, plant.wrench)
        self._to = (machine.q, machine.v, machine.wrench)

    def read(self) -> None:
        """Copies the measurement into the controller's inputs."""
        (q, v, wrench), (seen_q, seen_v, seen_wrench) = self._from, self._to
        seen_q[:] = q
        seen_v[:] = v
        seen_wrench[:] = wrench
