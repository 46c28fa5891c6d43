"""Joint positions that put the tool tip at a target pose."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from taskspec.deferred_methods import dataclass
from taskspec.robot.types import RobotModel

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

SOLVED = 1e-9
"""Norm of the error [m, rad] below which a target counts as reached."""

_TOLERANCE = 1e-12
_ITERATIONS = 300
_FURTHER = 100
"""Iterations after which a further solution is given up: those near home take a fifth of that."""
_STEP = 0.3
_LEAST_GAIN = 1e-7
_RESTARTS = 30
_NEAR_HOME = 1.0
_SOLUTIONS_WANTED = 12
_HOMING = 60
_MARGIN = 0.005
_LEAST_DAMPING = 1e-14
_KEPT = 256
"""Answers that are kept: worlds of a task, copies of a file and its later runs begin alike."""

_answers: dict[tuple[object, ...], tuple[Array, float]] = {}


def _norm(x: Array) -> float:
    """|x| of x (n,): what `np.linalg.norm` does, without its questions, at a third of its time."""
    return math.sqrt(x @ x)


def turns_at(robot: RobotModel, i: int) -> bool:
    """Whether joint `i`, counted from 0, is a hinge; else it slides."""
    return robot.hinges[i]


def least_turn(wanted: Array, given: Array) -> Array:
    """Of all rotations (3, 3) `wanted` turned about z, the one nearest `given`."""
    A = wanted @ given.T
    yaw = float(np.arctan2(A[0, 1] - A[1, 0], A[0, 0] + A[1, 1]))
    turned: Array = pin.rpy.rpyToMatrix(0.0, 0.0, yaw) @ wanted
    return turned


@dataclass(frozen=True, slots=True)
class Target:
    """The target of the tip.

    Attributes:
        position: (3,) [m], world.
        rotation: (3, 3) of the tip frame in the world; None leaves it free.
        weight: How much a metre counts against a radian where not both can be had.
        any_yaw: Whether the rotation may be turned about the world's z.
    """

    position: Array
    rotation: Array | None = None
    weight: float = 1.0
    any_yaw: bool = False

    @property
    def numbers(self) -> tuple[object, ...]:
        """All of it, to be compared bit for bit."""
        rotation = None if self.rotation is None else self.rotation.tobytes()
        return self.position.tobytes(), rotation, self.weight, self.any_yaw


class InverseKinematics:
    """Levenberg-Marquardt inside the joint limits, restarted from drawn configurations.

    It minimises |e(q)|², e = (p_d - p, log(R_d Rᵀ)), by q += Jᵀ(J Jᵀ + μ I)⁻¹ e, μ shrinking with
    success; joints that press against a limit take no part. Draws come from a fixed seed, so that
    equal questions have equal answers, and what was found for one is kept.
    """

    def __init__(self, robot: RobotModel) -> None:
        self.robot = robot
        self._twin = robot.twin()
        finite = np.isfinite(robot.upper - robot.lower)
        span = np.where(finite, robot.upper - robot.lower, 0.0)
        self.lower = robot.lower + _MARGIN * span
        self.upper = robot.upper - _MARGIN * span

    def pose(self, q: Array) -> pin.SE3:
        """The tip's pose in the world at `q` (n,)."""
        return self._twin.tip(q)

    def error(self, q: Array, target: Target) -> Array:
        """The pose error at `q` (n,), world: weighted translation, then rotation vector (6,).

        The rotation vector is left out where the target has no rotation, its z where the target
        leaves the yaw free.
        """
        at = self.pose(q)
        missing: Array = target.weight * (target.position - at.translation)
        if target.rotation is None:
            return missing
        wanted = target.rotation
        if target.any_yaw:
            wanted = least_turn(wanted, at.rotation)
        turn = pin.log3(wanted @ at.rotation.T)
        return np.concatenate((missing, turn[:2] if target.any_yaw else turn))

    def nearest_home(self, target: Target, restarts: int = _RESTARTS) -> tuple[Array, float]:
        """The solution nearest the robot's home, or the best that was found.

        Args:
            target: The target of the tip.
            restarts: From how many drawn configurations it is searched, in addition to home.

        Returns:
            Joint positions (n,) and the norm of their error, below `SOLVED` when the target is
            reached.
        """
        question = (self._arm, target.numbers, restarts)
        if question not in _answers:
            while len(_answers) >= _KEPT:
                del _answers[next(iter(_answers))]
            _answers[question] = self._search(target, restarts)
        q, missing = _answers[question]
        return q.copy(), missing

    @cached_property
    def _arm(self) -> tuple[object, ...]:
        """The part of the arm that a solution depends on."""
        robot = self.robot
        return (
            robot.pin.saveToString(),
            robot.coupling.content,
            robot.tip_joint,
            robot.tip.homogeneous.tobytes(),
            robot.home.tobytes(),
            robot.lower.tobytes(),
            robot.upper.tobytes(),
        )

    def _search(self, target: Target, restarts: int) -> tuple[Array, float]:
        """The solution nearest home, by search; see `nearest_home`."""
        home = self.robot.home
        best, least = self.descend(home, target)
        if least > SOLVED or np.abs(best - home).max() > _NEAR_HOME:
            found = [best] if least <= SOLVED else []
            for start in self._draws(restarts):
                q, missing = self.descend(start, target, _FURTHER if found else _ITERATIONS)
                if missing < least:
                    best, least = q, missing
                if missing <= SOLVED:
                    found.append(self._unwound(q))
                if len(found) == _SOLUTIONS_WANTED:
                    break
            if not found:
                return best, least
            best = min(found, key=lambda q: float(np.linalg.norm(q - home)))
        return self._homed(best, target)

    def descend(self, start: Array, target: Target, most: int = _ITERATIONS) -> tuple[Array, float]:
        """Descends from `start` (n,), in `most` iterations.

        Returns:
            The configuration found and its error's norm.
        """
        q = self._inside(start)
        e = self.error(q, target)
        size = _norm(e)
        damping, moved = 1e-4, True
        for _ in range(most):
            if size < _TOLERANCE or damping > 1e4:
                break
            if moved:
                J = self._jacobian(q, target)
                pull = J.T @ e
                pressed = ((q <= self.lower) & (pull < 0)) | ((q >= self.upper) & (pull > 0))
                J = np.where(pressed, 0.0, J)
                A = J @ J.T
                # Less than this, against the size of A, is lost in rounding: A may be singular.
                least = _LEAST_DAMPING * max(1.0, float(A.trace()))
                diagonal = A.ravel()[:: len(e) + 1].copy()
            A.ravel()[:: len(e) + 1] = diagonal + max(damping, least)
            step = J.T @ np.linalg.solve(A, e)
            step *= min(1.0, _STEP / max(float(np.abs(step).max()), _TOLERANCE))
            q_next = self._inside(q + step)
            e_next = self.error(q_next, target)
            size_next = _norm(e_next)
            moved = size_next < size
            if not moved:
                damping *= 10
                continue
            stalled = size - size_next < _LEAST_GAIN * size and size > SOLVED
            q, e, size, damping = q_next, e_next, size_next, max(damping / 10, _LEAST_DAMPING)
            if stalled:
                break
        return q, size

    def _homed(self, q: Array, target: Target) -> tuple[Array, float]:
        """Moves along the solutions of `target` towards home, as long as that comes nearer."""
        home = self.robot.home
        for _ in range(_HOMING):
            J = self._jacobian(q, target)
            away = home - q
            away = away - np.linalg.pinv(J, rcond=1e-6) @ (J @ away)
            if np.linalg.norm(away) < 1e-7:
                break
            q_next, missing = self.descend(
                q + away * min(1.0, _STEP / float(np.abs(away).max())), target
            )
            nearer = np.linalg.norm(q_next - home) < np.linalg.norm(q - home)
            if missing > SOLVED or not nearer:
                break
            q = q_next
        return q, float(np.linalg.norm(self.error(q, target)))

    def _inside(self, q: Array) -> Array:
        """The configuration nearest q (n,) that is within the limits."""
        # np.clip takes six times as long on arrays of this size.
        inside: Array = np.minimum(np.maximum(q, self.lower), self.upper)
        return inside

    def _jacobian(self, q: Array, target: Target) -> Array:
        J = self._twin.jacobian(q)
        J[:3] *= target.weight
        return J[: 3 if target.rotation is None else 5 if target.any_yaw else 6]

    def _draws(self, restarts: int) -> list[Array]:
        rng = np.random.default_rng(0)
        home = self.robot.home
        # A joint that turns more than once is drawn within half a turn of home.
        lower, upper = np.maximum(self.lower, home - np.pi), np.minimum(self.upper, home + np.pi)
        return [rng.uniform(lower, upper) for _ in range(restarts)]

    def _unwound(self, q: Array) -> Array:
        """The same pose with every hinge within half a turn of home, where its limits allow it."""
        turns = np.round((q - self.robot.home) / (2 * np.pi)) * self.robot.coupling.turns
        unwound = q - 2 * np.pi * turns
        fits = (unwound >= self.lower) & (unwound <= self.upper)
        return np.where(fits, unwound, q)
