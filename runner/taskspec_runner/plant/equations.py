"""Constraint equations and bushings in the plant: compliances along gradients, and to rest poses.

They are evaluated at the pose at which a step begins, from the functions that the controller has
too. A pose left over from the step before would cost k T of damping.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.world import tip_pose
from taskspec.program.world.bushings import bushing_models, wrench_on_tip
from taskspec.program.world.equations import equation_models, reaction
from taskspec.program.world.stiffness import equation_compliance
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.plant.arm import SceneArm

Vector = NDArray[np.float64]
XBODY = mujoco.mjtObj.mjOBJ_XBODY


class Equations:
    """All equations and bushings of a task that springs keep, as forces on an arm.

    Attributes:
        on_tip, about_tip: (3,) force and moment that the Cartesian ones exert at the tool tip,
            world axes [N, N m].
        on_joints: (k,) what those on joints exert [N m, N]; `joints` is where that acts.
        applied: (equations,) what the robot applies along each unit gradient [N, N m]; of exact
            equations zero.
        bushed: (6 bushings,) what it applies to each bushing, in that one's axes [N, N m].
        function: tip, its axes, its twist, q, q', clock, compliances -> these five.
        clock: (1,) of the simulator [s].
        twist: (6,) of the tip, its angular part first; `body` is the tip's, `tip` its place, `axes`
            (9,) its axes row by row.
        cartesian: whether any acts on the tip; turns: whether any exerts a moment there.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: SceneArm,
        task: Task,
        applied: Vector,
        bushed: Vector,
    ) -> None:
        self._model, self._data = model, data
        places = arm.places(model)
        self.body, self.tip = places.tip, data.xpos[places.tip]
        self.axes = data.xmat[places.tip]
        self.applied, self.bushed = applied, bushed
        self.on_tip, self.about_tip = np.zeros(3), np.zeros(3)
        self.clock, self.twist = np.zeros(1), np.zeros(6)
        self.joints = data.qfrc_applied[places.velocities]
        self.on_joints = np.zeros(len(self.joints))
        q, v = data.qpos[places.positions], data.qvel[places.velocities]
        self.function = BoundFunction(
            reaction_function(task, len(q), arm.robot.coupling.free),
            [
                *(self.tip, self.axes, self.twist, q, v, self.clock),
                *_compliances(arm.robot, task, arm.start),
            ],
            [self.on_tip, self.about_tip, self.on_joints, self.applied, self.bushed],
        )
        sprung = [each.equation for each in task.equations.values() if not each.exact]
        on_tip = [each for each in sprung if not each.joints]
        self.turns = bool(task.bushings) or any(each.turns for each in on_tip)
        self.cartesian = self.turns or bool(on_tip)

    def apply(self) -> None:
        """Adds the generalised forces at the pose and velocity that `mj_step1` has left."""
        model, data = self._model, self._data
        self.clock[0] = data.time
        if self.cartesian:
            mujoco.mj_objectVelocity(model, data, XBODY, self.body, self.twist, 0)
        self.function.evaluate()
        if self.cartesian:
            mujoco.mj_applyFT(
                model, data, self.on_tip, self.about_tip, self.tip, self.body, data.qfrc_applied
            )
        self.joints += self.on_joints


def reaction_function(task: Task, joints: int, free: Sequence[int]) -> ca.Function:
    """Forces of all equations and bushings: the same function in worlds of other compliances.

    Args:
        task: with them.
        joints: of the arm.
        free: those of them that move by themselves, which are the ones that equations are about.

    Returns:
        Tip position (3,), its axes (9,) row by row, its twist (6,) angular part first, q, q' (k,)
        of all joints, clock, stiffness and damping (equations,), numbers of the bushings (84 b,) ->
        force on the tip and moment about it (3,) [N, N m] in the world, the torques on the joints
        (k,), the (equations,) that the robot applies along each unit gradient [N, N m], and the
        (6 b,) that it applies to each bushing in that one's axes [N, N m].
    """
    n, count, moved = joints, len(task.equations), list(free)
    p, axes, clock = ca.SX.sym("p", 3), ca.SX.sym("axes", 9), ca.SX.sym("clock")
    rates = ca.SX.sym("rates", 6)
    R, twist = ca.reshape(axes, 3, 3).T, ca.vertcat(rates[3:], rates[:3])
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    stiffness, damping = ca.SX.sym("stiffness", count), ca.SX.sym("damping", count)
    numbers = ca.SX.sym("numbers", 84 * len(task.bushings))
    on_tip, about_tip, on_joints = ca.SX.zeros(3), ca.SX.zeros(3), ca.SX.zeros(n)
    applied, bushed = [], []
    for i, (name, model) in enumerate(equation_models(task).items()):
        if task.equations[name].exact:
            applied.append(ca.SX(0))
            continue
        rate = model.rate(v[moved], twist)
        terms = model.terms(model.place(q[moved], p, R), clock, rate)
        force = reaction(model, terms, rate, stiffness[i], damping[i])
        applied.append(force)
        if model.joints:
            on_joints[moved] -= force * terms.normal.T
        else:
            on_tip -= force * terms.normal[:3].T
            about_tip -= force * terms.normal[3:].T if model.turns else 0
    for each in ca.vertsplit(numbers, 84) if task.bushings else ():
        wrench, local = wrench_on_tip(tip_pose.pose(p, R), twist, each)
        on_tip += wrench[:3]
        about_tip += wrench[3:]
        bushed.append(local)
    applied, bushed = (ca.vertcat(ca.SX(0, 1), *each) for each in (applied, bushed))
    outputs = [on_tip, about_tip, on_joints, applied, bushed]
    inputs = [p, axes, rates, q, v, clock, stiffness, damping, numbers]
    return ca.Function("equations", inputs, [ca.densify(x) for x in outputs])


def _compliances(robot: RobotModel, task: Task, start: Vector) -> tuple[Vector, Vector, Vector]:
    """(equations,) stiffness and damping [N/m, N s/m; N m/rad, N m s/rad], (84 b,) bushings."""
    period = 1.0 / task.control.plant_rate
    found = [
        equation_compliance(model, robot, start, task.equations[name], period)
        for name, model in equation_models(task).items()
    ]
    numbers = [model.numbers for model in bushing_models(task).values()]
    return (
        np.array([each.stiffness for each in found]),
        np.array([each.damping for each in found]),
        np.concatenate([np.zeros(0), *numbers]),
    )
