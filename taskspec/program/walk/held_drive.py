"""The lag of a held mechanism behind its reference under a law.

Arm and mechanism move together along the twists T s that the mechanism leaves free, one for its
coordinate and one for a free knob:

    (T^T L T + I e e^T) s'' + (T^T D T + d e e^T) s' + c e sign(s_0') = T^T F,   e = (1, 0),
    F = K (x_d - T_r s) + D_e (x_d - T_r s)'

with T_r as T, less what the stage's frame itself turns with the handle, the inertia L of the arm as
its law makes it, inertia I, damping d and friction c of the mechanism, and the wrench F of the
law's springs and dampers on the axes, at the start pose.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import on_axis
from taskspec.modes import Follows
from taskspec.program.passage import HeldDrive
from taskspec.program.plan import StagePlan
from taskspec.program.walk.held_motion import resolved_twists
from taskspec.program.walk.reference_motion import reference_motion, start_coordinates

Vector = NDArray[np.float64]

#: Steps of a course, which is implicit: what is quicker than a step is taken as settled.
_STEPS = 1000
#: A course is not followed any longer [s].
_HORIZON = 60.0
#: An axis that has less of the pseudoinverse's row does not drive the mechanism alone.
_ALONE = 0.9
#: From here on a moment at the joints does not determine the damping of an axis.
_SINGULAR = 1e8


@dataclass(frozen=True, slots=True)
class _Loop:
    """M s'' + D s' + K s = g(x_d), all along the free twists.

    Attributes:
        M, D, K: (k, k) inertia, damping and stiffness of arm, law and mechanism.
        pull: (k, 6) force per displacement of the axes' references, and per rate and acceleration.
        references: (3, 6) the same wrench on translations; None where that is not known.
        moves: (3, k) what the law applies there for s, and for its rate and acceleration.
    """

    M: Vector
    D: Vector
    K: Vector
    pull: tuple[Vector, Vector, Vector]
    references: tuple[Vector, Vector, Vector] | None = None
    moves: tuple[Vector, Vector, Vector] | None = None


def held_drive(stage: StagePlan) -> HeldDrive | None:
    """The course of the mechanism that a stage holds, as the law drives it.

    Args:
        stage: the first that moves it.

    Returns:
        None where nothing drives it, where the law takes off what it measures, so that it follows
        its reference whatever the mechanism bears, and where more than springs and friction acts.
    """
    context = stage.context
    declared = context.loaded.task.mechanisms.get(context.held)
    if declared is None or declared.detent is not None or stage.law.control_law.bare:
        return None
    motion = reference_motion(stage, start_coordinates(stage, context.start_p, context.start_R), {})
    if motion is None or not motion.displacements:
        return None
    loop = _loop(stage, declared.coordinate_inertia, declared.damping, list(motion.displacements))
    if loop is None:
        return None
    horizon = min(stage.longest, _HORIZON)
    times = np.linspace(0.0, horizon, _STEPS + 1)
    x = np.zeros((6, len(times)))
    for axis, displacement in motion.displacements.items():
        x[axis.row] = [displacement(t) for t in times.tolist()]
    if not np.isfinite(x).all():
        return None
    step = times[1]
    rates = np.diff(x, axis=1, prepend=x[:, :1]) / step
    gains = np.diff(rates, axis=1, prepend=rates[:, :1]) / step
    pulled = sum(P @ each for P, each in zip(loop.pull, (x, rates, gains), strict=True))
    s = _followed(loop, np.asarray(pulled), declared.friction, step)
    force = None
    if loop.references is not None and loop.moves is not None:
        v = np.diff(s, axis=1, prepend=0.0) / step
        a = np.diff(v, axis=1, prepend=0.0) / step
        parts = (
            *zip(loop.references, (x, rates, gains), strict=True),
            *zip(loop.moves, (s, v, a), strict=True),
        )
        force = np.linalg.norm(sum(P @ each for P, each in parts), axis=0)
    return HeldDrive(times, s[0], s[1] if len(s) > 1 else np.zeros(len(times)), force)


def _loop(stage: StagePlan, inertia: float, damping: float, moved: list[Axis]) -> _Loop | None:
    law, context = stage.law.control_law, stage.context
    model = context.mechanisms[context.held]
    twists = model.free_twists(context.start_p, context.start_p + stage.kinematics.lever)
    T = np.kron(np.eye(2), stage.rotation.T) @ twists
    form = stage.consistent and (law.selects or law.force_loop)
    if not form and law.force_loop and not law.natural:
        return None
    if T.shape[1] > 1 and law.force_loop:
        return None
    inside = resolved_twists(stage, context.start_p, stage.rotation)
    loop = _form(stage, T, inside, moved) if form else _springs(stage, T, inside)
    if loop is not None:
        loop.M[0, 0] += inertia
        loop.D[0, 0] += damping
    return loop


def _springs(stage: StagePlan, T: Vector, inside: Vector) -> _Loop | None:
    """Springs of the motion axes, dampers of all: on the error, on the velocity or the joints.

    Args:
        T: (6, k) free twists of the control point, in the axes of the stage's frame.
        inside: (6, k) the same, less what the frame itself turns.
    """
    law = stage.law.control_law
    gains = {a: on_axis(stage.gains, a) for a in stage.axes}
    # An apparent mass stands for the arm's own inertia.
    L = stage.kinematics.task_inertia
    if not (law.natural or stage.consistent):
        L = np.diag([gains[a]["mass"] if a in gains else 0.0 for a in AXES])
    K, on_error, drag = np.zeros(6), np.zeros(6), np.zeros((6, 6))
    for axis in stage.axes:
        drags = law.drag(gains[axis])
        if _moves(stage, axis):
            K[axis.row] = stage.spring_of(axis)
        if drags:
            drag[axis.row, axis.row] = drags
        elif drags is not None:
            on_error[axis.row] = gains[axis].get("damping", 0.0)
    if law.damps_joints:
        joints = _joint_damper(stage)
        if joints is None:
            return None
        drag += joints
    error, accelerates = np.diag(on_error), law.feeds_forward or not law.natural
    pull = T.T @ np.diag(K), T.T @ error, T.T @ L * accelerates
    damper = pull[1] @ inside + T.T @ drag @ T
    wrench = np.diag(K)[:3], error[:3], L[:3] * accelerates
    moves = -wrench[0] @ inside, -wrench[1] @ inside - drag[:3] @ T, -L[:3] @ T
    loop = _Loop(T.T @ L @ T, damper, pull[0] @ inside, pull, wrench, moves)
    # As the arm turns with a mechanism, damped joints press across its motion with something else.
    turns = law.damps_joints and stage.context.mechanisms[stage.context.held].angular
    return replace(loop, references=None) if turns else loop


def _form(stage: StagePlan, T: Vector, inside: Vector, moved: list[Axis]) -> _Loop | None:
    """The form for a held mechanism, whose one direction one axis drives (`laws.mechanism_form`).

    F = L T s'' + S_m^T M_mm^-1 K_P (e - T T_m^+ e_m),
    s'' = T_m^+ (x''_d + K_P e + K_D (x_d' - T s')).

    Args:
        T, inside: (6, 1) see `_springs`.
        moved: axes whose references move.
    """
    driving = [a for a in moved if _moves(stage, a)]
    if len(driving) != 1:
        return None
    (axis,) = driving
    gains = on_axis(stage.gains, axis)
    mass = gains.get("mass", 1.0)
    K_P = gains["K_P"] if "K_P" in gains else gains["stiffness"] / mass
    K_D = gains["K_D"] if "K_D" in gains else gains["damping"] / mass
    rows = [a.row for a in stage.axes if not (stage.plans[a].force or stage.plans[a].soft)]
    direction, size = T[rows, 0], np.array([1.0] * 3 + [ARM_LENGTH] * 3)[rows]
    i = rows.index(axis.row)
    if not direction[i] or not inside[axis.row, 0]:
        return None
    inverse = size[i] ** 2 * direction[i] / float(np.sum((size * direction) ** 2))
    if inverse * direction[i] < _ALONE:
        return None  # What the references of its other axes do decides with it.
    L = float(T[:, 0] @ stage.kinematics.task_inertia @ T[:, 0])
    held = (np.arange(len(rows)) == i) - direction * inverse
    works = float(direction @ np.linalg.solve(stage.kinematics.mobility[np.ix_(rows, rows)], held))
    one = np.zeros((1, 6))
    one[0, axis.row] = 1.0
    pull = (L * inverse + works) * K_P * one, L * inverse * K_D * one, L * inverse * one
    return _Loop(np.array([[L]]), pull[1] @ inside, pull[0] @ inside, pull)


def _moves(stage: StagePlan, axis: Axis) -> bool:
    plan = stage.plans[axis]
    return plan.motion and not plan.force and not isinstance(plan.mode, Follows)


def _joint_damper(stage: StagePlan) -> Vector | None:
    """(6, 6) what brakes the joints, on the axes: (J D^-1 J^T)^-1, the law's and their own."""
    rows = [a.row for a in stage.axes]
    own = np.array(stage.context.loaded.task.robot.joint_damping, dtype=float)
    damping = np.array([g.value for g in stage.gains["joint_damping"].values()]) + own
    if not (damping > 0).all():
        return None
    J = stage.kinematics.jacobian[rows]
    mobility = J / damping @ J.T
    if np.linalg.cond(mobility) > _SINGULAR:
        return None
    found = np.zeros((6, 6))
    found[np.ix_(rows, rows)] = np.linalg.inv(mobility)
    return found


