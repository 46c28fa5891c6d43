"""The arm along a nominal trajectory: joint positions that go on from the last ones.

Unlike inverse kinematics, which searches any solution, this keeps to the branch that the arm is
on: joints wind up past half a turn, go beyond their limits if the trajectory requires it, and what
the task leaves free goes where the law's null space takes it.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control import null_space
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.program.stages.null_space import goals
from taskspec.robot.inverse_kinematics import turns_at

Vector = NDArray[np.float64]

#: The pose counts as taken at this error [m, rad].
_POSE_TOLERANCE = 1e-6
#: One that is missed by more than this is out of reach [m, rad].
_LARGEST_POSE_ERROR = 1e-4
_ITERATIONS = 30
_ITERATIONS_PER_MOBILITY = 3
#: No joint goes farther in one iteration [rad, m].
_STEP = 0.3
#: A posture is gone to with this time constant [s]: critically damped, 2 / w.
_SETTLES = 1.0 / (np.pi * null_space.FREQUENCY)


@dataclass(frozen=True, slots=True)
class Taken:
    """The joints that take a pose.

    Attributes:
        q: (n,) joint positions.
        pivot: the least pivot of J H^-1 J^T in the frame's axes [1/kg, 1/(kg m^2)], along the step.
        missed: (6,) by what the pose is missed [m, rad]; None where it is taken.
    """

    q: Vector
    pivot: float
    missed: Vector | None


class PoseFollower:
    """Follows poses with the joints of a robot, in the axes of one stage.

    Args:
        context: robot and posture.
        stage: whose axes are controlled.
    """

    def __init__(self, context: Context, stage: StagePlan) -> None:
        robot = context.robot
        fits = context.posture.shape == context.start.shape  # Else TS411 says so.
        self._robot, self._posture = robot, context.posture if fits else context.start
        self._twin = robot.twin()
        self._rows = [a.row for a in stage.axes]
        self._goals = goals(stage.law, robot, stage.axes)
        units = null_space.joint_units([turns_at(robot, i) for i in range(robot.n)])
        widths = null_space.widths(robot.lower, robot.upper, units)
        self._widths = np.where(widths > 0, widths, np.inf)

    def take(self, q: Vector, p: Vector, R: Vector, frame: Vector, lasts: float) -> Taken:
        """The joints that take a pose, near q (n,).

        Args:
            q: where they come from.
            p, R: (3,), (3, 3) of the tip.
            frame: (3, 3) whose axes are controlled.
            lasts: how long the null space has had to move since [s].
        """
        rows = self._rows
        inside = np.zeros((6, 6))
        inside[:3, :3] = inside[3:, 3:] = frame.T
        share = 1.0 - float(np.exp(-lasts / _SETTLES)) if self._goals else 0.0
        pivot, error = np.inf, np.zeros(6)
        for i in range(_ITERATIONS):
            at = self._twin.tip(q)
            error = np.concatenate([p - at.translation, pin.log3(R @ at.rotation.T)])
            e = (inside @ error)[rows]
            if share == 0.0 and math.sqrt(e @ e) < _POSE_TOLERANCE:
                break
            try:
                # Within a short step the arm's mobility hardly changes.
                if i % _ITERATIONS_PER_MOBILITY == 0:
                    J, mobile, mobility = self._mobility(q, inside)
                    pivot = min(pivot, float(np.diag(np.linalg.cholesky(mobility)).min()) ** 2)
                step = mobile @ np.linalg.solve(mobility, e)
                if share > 0.0:
                    pull = share * self._pull(q)
                    step += pull - mobile @ np.linalg.solve(mobility, J @ pull)
                    share = 0.0
            except np.linalg.LinAlgError:
                return Taken(q, 0.0, error)
            q = q + step * min(1.0, _STEP / max(float(np.abs(step).max()), 1e-12))
        kept = np.zeros(6)
        kept[rows] = (inside @ error)[rows]
        missed = float(np.linalg.norm(kept)) > _LARGEST_POSE_ERROR
        return Taken(q, pivot, kept if missed else None)

    def _mobility(self, q: Vector, inside: Vector) -> tuple[Vector, Vector, Vector]:
        """J (m, n), H^-1 J^T (n, m) and J H^-1 J^T (m, m) in the frame's axes."""
        J = (inside @ self._twin.jacobian(q))[self._rows]
        mobile = np.asarray(np.linalg.solve(self._twin.inertia(q), J.T))
        return J, mobile, J @ mobile

    def _pull(self, q: Vector) -> Vector:
        """(n,) pull of the goals that are followed here: the posture, and room to the limits."""
        pull = np.zeros_like(q)
        if "posture" in self._goals:
            pull += self._posture - q
        if "joint-limits" in self._goals:
            low = np.maximum(0.0, 1.0 - (q - self._robot.lower) / self._widths)
            high = np.maximum(0.0, 1.0 - (self._robot.upper - q) / self._widths)
            finite = np.isfinite(self._widths)
            pull += np.where(finite, np.where(finite, self._widths, 0.0) * (low**2 - high**2), 0.0)
        return pull
