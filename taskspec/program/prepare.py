"""Robot, start configuration, frames and surfaces of a task: what checks and stages build on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.contacts import Obstacles
from taskspec.program.context import Context
from taskspec.program.drives import drives
from taskspec.program.errors import spec_error
from taskspec.program.signals import gaps, normal
from taskspec.program.world import estimated_frames
from taskspec.program.world import frames as frame_models
from taskspec.program.world.bushings import bushing_models
from taskspec.program.world.equations import at_start, equation_models
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.holding import holding_start
from taskspec.program.world.mechanisms import MechanismModel, mechanism_models
from taskspec.program.world.moving_base import moving_bases
from taskspec.program.world.preconditions import (
    check_equations,
    check_meshes,
    check_motions,
    check_parents,
)
from taskspec.program.world.stiffness import compliance, equation_compliance
from taskspec.robot import RobotError, RobotModel, load_robot, solve_start
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.shapes import Surface, SurfaceChart
from taskspec.spec import FILE, LoadedTask, below
from taskspec.text.diagnostic import Diagnostic, SpecError

Vector = NDArray[np.float64]


def prepare(
    loaded: LoadedTask, robot: RobotModel | None = None, start: Vector | None = None
) -> Context:
    """Robot, start configuration, frames and surfaces of a task.

    Args:
        loaded: the task.
        robot: its model; None where it is to be loaded.
        start: (n,) where the run starts; None for the solution nearest home.

    Raises:
        SpecError: the robot cannot be loaded or its start cannot be reached.
    """
    task = loaded.task
    check_parents(loaded)
    check_meshes(loaded)
    models = mechanism_models(task)
    if robot is None or start is None:
        robot, start = _robot(loaded, models)
    arm = arm_at(robot, start)
    tip_p, tip_R, J = arm["start_p"], arm["start_R"], arm["start_jacobian"]
    surfaces = {name: frame_models.surface(shape) for name, shape in task.shapes.items()}
    bases = moving_bases(task)
    check_motions(loaded, bases)
    zero = ca.SX(0)
    distances = gaps(robot, surfaces, ca.SX(tip_p), ca.SX(tip_R), bases, zero)
    gap_at_start = {name: float(ca.evalf(d)) for name, d in distances.items()}
    normals = {
        name: np.array(ca.evalf(normal(s, ca.SX(tip_p), bases, name, zero))).ravel()
        for name, s in surfaces.items()
    }
    posture = task.robot.posture
    frames = frame_models.resolve(task)
    check_equations(loaded, frames, robot)
    equations = equation_models(task, frames)
    plant_period = 1.0 / task.control.plant_rate
    contacts = {
        name: compliance(shape, robot, start, plant_period) for name, shape in task.shapes.items()
    } | {
        name: equation_compliance(model, robot, start, task.equations[name], plant_period)
        for name, model in equations.items()
    }
    return Context(
        loaded=loaded,
        robot=robot,
        **arm,
        posture=start if posture is None else np.array(posture),
        frames=estimated_frames.with_nominal(
            frames, _expected_normal(robot, gap_at_start, normals), tip_p
        ),
        surfaces=surfaces,
        compliances=contacts,
        mechanisms=models,
        bushings=bushing_models(task),
        moving_bases=bases,
        equations=equations,
        start_equations={
            name: at_start(model, start, tip_p, tip_R, J) for name, model in equations.items()
        },
        start_gaps=gap_at_start,
        start_normals=normals,
        obstacles=Obstacles(
            robot, {o: s.uncut() for o, s in surfaces.items() if o not in task.carried}, bases
        ),
        drives=drives(robot, task.robot, task.control),
        period=1.0 / task.control.rate,
    )


def robot_faults(loaded: LoadedTask) -> tuple[Diagnostic, ...]:
    """What is wrong with the robot of a task and its start, which is no grasp."""
    try:
        _robot(loaded, {})
    except SpecError as error:
        return error.diagnostics
    return ()


def arm_at(robot: RobotModel, q: Vector) -> dict[str, Any]:
    """Quantities of an arm in a configuration (n,), as attributes of a `Context`."""
    terms = PinocchioTerms(robot)
    terms.at(q, np.zeros(robot.n))
    p, R = terms.tip()
    return {
        "start": q,
        "start_jacobian": terms.jacobian,
        "start_inertia": terms.inertia,
        "start_gravity": terms.gravity,
        "start_p": p,
        "start_R": R,
    }


def _expected_normal(
    robot: RobotModel, distances: Mapping[str, float], normals: Mapping[str, Vector]
) -> Vector:
    """(3,) outward normal of the object nearest to the tool; without one, up as the arm has it."""
    if distances:
        return normals[min(distances, key=lambda name: distances[name])]
    return np.array([0.0, 0.0, 1.0]) if "z" in robot.axes else np.array([0.0, 1.0, 0.0])


def _robot(loaded: LoadedTask, models: Mapping[str, MechanismModel]) -> tuple[RobotModel, Vector]:
    robot = loaded.task.robot
    try:
        model = load_robot(robot, loaded.base)
        start = robot.start
        if robot.grasp is not None:
            return model, holding_start(loaded, robot, model, models)
        xyz, rpy, joints = (start.xyz, start.rpy, start.joints) if start else (None, None, None)
        return model, solve_start(model, xyz, rpy, joints)
    except RobotError as error:
        raise spec_error(
            loaded, below(FILE.robot, *error.field), error.code, error.message, error.hint
        ) from error


def tool_center(context: Context) -> Vector:
    """(3,) the tool's reference point at the start pose, world [m]."""
    tool = context.robot.tool
    if tool.flat:
        return context.start_p
    return np.asarray(context.start_p + context.start_R @ tool.centers[0])


def chart_at(surface: Surface, center: Vector) -> SurfaceChart:
    """The part of a surface that a frame follows whose stage begins at a point (3,)."""
    return surface.chart(surface.face_at(ca.SX(center)))


def frame_at_start(context: Context, frame: FrameModel) -> Vector:
    """(3, 3) a frame's axes in the world at the start pose."""
    if frame.kind == "tracking":
        return frame.rotation
    if frame.still:
        return context.placed(frame)[0]
    if frame.mechanism is not None:
        axes = frame.mechanism.handle_axes(ca.SX(context.start_p))
        return np.asarray(np.array(ca.evalf(axes)) @ frame.rotation)
    if frame.kind == "tool":
        return context.start_R @ frame.rotation
    assert frame.surface is not None
    A, a = pose_of_base(context, frame)
    center = A.T @ (tool_center(context) - a)
    chart = chart_at(frame.surface, center)
    axes = np.array(ca.evalf(chart.frame(ca.SX(center), frame.heading)))
    return np.asarray(A @ axes)


def pose_of_base(context: Context, frame: FrameModel) -> tuple[Vector, Vector]:
    """(3, 3), (3,) where the object that carries a frame has been taken as the run begins."""
    base = context.base_of(frame)
    return (np.eye(3), np.zeros(3)) if base is None else base.pose(0.0)
