"""Data that all stages of one task share while they are compiled."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.laws.friction import Compensation
from taskspec.program.contacts import Obstacles
from taskspec.program.drives import Drives
from taskspec.program.world.bushings import BushingModel
from taskspec.program.world.equations import EquationModel, StartEquation
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.program.world.stiffness import Compliance
from taskspec.robot import RobotModel
from taskspec.shapes import Surface
from taskspec.spec import LoadedTask


@dataclass(frozen=True, slots=True)
class Context:
    """One task's robot, start, frames and surfaces.

    Attributes:
        loaded: the task and its places in the file.
        robot: both models of the arm with its tool.
        start: (n,) joint configuration of the first tick.
        posture: (n,) of a redundant arm.
        frames: every frame of the file.
        surfaces: every object's geometry.
        compliances: nominal contact of each object.
        mechanisms: nominal geometry of each.
        moving_bases: of the objects that move by themselves.
        equations: every constraint equation.
        bushings: nominal springs between tip and world.
        start_equations: where they are at `start`.
        start_jacobian: (6, n) of the tip at `start`, world axes; start_inertia: (n, n) H there;
            start_gravity: (n,) g there.
        start_p, start_R: (3,), (3, 3) tip pose at `start`.
        start_gaps: distance [m] of the tool from each object there.
        start_normals: (3,) outward normal of each object at the tool, world.
        obstacles: the objects that the tool may touch.
        drives: what the joints are commanded.
        period: control period [s].
    """

    loaded: LoadedTask
    robot: RobotModel
    start: NDArray[np.float64]
    posture: NDArray[np.float64]
    frames: Mapping[str, FrameModel]
    surfaces: Mapping[str, Surface]
    compliances: Mapping[str, Compliance]
    equations: Mapping[str, EquationModel]
    start_equations: Mapping[str, StartEquation]
    mechanisms: Mapping[str, MechanismModel]
    bushings: Mapping[str, BushingModel]
    moving_bases: Mapping[str, MovingBase]
    start_jacobian: NDArray[np.float64]
    start_inertia: NDArray[np.float64]
    start_gravity: NDArray[np.float64]
    start_p: NDArray[np.float64]
    start_R: NDArray[np.float64]
    start_gaps: Mapping[str, float]
    start_normals: Mapping[str, NDArray[np.float64]]
    obstacles: Obstacles
    drives: Drives
    period: float

    @property
    def friction(self) -> Compensation | None:
        """What the controller compensates of the joints' friction; None for nothing."""
        task = self.loaded.task
        declared, robot, n = task.control.friction, task.robot, self.robot.n
        if declared is None:
            return None
        coulomb, viscous = (
            tuple((declared.share * np.broadcast_to(values, n)).tolist())
            for values in (robot.joint_friction, robot.joint_damping)
        )
        return Compensation(coulomb, viscous, declared.width, declared.time)

    @property
    def touchable_gaps(self) -> dict[str, float]:
        """Distance [m] at the start from each object but loose bodies that the tool carries."""
        carried = self.loaded.task.carried
        return {name: gap for name, gap in self.start_gaps.items() if name not in carried}

    @property
    def followed(self) -> int:
        """How many joints have a reference in any stage: all where there is a path of joints."""
        return self.robot.n if self.loaded.task.in_joints else 0

    @property
    def held(self) -> str:
        """The mechanism whose handle the robot holds; empty for none."""
        name = (self.loaded.task.robot.grasp or "").removesuffix(".handle")
        return name if name in self.mechanisms else ""

    def tracked(self, frame: FrameModel) -> MechanismModel | None:
        """The mechanism whose coordinate a stage in this frame keeps."""
        return frame.mechanism or self.mechanisms.get(self.held)

    def base_of(self, frame: FrameModel) -> MovingBase | None:
        """The motion of the object that carries a frame; None where none moves."""
        return self.moving_bases.get(frame.base_name)

    def placed(self, frame: FrameModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(3, 3), (3,) pose of a fixed frame in the world as the run begins."""
        moving_base = self.base_of(frame)
        if moving_base is None:
            return frame.rotation, frame.origin
        A, a = moving_base.pose(0.0)
        return A @ frame.rotation, A @ frame.origin + a