def _followed(loop: _Loop, pulled: Vector, friction: float, step: float) -> Vector:
    """(k, n) s against time from rest, by implicit steps; friction c holds what pulls less."""
    A = np.linalg.inv(loop.M / step + loop.D + step * loop.K)
    if len(loop.M) == 1:
        return _one(loop, pulled[0], friction, step)
    (m00, m01), (m10, m11) = (loop.M / step).tolist()
    (k00, k01), (k10, k11) = loop.K.tolist()
    (a00, a01), (a10, a11) = A.tolist()
    x = y = v = w = 0.0
    found = [(x, y)]
    for f, g in pulled[:, 1:].T.tolist():
        f += m00 * v + m01 * w - k00 * x - k01 * y
        g += m10 * v + m11 * w - k10 * x - k11 * y
        v = a00 * f + a01 * g
        holds = min(max(v / a00, -friction), friction)
        v, w = v - a00 * holds, a10 * (f - holds) + a11 * g
        x, y = x + step * v, y + step * w
        found.append((x, y))
    return np.array(found).T


def _one(loop: _Loop, pulled: Vector, friction: float, step: float) -> Vector:
    """(1, n) the same of one direction."""
    m, d, k = (float(each[0, 0]) for each in (loop.M, loop.D, loop.K))
    m, a = m / step, 1 / (m / step + d + step * k)
    x = v = 0.0
    found = [x]
    for f in pulled[1:].tolist():
        pull = f + m * v - k * x
        # The friction that keeps the coordinate where it is, or all there is.
        v = a * (pull - min(max(pull, -friction), friction))
        x += step * v
        found.append(x)
    return np.array([found])
