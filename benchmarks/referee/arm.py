"""The model of the arm that controllers are given: the file's own, with its tool."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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

    def described(self) -> dict[str, Any]:
        """The model as plain numbers [SI], for a controller that has another Pinocchio."""
        model, data = self.model, self.model.createData()
        pin.computeJointJacobians(model, data, pin.neutral(model))
        joints = []
        for i in range(1, model.njoints):
            J = pin.getJointJacobian(model, data, i, pin.ReferenceFrame.LOCAL)[:, i - 1]
            turns = bool(np.any(J[3:]))
            body = model.inertias[i]
            joints.append(
                {
                    "parent": int(model.parents[i]),
                    "place": model.jointPlacements[i].homogeneous.tolist(),
                    "turns": turns,
                    "axis": (J[3:] if turns else J[:3]).tolist(),
                    "mass": float(body.mass),
                    "lever": body.lever.tolist(),
                    "inertia": body.inertia.tolist(),
                }
            )
        return {
            "joints": joints,
            "armature": np.asarray(model.armature).tolist(),
            "gravity": np.asarray(model.gravity.linear).tolist(),
            "tip_joint": int(self.robot.tip_joint),
            "tip": self.robot.tip.homogeneous.tolist(),
            "torque": self.robot.torque_limit.tolist(),
        }

    def inertia(self, q: Vector) -> Vector:
        """(n, n) M(q), armatures included."""
        M = pin.crba(self.model, self._data, q)
        return np.asarray(np.triu(M) + np.triu(M, 1).T)

    def bias(self, q: Vector, v: Vector) -> Vector:
        """(n,) C(q, v) v + g(q) [N m]."""
        return np.asarray(pin.nonLinearEffects(self.model, self._data, q, v))

    def tip_at(self, q: Vector) -> tuple[Vector, Vector]:
        """(3, 3) axes and (3,) place of the tip in the world [m], with joints at q (n,)."""
        pin.framesForwardKinematics(self.model, self._data, q)
        pose = self._data.oMf[self.tip]
        return pose.rotation.copy(), pose.translation.copy()

    def jacobian(self, q: Vector) -> Vector:
        """(6, n) of the tip, world axes, linear above angular."""
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.asarray(pin.computeFrameJacobian(self.model, self._data, q, self.tip, axes))
