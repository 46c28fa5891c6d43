"""A plant by itself: a balanced arm in a world, pushed at its tip."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.robot import RobotModel, load_robot, solve_start
from taskspec.spec import load_text
from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]


class Pushed:
    """A plant whose arm's weight is carried, so that what is pushed with is what there is."""

    def __init__(
        self,
        world: str,
        robot: str = "",
        *,
        start: str = "[500 mm, 0, 400 mm]",
        damping: float = 0.0,
        rate: int = 1,
    ) -> None:
        """A panda at `start` in a `world` of YAML flow text.

        Args:
            world, robot: keys of the file. start: of the tip.
            damping: of the joints [N m s/rad].
            rate: of the plant [kHz].
        """
        text = (
            "taskspec: 1\nname: pushed\n"
            f"robot: {{model: panda, balanced: true, joint_damping: {damping} N*m*s/rad, "
            f"start: {{xyz: {start}}}, {robot}}}\n"
            f"control: {{plant_rate: {rate} kHz}}\nworld: {{{world}}}\n"
            "stages: {wait: {time: 1 s}}\n"
        )
        self.task = load_text(text, "pushed.yaml").task
        start_pose = self.task.robot.start
        assert start_pose is not None
        self.robot: RobotModel = load_robot(self.task.robot)
        self.start = solve_start(self.robot, start_pose.xyz, start_pose.rpy, start_pose.joints)
        self.plant = Plant(self.robot, self.task, self.start)
        self.model, self.data = self.plant.model, self.plant.data
        self.body = self.model.body(self.robot.tip_body).id

    @property
    def tip(self) -> Vector:
        """(3,) tip position at the beginning of the last step [m]."""
        return self.data.xpos[self.body]

    def jacobian(self) -> Vector:
        """(6, n) of the tip at the present state, world axes."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        J = np.zeros((6, self.model.nv))
        mujoco.mj_jac(self.model, self.data, J[:3], J[3:], self.tip, self.body)
        return J[:, : len(self.start)]

    def push(self, force: object, seconds: float, spring: float = 0.0) -> None:
        """Pushes at the tip with a force [N], or a wrench [N, N m].

        Joint springs [N m/rad] hold the start.
        """
        wrench = np.zeros(6)
        wrench[: np.size(force)] = force
        for _ in range(round(seconds * self.task.control.rate)):
            self.torque = self.jacobian().T @ wrench - spring * (self.plant.arm.q - self.start)
            self.plant.step(self.torque)

    def unbalanced(self) -> Vector:
        """(n,) joint torques [N m] that the held torque and the plant's wrench leave over."""
        return self.torque + self.jacobian().T @ self.plant.arm.wrench
