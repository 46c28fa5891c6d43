"""The joints of an arm under the torques of a log, where nothing touches its tool.

With the payload at r in the tool, its Jacobian J_r, joint damping D and Coulomb friction F, the
plant's step h accelerates the joints by a with

    (H + m J_r' J_r + h D) a = u - C v - g - m J_r' (J_r. v - g_0) - D v - F sign(v),

the damping of a step being that of its end. What is left of a log is that matrix times the
acceleration that was, less the one that a world predicts: where torques come with noise, it is that
noise, channel by channel. Derivatives are taken of the prediction alone, as the acceleration that
was has the noise in it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.robot.rebuild import GRAVITY
from taskspec.spec import Task
from taskspec_runner.identify.motion import LoggedMotion
from taskspec_runner.identify.rows import cross_rows
from taskspec_runner.plant.dry_friction import IMPEDANCE, SETTLING

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A joint that is slower than this may stick [rad/s, m/s].
_SLOW = 0.01
#: So many times as fast as it creeps at most it slides for sure.
_SURELY = 1.5
#: By so many deviations of its change from tick to tick an acceleration may be larger.
_SHAKEN = 4.0
#: Places of a payload of which terms are kept: one, and one beside it along each axis.
_KEPT = 4


class FreeJoints:
    """The joints in some ticks of a log.

    Attributes:
        rows: (k,) the ticks.
        exerted: (k, joints) torques of the log [N m, N].
    """

    def __init__(self, context: Context, motion: LoggedMotion, rows: NDArray[np.int64]) -> None:
        assert motion.exerted is not None
        self.rows, self.exerted = rows, motion.exerted[rows]
        self._R, self._J, self._drift = motion.R[rows], motion.jacobian[rows], motion.drift[rows]
        self._spin, self._rates = motion.twist[rows, 3:], motion.rates[rows]
        self._H, self._bias = motion.inertia[rows], motion.bias[rows]
        self._accelerated = motion.acceleration[rows]
        n = self._rates.shape[1]
        softness = (1 - IMPEDANCE) / IMPEDANCE
        self._softness = softness * context.robot.model.dof_invweight0[:n]
        # Of the step before, so that which ticks count does not go by the noise in them.
        shaken = np.std(np.diff(motion.acceleration, axis=0), axis=0) / 2**0.5
        self._before = np.abs(motion.acceleration[np.maximum(rows - 1, 0)]) + _SHAKEN * shaken
        self._kept: dict[tuple[float, float, float], tuple[Vector, Vector]] = {}
        self._step = 1.0 / context.loaded.task.control.plant_rate

    def sliding(self, friction: Vector) -> Mask:
        """(k, joints) where a joint moves so fast that it slides.

        A friction (joints,) that is too small leaves joints in that only creep, by which it then
        seems larger: from nothing on, iterations come to the true one.
        """
        # A joint creeps where its slip is small beside what friction and acceleration need.
        least = (self._before + _SURELY * friction * self._softness) * self._step / SETTLING
        return np.asarray(np.abs(self._rates) > np.maximum(least, _SLOW))

    def world(self, task: Task) -> tuple[Vector, Vector]:
        """(k, joints, joints) the matrix, (k, joints) the right-hand side."""
        robot, load = task.robot, task.robot.payload
        n = self._rates.shape[1]
        damping = np.broadcast_to(robot.joint_damping, n)
        known = self.exerted - self._bias - damping * self._rates
        known -= np.broadcast_to(robot.joint_friction, n) * np.sign(self._rates)
        H = self._H + self._step * np.diag(damping)
        if load is not None and load.mass:
            inertia, weight = self._carried(load.xyz)
            H += load.mass * inertia
            known -= load.mass * weight
        return H, known

    def _carried(self, xyz: Sequence[float]) -> tuple[Vector, Vector]:
        """(k, joints, joints) the matrix of 1 kg at a place of the tip, (k, joints) its torques."""
        place = float(xyz[0]), float(xyz[1]), float(xyz[2])
        if place not in self._kept:
            r = self._R @ np.array(place)
            J = self._J[:, :3].copy()
            for i in range(J.shape[2]):
                J[:, :, i] -= cross_rows(r, self._J[:, 3:, i])
            still = self._drift[:, :3] + cross_rows(self._drift[:, 3:], r)
            still += cross_rows(self._spin, cross_rows(self._spin, r)) - np.array(GRAVITY)
            turned = J.transpose(0, 2, 1)
            made = turned @ J, (turned @ still[..., None])[..., 0]
            self._kept = dict([*self._kept.items(), (place, made)][-_KEPT:])
        return self._kept[place]

    def accelerated(self, world: tuple[Vector, Vector], sliding: Mask | None) -> Vector:
        """(k, joints) the acceleration in a world.

        Args:
            world: its matrix and right-hand side.
            sliding: which joints slide, the others accelerate as they did; None where none sticks.
        """
        H, known = world
        if sliding is not None and not sliding.all():
            H = np.where(sliding[..., None], H, np.eye(H.shape[1]))
            known = np.where(sliding, known, self._accelerated)
        return np.asarray(np.linalg.solve(H, known[..., None])[..., 0])

    def left(self, metric: Vector, accelerated: Vector) -> Vector:
        """(k, joints) torques that a prediction leaves, by a world's matrix (k, joints, joints)."""
        return np.asarray((metric @ (self._accelerated - accelerated)[..., None])[..., 0])
