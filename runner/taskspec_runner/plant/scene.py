"""The scene: the robot with its tool, and the declared world as MuJoCo's bodies and contacts."""

from __future__ import annotations

import mujoco
import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program.world.stiffness import friction_ratio
from taskspec.spec import Shape, Task
from taskspec_runner.plant import grasp
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.contact import add_loose_pairs, add_tool_pairs
from taskspec_runner.plant.coupled import add_coupling
from taskspec_runner.plant.dry_friction import set_friction
from taskspec_runner.plant.looks import add_stands, draw_mechanism, dress
from taskspec_runner.plant.mechanisms import add_mechanism, add_thread
from taskspec_runner.plant.moving_base import moving
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.plant.payload import weigh
from taskspec_runner.plant.shapes import COLORS, add_shape
from taskspec_runner.plant.whole import markers
from taskspec_runner.plant.wrist import add_wrist


@dataclass(frozen=True, slots=True)
class Scene:
    """A compiled scene.

    Attributes:
        model: MuJoCo's model; the arm's joints come first.
        arm: that it was built with.
        objects: names of the world's shapes, in the order of `sensors`.
        sensors: for each of them the slice of `sensordata` that holds force (3), torque (3) and
            point (3) of the contact between the arm's tool and the object, world axes.
    """

    model: mujoco.MjModel
    arm: SceneArm
    objects: tuple[str, ...]
    sensors: tuple[slice, ...]


def build_scene(arm: SceneArm, task: Task, *, drawn: bool = False) -> Scene:
    """Compiles the scene of a task.

    Args:
        arm, task, drawn: as `scene_spec` has them.
    """
    model = scene_spec(arm, task, drawn=drawn).compile()
    robot = arm.robot
    markers.connect(model)
    if arm.held:
        grasp.calibrate(model, arm)
    # The solver's tolerance is relative to this; what is driven has no bounds to its inertia.
    model.stat.meaninertia = robot.model.stat.meaninertia
    if moving(task):
        # Cameras go by these; the block that stands for a moving plane has no bounds either.
        model.stat.extent = robot.model.stat.extent
        model.stat.center = robot.model.stat.center
    addresses = [int(model.sensor(arm.element(name)).adr[0]) for name in task.shapes]
    sensors = tuple(slice(address, address + 9) for address in addresses)
    return Scene(model, arm, tuple(task.shapes), sensors)


def scene_spec(
    arm: SceneArm, task: Task, *, drawn: bool = False, whole: bool = True
) -> mujoco.MjSpec:
    """What the scene of a task is compiled of.

    Args:
        arm: in it; its MjSpec is copied, not changed.
        task: whose `world` and `control` are the true ones.
        drawn: whether pictures are made of it; light, sky and floor are most of the time that it
            takes.
        whole: whether surfaces that touch as a whole do so; the model then needs this process.
            Otherwise the tool touches with its spheres, as MuJoCo does by itself.
    """
    robot = arm.robot
    spec = robot.spec.copy()
    period = 1.0 / task.control.plant_rate
    _set_options(spec.option, period, friction_ratio(task))
    if drawn:
        dress(spec)
    joints, declared = robot.joint_names, arm.declared
    damping = np.broadcast_to(declared.joint_damping, len(joints))
    friction = np.broadcast_to(declared.joint_friction, len(joints))
    for joint, viscous, dry in zip(joints, damping, friction, strict=True):
        spec.joint(joint).damping = [float(viscous), 0.0, 0.0]
        set_friction(spec.joint(joint), float(dry), period)
    mobility = weigh(spec, arm)
    begin = arm.declared.start
    near = None if begin is None or begin.xyz is None else np.array(begin.xyz)
    carried = {}
    for number, (name, shape) in enumerate(task.shapes.items()):
        color = COLORS[number % len(COLORS)]
        if shape.carrier is not None:
            carried[name] = color
        else:
            add_shape(spec, name, shape, near, color)
        _add_sensor(spec, arm, name)
    if arm.declared.sensor.at == "wrist":
        add_wrist(spec, arm)
    _add_mechanisms(spec, arm, task)
    for name, color in carried.items():
        own = task.world[name]
        assert isinstance(own, Shape)
        add_shape(spec, name, task.shapes[name], near, color, own)
    if drawn:
        add_stands(spec, task)
    add_tool_pairs(spec, arm, task, mobility, whole=whole)
    add_loose_pairs(spec, task, whole=whole)
    return spec


def _set_options(option: mujoco.MjOption, period: float, ratio: float) -> None:
    option.timestep = period
    # A pyramidal cone makes the same contact several times too stiff; at impratio 1 friction is
    # viscous down to a few centimetres per second.
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = ratio
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    # From 60 degrees of freedom on it would be sparse, and MuJoCo 4.0.0's sparse Newton solver is
    # wrong by as much as the acceleration itself in some piles (repaired in 4.0.1). Below, dense is
    # what MuJoCo takes by itself.
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.tolerance = 1e-14
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    # Otherwise a diverged state is reset in silence and the run goes on.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET


def _add_mechanisms(spec: mujoco.MjSpec, arm: SceneArm, task: Task) -> None:
    """Mechanisms, and all that ties joints: the grip, the threads of screws, what joints follow."""
    period = 1.0 / task.control.plant_rate
    ridden = {shape.on for shape in task.shapes.values()}
    for name, declared in task.mechanisms.items():
        add_mechanism(spec, name, declared, period)
        draw_mechanism(spec, name, declared, handle=name == arm.held or name not in ridden)
    # The grip's rows come first among the constraints.
    if arm.held:
        grasp.add_grip(spec, arm, task)
    for name, declared in task.mechanisms.items():
        if declared.mechanism == "screw":
            add_thread(spec, name, declared.lead, period)
    add_coupling(spec, arm, period)


#: Data fields of a contact sensor: bits of force, torque and point.
_FORCE_TORQUE_POINT = (1 << 1) | (1 << 2) | (1 << 4)
#: Reduction of a contact sensor: one net wrench at the force-weighted centre, world axes.
_NET_FORCE = 3


def _add_sensor(spec: mujoco.MjSpec, arm: SceneArm, name: str) -> None:
    spec.add_sensor(
        name=arm.element(name),
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname=PREFIX + name,
        reftype=mujoco.mjtObj.mjOBJ_BODY,
        refname=arm.robot.tip_body,
        intprm=[_FORCE_TORQUE_POINT, _NET_FORCE, 1],
    )
