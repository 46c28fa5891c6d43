"""The model of the arm that controllers are given: the file's own, with its tool."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec import load
from taskspec.robot import load_robot

Vector = NDArray[np.float64]


class Arm:
    """Joint-space terms of an arm and its tool.

    Attributes:
        model: Pinocchio's.
        tip: number of the tip's frame.
    """

    def __init__(self, file: Path) -> None:
        """Takes the task file whose `robot` it is."""
        robot = load_robot(load(file).task.robot, file.parent)
        self.model = robot.pin.copy()
        self.tip = self.model.addFrame(
            pin.Frame("referee", robot.tip_joint, 0, robot.tip, pin.FrameType.OP_FRAME)
        )
        self.robot = robot
        self._data = self.model.createData()

    def inertia(self, q: Vector) -> Vector:
        """(n, n) M(q), armatures included."""
        M = pin.crba(self.model, self._data, q)
        return np.asarray(np.triu(M) + np.triu(M, 1).T)

    def bias(self, q: Vector, v: Vector) -> Vector:
        """(n,) C(q, v) v + g(q) [N m]."""
        return np.asarray(pin.nonLinearEffects(self.model, self._data, q, v))
