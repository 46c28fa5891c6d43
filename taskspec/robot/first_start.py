"""A start posture of an arm without one: bent, clear of its limits, tool down."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.robot.inverse_kinematics import InverseKinematics, Target
from taskspec.robot.types import RobotModel

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

#: Turns count as this length [m], as singular values of both kinds are compared.
_LEVER = 0.3
_DRAWS = 3000
_REFINED_DRAWS = 60
_TILT = math.radians(0.1)
_LARGEST_TILT = math.radians(30.0)
#: Joints keep this share of half their range to a limit, free ones count as centred.
_LIMIT_MARGIN = 0.15
#: Gravity takes at most this share of a motor's torque.
_BORNE = 0.6
_DOWN = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, slots=True)
class FirstStart:
    """A start and how much room there is around it.

    Attributes:
        q: (n,) joint positions [rad or m].
        tip: (3,) the tool's tip in the world [m].
        stroke: How far the tip goes along x and y, and half as far along z, with its joints clear
            of their limits [m].
        force: What every motor can press with in addition to its weight, at half its torque, along
            the world's z [N].
    """

    q: Array
    tip: Array
    stroke: float
    force: float


def reach_of(robot: RobotModel) -> float:
    """The greatest distance of the tip from the first joint, by its links' lengths [m]."""
    lengths = [
        math.hypot(*robot.pin.jointPlacements[i].translation) for i in range(2, robot.pin.njoints)
    ]
    return sum(map(float, lengths)) + math.hypot(*robot.tip.translation)


def first_starts(robot: RobotModel) -> Iterator[FirstStart]:
    """Starts above a horizontal surface, the best first.

    Drawn configurations whose tool points roughly down are turned until it does, and ordered by
    what is worst of: distance to a singularity, room to joint limits, torque left beside gravity.
    Draws come from a fixed seed.

    Args:
        robot: An arm that moves its tip along x, y and z.
    """
    solver = InverseKinematics(robot)
    reach = reach_of(robot)
    base = robot.pin.jointPlacements[1].translation
    ranked = []
    for q in _draws(solver):
        at = solver.pose(q)
        ahead = math.dist(at.translation[:2], base[:2]) / reach
        if at.rotation[2, 2] > -0.5 or not 0.25 < ahead < 0.85:
            continue
        ranked.append((_worst(robot, q, reach), q))
    ranked.sort(key=lambda each: -each[0])
    found = []
    for _, drawn in ranked[:_REFINED_DRAWS]:
        target = Target(solver.pose(drawn).translation, _DOWN, any_yaw=True)
        q, _ = solver.descend(drawn, target)
        tilt, most = _tilt(solver, q), _TILT
        if len(robot.axes) < 6 and tilt > _TILT:
            # An arm that cannot choose how it holds its tool does as well with it aslant.
            q, tilt, most = drawn, _tilt(solver, drawn), _LARGEST_TILT
        score = _worst(robot, q, reach)
        if score > 0 and tilt < most:
            found.append((score - 0.1 * tilt, q))
    found.sort(key=lambda each: -each[0])
    for _, q in found:
        start = _around(robot, solver, q, reach)
        if start is not None:
            yield start


def _tilt(solver: InverseKinematics, q: Array) -> float:
    """The angle of the tool at `q` (n,) to straight down."""
    return math.acos(min(1.0, max(-1.0, -float(solver.pose(q).rotation[2, 2]))))


def _draws(solver: InverseKinematics) -> Iterator[Array]:
    robot, rng = solver.robot, np.random.default_rng(0)
    lower = np.maximum(solver.lower, robot.home - np.pi)
    upper = np.minimum(solver.upper, robot.home + np.pi)
    middle, half = (upper + lower) / 2, (upper - lower) / 2
    # The first turning joint points ahead, where that is within its range.
    first = next((i for i, turns in enumerate(robot.hinges) if turns), 0)
    for _ in range(_DRAWS):
        q = middle + (1 - _LIMIT_MARGIN) * half * rng.uniform(-1, 1, len(half))
        if lower[first] <= 0 <= upper[first]:
            q[first] = 0.3 * rng.uniform(max(-1.0, lower[first]), min(1.0, upper[first]))
        yield q


def _worst(robot: RobotModel, q: Array, reach: float) -> float:
    """The worst score of a configuration, 0 where it cannot be used."""
    return min(_dexterity(robot, q, reach), _room(robot, q), _spare(robot, q))


def _dexterity(robot: RobotModel, q: Array, reach: float) -> float:
    J = robot.twin().resolved_jacobian(q)
    scale = np.array([1, 1, 1, _LEVER, _LEVER, _LEVER]) / reach
    rows = [i for i, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")) if axis in robot.axes]
    return float(np.linalg.svd((J * scale[:, None])[rows], compute_uv=False)[-1])


def _room(robot: RobotModel, q: Array) -> float:
    half = (robot.upper - robot.lower) / 2
    room = np.minimum(q - robot.lower, robot.upper - q)
    limited = np.isfinite(half) & (half > 0)
    return float(np.min(room[limited] / half[limited], initial=1.0)) - _LIMIT_MARGIN


def _spare(robot: RobotModel, q: Array) -> float:
    gravity = robot.twin().gravity(q)
    return _BORNE - float((np.abs(gravity) / robot.torque_limit).max())


def _around(
    robot: RobotModel, solver: InverseKinematics, q: Array, reach: float
) -> FirstStart | None:
    """The start at `q` (n,) where the tip can go about there; None where it cannot."""
    at = solver.pose(q)
    stroke = 0.08 * reach
    turned = at.rotation if len(robot.axes) == 6 else None
    worst = _spare(robot, q)
    for corner in ((1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0), (0, 0, -0.7), (0, 0, 0.7)):
        place = at.translation + stroke * np.array(corner)
        there, missing = solver.descend(q, Target(place, turned))
        if missing > 1e-6 or min(_dexterity(robot, there, reach), _room(robot, there)) <= 0.02:
            return None
        worst = min(worst, _spare(robot, there))
    if worst <= 0:
        return None
    twin = robot.twin()
    J, gravity = twin.resolved_jacobian(q), twin.gravity(q)
    left = 0.5 * (robot.torque_limit - np.abs(gravity))
    force = float(np.min(left / np.maximum(np.abs(J[2]), 1e-9)))
    return FirstStart(q, at.translation, stroke, force)
