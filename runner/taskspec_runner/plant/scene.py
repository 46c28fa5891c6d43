"""The scene: the robot with its tool, and the declared world as MuJoCo geoms and contact pairs."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec.robot import RobotModel
from taskspec.spec import Shape, Task
from taskspec_runner.plant import wrist
from taskspec_runner.plant.contact import contact_parameters
from taskspec_runner.plant.looks import dress

#: Names of the world's geoms and contact sensors begin with this.
PREFIX = "world/"
_COLORS = ((0.62, 0.66, 0.70, 1.0), (0.75, 0.62, 0.48, 1.0), (0.50, 0.62, 0.58, 1.0))
#: What is seen of a plane: half edge and half thickness of a slab below the tool [m].
_SLAB, _SLAB_THICKNESS = 0.22, 0.015


@dataclass(frozen=True, slots=True)
class Scene:
    """A compiled scene.

    Attributes:
        model: MuJoCo's model.
        objects: names of the world's objects, in the order of `sensors`.
        sensors: for each object the slice of `sensordata` that holds force (3), torque (3) and
            point (3) of the contact between tool and object, world axes.
    """

    model: mujoco.MjModel
    objects: tuple[str, ...]
    sensors: tuple[slice, ...]


def build_scene(robot: RobotModel, task: Task, start: NDArray[np.float64]) -> Scene:
    """Compiles the scene of a task.

    Args:
        robot: the arm; its MjSpec is copied, not changed.
        task: whose `world` and `control` are the true ones.
        start: (n,) joint positions where the run begins.
    """
    spec = robot.spec.copy()
    period = 1.0 / task.control.plant_rate
    option = spec.option
    option.timestep = period
    # A pyramidal cone makes the same contact several times too stiff; at impratio 1 friction is
    # viscous down to a few centimetres per second.
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 100.0
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance = 1e-14
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    # Otherwise a diverged state is reset in silence and the run goes on.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    dress(spec)
    damping = np.broadcast_to(task.robot.joint_damping, len(robot.joint_names))
    for joint, value in zip(robot.joint_names, damping, strict=True):
        spec.joint(joint).damping = [float(value), 0.0, 0.0]
    begin = task.robot.start
    near = None if begin is None or begin.xyz is None else np.array(begin.xyz)
    for number, (name, shape) in enumerate(task.shapes.items()):
        _add_object(spec, name, shape, near, _COLORS[number % len(_COLORS)])
        for geom in robot.tool_geoms:
            pair = spec.add_pair(geomname1=PREFIX + name, geomname2=geom, condim=3)
            contact_parameters(pair, shape, robot, start, period)
        spec.add_sensor(
            name=PREFIX + name,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=PREFIX + name,
            reftype=mujoco.mjtObj.mjOBJ_BODY,
            refname=robot.tip_body,
            intprm=[_FORCE_TORQUE_POINT, _NET_FORCE, 1],
        )
    if task.robot.sensor.at == "wrist":
        wrist.add(spec, robot.tip_body)
    model = spec.compile()
    addresses = [int(model.sensor(PREFIX + name).adr[0]) for name in task.shapes]
    sensors = tuple(slice(address, address + 9) for address in addresses)
    return Scene(model, tuple(task.shapes), sensors)


#: Data fields of a contact sensor: bits of force, torque and point.
_FORCE_TORQUE_POINT = (1 << 1) | (1 << 2) | (1 << 4)
#: Reduction of a contact sensor: one net wrench at the force-weighted centre, world axes.
_NET_FORCE = 3


def _add_object(
    spec: mujoco.MjSpec,
    name: str,
    shape: Shape,
    near: NDArray[np.float64] | None,
    color: tuple[float, float, float, float],
) -> None:
    kinds = {
        "plane": (mujoco.mjtGeom.mjGEOM_PLANE, [0.0, 0.0, 0.1]),
        "box": (mujoco.mjtGeom.mjGEOM_BOX, [s / 2 for s in shape.size or (0, 0, 0)]),
        "cylinder": (
            mujoco.mjtGeom.mjGEOM_CYLINDER,
            [shape.radius or 0.0, (shape.length or 0.0) / 2, 0.0],
        ),
        "sphere": (mujoco.mjtGeom.mjGEOM_SPHERE, [shape.radius or 0.0, 0.0, 0.0]),
    }
    kind, size = kinds[shape.shape]
    visible = list(color)
    if shape.shape == "plane":
        # The plane itself is endless; what is seen is a slab of it where the tool starts.
        visible[3] = 0.0
        _add_slab(spec, shape, near, color)
    spec.worldbody.add_geom(
        name=PREFIX + name,
        type=kind,
        size=size,
        pos=list(shape.xyz),
        quat=_quaternion(from_rpy(shape.rpy)),
        rgba=visible,
        contype=0,
        conaffinity=0,
    )


def _add_slab(
    spec: mujoco.MjSpec,
    shape: Shape,
    near: NDArray[np.float64] | None,
    color: tuple[float, float, float, float],
) -> None:
    R, origin = from_rpy(shape.rpy), np.array(shape.xyz)
    if near is not None:
        origin = near - R[:, 2] * float(R[:, 2] @ (near - origin))
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[_SLAB, _SLAB, _SLAB_THICKNESS],
        pos=(origin - R[:, 2] * _SLAB_THICKNESS).tolist(),
        quat=_quaternion(R),
        rgba=list(color),
        contype=0,
        conaffinity=0,
        group=1,
    )


def _quaternion(R: NDArray[np.float64]) -> list[float]:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R).ravel())
    return [float(value) for value in quaternion]
