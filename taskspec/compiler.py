"""From a loaded task to a program: robot, frames, stages as functions, and their machine."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.model_terms import ModelTerms
from taskspec.geometry.surface import box_face
from taskspec.program import frames as frame_models
from taskspec.program.axes import SkewedAxisError
from taskspec.program.context import Context
from taskspec.program.errors import spec_error
from taskspec.program.frames import FrameModel
from taskspec.program.machine import Machine
from taskspec.program.paths import path_shape
from taskspec.program.signals import gaps
from taskspec.program.stage import OUTPUTS, CompiledStage, compile_stage
from taskspec.program.stiffness import believed_stiffness
from taskspec.robot import RobotError, RobotModel, load_robot, solve_start
from taskspec.spec import LoadedTask

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Program:
    """A compiled task.

    Attributes:
        context: robot, start, frames, surfaces. stages: in the order of the file.
    """

    context: Context
    stages: tuple[CompiledStage, ...]

    @property
    def output_size(self) -> int:
        """Length of a machine's `outputs`."""
        return sum(length for _, length in OUTPUTS)

    def machine(
        self, views: tuple[Vector, Vector, Vector, Vector, Vector] | None = None
    ) -> Machine:
        """A fresh machine; `views` are 1-D arrays for q, v, wrench, torque and outputs."""
        n = self.context.robot.pin.nv
        own = views or (
            np.zeros(n), np.zeros(n), np.zeros(6), np.zeros(n), np.zeros(self.output_size)
        )  # fmt: skip
        return Machine(self.context.robot, self.stages, self.context.period, own)


def compile_task(loaded: LoadedTask) -> Program:
    """Compiles a task.

    Raises:
        SpecError: the robot, its start or an axis is not as the file says.
    """
    context = prepare(loaded)
    stages = tuple(_stage(context, name) for name in loaded.task.stages)
    return Program(context, stages)


def prepare(loaded: LoadedTask) -> Context:
    """Robot, start configuration, frames and surfaces of a task.

    Raises:
        SpecError: the robot cannot be loaded or its start cannot be reached.
    """
    task = loaded.task
    robot, start = _robot(loaded)
    terms = ModelTerms(robot)
    terms.update(start, np.zeros(robot.pin.nv))
    H, _, _, J_world, p, R, _ = terms.arrays
    Rj = R.reshape(3, 3, order="F")
    tip_p = p + Rj @ robot.tip.translation
    tip_R = Rj @ robot.tip.rotation
    n = robot.pin.nv
    J = J_world.reshape(6, n, order="F").copy()
    J[:3] -= pin.skew(tip_p) @ J[3:]
    inertia = np.triu(H.reshape(n, n, order="F"))
    surfaces = {name: frame_models.surface(shape) for name, shape in task.world.items()}
    distances = gaps(robot, surfaces, ca.SX(tip_p), ca.SX(tip_R))
    posture = task.robot.posture
    return Context(
        loaded=loaded,
        robot=robot,
        start=start,
        posture=start if posture is None else np.array(posture),
        frames=frame_models.resolve(task),
        surfaces=surfaces,
        stiffness=believed_stiffness(task, robot),
        start_jacobian=J,
        start_inertia=inertia + np.triu(inertia, 1).T,
        start_p=tip_p,
        start_R=tip_R,
        start_gaps={name: float(ca.evalf(d)) for name, d in distances.items()},
        period=1.0 / task.control.rate,
    )


def _robot(loaded: LoadedTask) -> tuple[RobotModel, Vector]:
    robot = loaded.task.robot
    try:
        model = load_robot(robot, loaded.base)
        start = robot.start
        xyz, rpy, joints = (start.xyz, start.rpy, start.joints) if start else (None, None, None)
        return model, solve_start(model, xyz, rpy, joints)
    except RobotError as error:
        raise spec_error(loaded, ("robot", *error.field), error.code, error.message, error.hint) from error


def frame_at_start(context: Context, frame: FrameModel) -> NDArray[np.float64]:
    """(3, 3) a frame's axes in the world at the start pose."""
    if frame.kind == "fixed":
        return frame.rotation
    if frame.kind == "tool":
        return context.start_R @ frame.rotation
    assert frame.surface is not None
    tool = context.robot.tool
    center = context.start_p if tool.flat else context.start_p + context.start_R @ tool.centers[0]
    face = None
    if frame.surface.kind == "box":
        face = ca.SX(box_face(frame.surface, frame.surface.face(center)))
    R = frame.surface.chart(face).frame(ca.SX(center), frame.heading)
    return np.array(ca.evalf(R))


def _stage(context: Context, name: str) -> CompiledStage:
    loaded = context.loaded
    stage = loaded.task.stages[name]
    rotation = frame_at_start(context, context.frame_of(stage))
    try:
        path = path_shape(context, name, rotation)
        return compile_stage(context, name, path, rotation)
    except SkewedAxisError as error:
        raise spec_error(
            loaded,
            ("stages", name, "frame"),
            "TS221",
            f"{error} in frame {context.frame_of(stage).name!r}",
            "align the frame with the plane in which the arm moves",
        ) from error
