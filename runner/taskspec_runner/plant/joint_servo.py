"""The robot's own joint servo: from what its joints are commanded to what its drives exert.

It ticks at its own rate, at the state that `mj_step1` has left, and holds its torques until the
next tick. Where it is stable as it is sampled stands in `taskspec.control.servo.growth`.
"""

from __future__ import annotations

import math

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.control.servo import Following, ServoReference, drive_gains, transition
from taskspec.native.kernel import Vector, Words, vector
from taskspec.program.bound import Wiring
from taskspec.spec import Task
from taskspec.spec.servo import POSITION, Joints
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.views import PlantViews

Array = NDArray[np.float64]

#: Numbers of a joint's reference: set point, position, velocity and acceleration.
_STATES = 4
#: Masses and their moments that differ by less are the same [kg, kg m].
_ROUNDING = 1e-9


class JointServo:
    """The servo of an arm that is commanded by velocity or by position.

    Its drives do not wind up: what the motors cannot exert, the reference is not ahead of the joint
    by. Of the arm it knows what the controller does: not friction and damping of the joints, not
    the weight that the tool has in truth alone, and not what is held.

    Attributes:
        command: (n,) of this control period [rad/s or rad; m/s or m].
        before: (n,) of the one before.
        positions: whether commands are positions.
        every: steps of the plant from tick to tick.
        ticks: of the servo in a control period.
        queue: (rows n,) commands by tick, the delay's worth of them, as a ring; `place` (1,) is the
            row that is next.
        delayed: (n,) what the servo takes in this tick.
        function: all of a tick.
        state: (4 n,) set point, reference, its velocity and its acceleration [rad or m, s], and
            `next_state` of the next tick.
        wanted: (n,) torque of this tick [N m, N].
        H: (nv nv,) inertia of all degrees of freedom, row by row.
        J, turning_J: (3 nv,) Jacobian of the tip's place and rotation, row by row, for a weight of
            the tool that nobody knows; `body` is the tip's.
        unknown: whether there is such a weight.
        exerted: (n,) what the drives exert at the end of a control period [N m, N].
        shown: (n,) view of the reference [rad, m].
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: SceneArm,
        task: Task,
        views: PlantViews,
    ) -> None:
        """Of an arm at rest at its start; `views` take what the drives exert."""
        self._model, self._data = model, data
        robot, servo, control = arm.robot, arm.declared.servo, task.control
        places, n = arm.places(model), arm.robot.n
        self.body, self._motors = places.tip, data.ctrl[places.motors]
        self.positions = arm.declared.command == POSITION
        self.every = round(control.plant_rate / servo.rate)
        self.ticks = round(servo.rate / control.rate)
        self.exerted, self.shown = views.exerted, views.servo
        rest = arm.start if self.positions else np.zeros(n)
        self.command, self.before = np.array(rest), np.array(rest)
        self.rows = servo.delay_ticks + 1
        self.queue, self.place = np.tile(rest, self.rows), np.zeros(1, dtype=np.int64)
        self.delayed, self.wanted = np.array(rest), np.zeros(n)
        self.state = np.concatenate([arm.start, arm.start, np.zeros((_STATES - 2) * n)])
        self.next_state = np.array(self.state)
        nv = model.nv
        self.H, self.J, self.turning_J = np.zeros(nv * nv), np.zeros(3 * nv), np.zeros(3 * nv)
        self.shown[:] = arm.start

        wiring, free = Wiring(), list(robot.coupling.free)
        own = places.velocities
        q = wiring.reads("q", data.qpos[places.positions])[free]
        v = wiring.reads("v", data.qvel[own])[free]
        A = ca.sparsify(ca.DM(robot.coupling.ratios))
        H = A.T @ ca.reshape(wiring.reads("H", self.H), nv, nv)[own, own] @ A
        bias = wiring.reads("bias", data.qfrc_bias[own])
        bias -= wiring.reads("counterweight", data.qfrc_gravcomp[own])
        missing = _unknown_weight(model, arm, places.tip)
        self.unknown = bool(missing.any())
        if self.unknown:
            bias += self._weight(wiring, missing, data.xmat[places.tip], nv)[own]
        w = wiring.numbers("frequency", 2 * math.pi * servo.bandwidth)
        zeta, h = wiring.numbers("ratio", servo.damping), wiring.numbers("period", 1 / servo.rate)
        limits = servo.velocity, servo.acceleration, servo.jerk
        names, usual = ("velocity", "acceleration", "jerk"), (robot.velocity_limit, np.inf, np.inf)
        following = Following(
            w,
            zeta,
            h,
            wiring.numbers(
                "transition",
                *transition(2 * math.pi * servo.bandwidth, servo.damping, 1 / servo.rate),
            ),
            *(
                wiring.numbers(name, *_of_joints(given, absent, n))
                for name, given, absent in zip(names, limits, usual, strict=True)
            ),
        )
        stiffness = None
        if servo.stiffness is not None:
            stiffness = wiring.numbers("stiffness", *_of_joints(servo.stiffness, 0.0, n))
        now = ServoReference(*ca.vertsplit(wiring.reads("state", self.state), n))
        command = wiring.reads("delayed", self.delayed)
        after = following.after(now, command, positions=self.positions)
        K, D = drive_gains(H, w, zeta, stiffness)
        ahead, faster = now.q - q, now.v - v
        wanted = H @ after.a + K @ ahead + D @ faster + A.T @ bias
        most = wiring.numbers("most", *robot.torque_limit)
        torque = ca.fmin(ca.fmax(wanted, -most), most)
        back, slower = _taken_back(wanted - torque, ahead, faster, ca.diag(K), ca.diag(D))
        r = after.r if self.positions else after.r - back
        state = ca.vertcat(r, after.q - back, after.v - slower, after.a)
        wiring.writes(state, self.next_state)
        wiring.writes(torque, self.wanted)
        self.function = wiring.bound("joint_servo")
        memory = vector(self.command), vector(self.before), vector(self.queue), vector(self.delayed)
        self._entered = (
            *(*memory, vector(self.place)),
            *(self.rows, n, self.ticks, int(self.positions)),
        )

    def _weight(self, wiring: Wiring, missing: Array, axes: Array, nv: int) -> ca.SX:
        """(nv,) what a weight, its mass and its moment in the tool's axes, exerts on joints."""
        mass, lever = wiring.numbers("mass", missing[0]), wiring.numbers("lever", *missing[1:])
        gravity = wiring.numbers("gravity", *self._model.opt.gravity)
        R = ca.reshape(wiring.reads("axes", axes), 3, 3).T
        J, turning = (
            ca.reshape(wiring.reads(name, getattr(self, name)), nv, 3).T
            for name in ("J", "turning_J")
        )
        return J.T @ (mass * gravity) + turning.T @ ca.cross(R @ lever, gravity)

    def serve(self, step: int) -> None:
        """A tick, if there is one in this step of the plant in the control period, from 0 on.

        The state is the one that `mj_step1` has left.
        """
        if step % self.every:
            return
        enter(*self._entered, step // self.every + 1)
        model, data, nv = self._model, self._data, self._model.nv
        mujoco.mj_fullM(model, data, self.H.reshape(nv, nv))
        if self.unknown:
            J, turning_J = self.J.reshape(3, nv), self.turning_J.reshape(3, nv)
            mujoco.mj_jacBody(model, data, J, turning_J, self.body)
        self.function.evaluate()
        self.state[:] = self.next_state
        self._motors[:] = self.wanted

    def show(self) -> None:
        """Writes what the drives exert, and the reference, for the log."""
        self.exerted[:] = self.wanted
        self.shown[:] = self.reference

    @property
    def reference(self) -> Array:
        """(n,) view of what it holds the joints to [rad, m]."""
        return self.state[len(self.wanted) : 2 * len(self.wanted)]

    @property
    def rate(self) -> Array:
        """(n,) view of the reference's velocity [rad/s, m/s]."""
        return self.state[2 * len(self.wanted) : 3 * len(self.wanted)]


def enter(
    command: Vector,
    before: Vector,
    queue: Vector,
    delayed: Vector,
    place: Words,
    rows: int,
    n: int,
    ticks: int,
    positions: int,
    tick: int,
) -> None:
    """Puts the command of a tick at the end of the queue, and takes what has waited; a kernel.

    Positions go to the command in a straight line, which it has reached after `ticks` of a period,
    of which `tick` counts from 1.
    """
    row = queue[place[0] * n :]
    for i in range(n):
        row[i] = command[i]
        if positions != 0 and tick < ticks:
            row[i] = before[i] + float(tick) / float(ticks) * (command[i] - before[i])
    if tick == ticks:
        for i in range(n):
            before[i] = command[i]
    place[0] = (place[0] + 1) % rows
    oldest = queue[place[0] * n :]
    for i in range(n):
        delayed[i] = oldest[i]


def _taken_back(
    excess: ca.SX, ahead: ca.SX, faster: ca.SX, stiffness: ca.SX, damping: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """(n,) by which references, and their velocities, are taken back to where motors reach.

    Never behind the joint, whatever other joints and the inertia want of the motor.
    """
    sign = ca.sign(excess)
    back = ca.fmin(ca.fabs(excess) / stiffness, ca.fmax(sign * ahead, 0))
    left = ca.fabs(excess) - stiffness * back
    slower = ca.fmin(left / damping, ca.fmax(sign * faster, 0))
    return sign * back, sign * slower


def _of_joints(given: Joints | float | None, absent: object, n: int) -> Array:
    """(n,) what is given for all joints or for each, or what stands for nothing."""
    return np.broadcast_to(np.array(absent if given is None else given, dtype=np.float64), n)


def _unknown_weight(model: mujoco.MjModel, arm: SceneArm, tip: int) -> Array:
    """(4,) mass [kg] of the true tool beyond the model's, and mass times lever from the tip."""
    known, mass = arm.robot.tool_body, model.body_mass[tip]
    lever = mass * model.body_ipos[tip] - known.mass * np.asarray(known.lever)
    missing = np.concatenate([[mass - known.mass], lever])
    return np.where(np.abs(missing) > _ROUNDING, missing, 0.0)
