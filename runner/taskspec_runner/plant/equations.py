"""Constraint equations in the plant: compliant contacts along their gradients.

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
from taskspec.program.world.equations import equation_models, reaction
from taskspec.program.world.stiffness import equation_compliance
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.plant.arm import SceneArm

Vector = NDArray[np.float64]
XBODY = mujoco.mjtObj.mjOBJ_XBODY


class Equations:
    """All equations of a task that springs keep, as forces on an arm.

    Attributes:
        on_tip: (3,) what the Cartesian ones exert on the tool tip, world axes [N].
        on_joints: (k,) what those on joints exert [N m, N]; `joints` is where that acts.
        applied: (equations,) what the robot applies along each unit gradient [N, N m]; of exact
            equations zero.
        function: tip, its velocity, q, q', clock, compliances -> these three.
        clock: (1,) of the simulator [s].
        twist: (6,) of the tip, its angular part first; `body` is the tip's, `tip` its place.
        cartesian: whether any acts on the tip.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: SceneArm,
        task: Task,
        applied: Vector,
    ) -> None:
        self._model, self._data = model, data
        places = arm.places(model)
        self.body, self.tip = places.tip, data.xpos[places.tip]
        self.applied, self.on_tip = applied, np.zeros(3)
        self.clock, self.twist = np.zeros(1), np.zeros(6)
        self.joints = data.qfrc_applied[places.velocities]
        self.on_joints = np.zeros(len(self.joints))
        q, v = data.qpos[places.positions], data.qvel[places.velocities]
        self.function = BoundFunction(
            reaction_function(task, len(q), arm.robot.coupling.free),
            [self.tip, self.twist[3:], q, v, self.clock, *_compliances(arm.robot, task, arm.start)],
            [self.on_tip, self.on_joints, self.applied],
        )
        self.cartesian = any(
            not each.equation.joints for each in task.equations.values() if not each.exact
        )
        self.nothing = np.zeros(3)

    def apply(self) -> None:
        """Adds the generalised forces at the pose and velocity that `mj_step1` has left."""
        model, data = self._model, self._data
        self.clock[0] = data.time
        if self.cartesian:
            mujoco.mj_objectVelocity(model, data, XBODY, self.body, self.twist, 0)
        self.function.evaluate()
        if self.cartesian:
            mujoco.mj_applyFT(
                model, data, self.on_tip, self.nothing, self.tip, self.body, data.qfrc_applied
            )
        self.joints += self.on_joints


def reaction_function(task: Task, joints: int, free: Sequence[int]) -> ca.Function:
    """Forces of all equations, which is the same function in worlds of other compliances.

    Args:
        task: with the equations.
        joints: of the arm.
        free: those of them that move by themselves, which are the ones that equations are about.

    Returns:
        Tip position and velocity (3,), q, q' (k,) of all joints, clock, stiffness and damping
        (equations,) -> the force on the tip (3,) [N] in the world, the torques on the joints (k,),
        and the (equations,) that the robot applies along each unit gradient [N, N m].
    """
    n, count, moved = joints, len(task.equations), list(free)
    p, dp, clock = ca.SX.sym("p", 3), ca.SX.sym("dp", 3), ca.SX.sym("clock")
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    stiffness, damping = ca.SX.sym("stiffness", count), ca.SX.sym("damping", count)
    on_tip, on_joints, applied = ca.SX.zeros(3), ca.SX.zeros(n), []
    for i, (name, model) in enumerate(equation_models(task).items()):
        if task.equations[name].exact:
            applied.append(ca.SX(0))
            continue
        place, rate = (q[moved], v[moved]) if model.joints else (p, dp)
        terms = model.terms(place, rate, clock)
        force = reaction(model, terms, rate, stiffness[i], damping[i])
        applied.append(force)
        if model.joints:
            on_joints[moved] -= force * terms.normal.T
        else:
            on_tip -= force * terms.normal.T
    outputs = [on_tip, on_joints, ca.vertcat(*applied)]
    inputs = [p, dp, q, v, clock, stiffness, damping]
    return ca.Function("equations", inputs, [ca.densify(x) for x in outputs])


def _compliances(robot: RobotModel, task: Task, start: Vector) -> tuple[Vector, Vector]:
    """(equations,) stiffness and damping [N/m, N s/m; N m/rad, N m s/rad]."""
    period = 1.0 / task.control.plant_rate
    found = [
        equation_compliance(model, robot, start, task.equations[name], period)
        for name, model in equation_models(task).items()
    ]
    return np.array([each.stiffness for each in found]), np.array([each.damping for each in found])
