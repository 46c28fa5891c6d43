"""The arm on a path of joints: where its tip is, how fast, and what its motors need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.motion.joint_path import JointPath
from taskspec.program.passage import End, Instant, Passage
from taskspec.program.plan import StagePlan
from taskspec.program.reference.joint_motion import JointMotion
from taskspec.program.reference.paths import joint_end
from taskspec.robot import RobotModel

Vector = NDArray[np.float64]

#: Instants at which a path is sampled.
_INSTANTS = 61


@dataclass(frozen=True, slots=True)
class JointState:
    """The joints at an instant of their path.

    Attributes:
        time: since the stage began [s].
        q, v, a: (n,) positions, rates and accelerations.
    """

    time: float
    q: Vector
    v: Vector
    a: Vector


def joint_states(path: JointPath | JointMotion, start: Vector) -> list[JointState]:
    """The joints along a path, from rest, at even times; empty where that is not known.

    Args:
        path: of the joints.
        start: (n,) where it begins.
    """
    if isinstance(path, JointMotion):
        if not path.predictable:
            return []
        times, states = path.at(start, _INSTANTS)
        return [JointState(time, *at) for time, *at in zip(times.tolist(), *states, strict=True)]
    timing = path.timing(start)
    found = []
    for time in np.linspace(0.0, float(timing.rests), _INSTANTS).tolist():
        i = timing.index(time)
        c0, c1, c2, c3 = timing.coefficients[i].tolist()
        x = time - float(timing.knots[i])
        s = c0 + x * (c1 + x * (c2 + x * c3))
        rate, grows = c1 + x * (2 * c2 + x * 3 * c3), 2 * c2 + 6 * x * c3
        piece = path.piece(start, s)
        found.append(JointState(time, path.at(start, s), rate * piece, grows * piece))
    return found


def torques(robot: RobotModel, state: JointState) -> Vector:
    """(n,) what moves the arm so, u = H q'' + C q' + g [N m, N]."""
    return robot.twin().torque(state.q, state.v, state.a)


def tip_at(robot: RobotModel, q: Vector) -> tuple[Vector, Vector]:
    """(3,), (3, 3) pose of the tip with the joints at q (n,), world axes."""
    at = robot.twin().tip(q)
    return at.translation, at.rotation


def end_of(stage: StagePlan) -> Vector | None:
    """(n,) where the path of joints of a stage ends; None where that is not known."""
    path = stage.joint_path
    if isinstance(path, JointPath):
        return np.array(path.targets[-1])
    assert path is not None
    return joint_end(stage.context, path.positions, path.time)


def joint_passage(stage: StagePlan, start: Vector) -> Passage | None:
    """The predicted motion of the arm on the path of joints of a stage; None where it has none.

    Args:
        stage: the stage.
        start: (n,) where its joints are as it begins.
    """
    path, robot = stage.joint_path, stage.context.robot
    assert path is not None
    twin, still = robot.twin(), dict.fromkeys(AXES, 0.0)
    frame = stage.kinematics.frame_at_tool
    inside = np.kron(np.eye(2), frame.T)
    instants: list[Instant] = []
    for state in joint_states(path, start):
        at, J = twin.tip(state.q), twin.jacobian(state.q)
        # Singular or not, the joints go on.
        instants.append(
            Instant(
                state.time, at.translation, at.rotation, frame, state.q, state.v,
                inside @ J @ state.v, None, np.inf, still,
            )
        )  # fmt: skip
        outside = np.maximum(state.q - robot.upper, robot.lower - state.q)
        if outside.max() > 0:
            return Passage(tuple(instants), End.JOINT, joint=int(np.argmax(outside)))
    return Passage(tuple(instants), End.DONE) if instants else None
