"""Where a stage comes to rest on springs in six dimensions, and what it presses with there.

The environment is f_a(x) of bushings and of equations that hold in both directions, (4.24) with a
K_e of any rank. On every axis of the stage's frame the law has one of three conditions,

    K_m e_i + f_a,i = 0      a spring of the law, (4.25),
    e_i = 0                  a motion loop with the force taken off, or with inertia alone,
    -f_a,i = f_d,i           a force loop with an integral,

six equations for six coordinates of the tip. In small displacements x_E is (4.26),
(K_m + K_e)^-1 (K_m x_d + K_e x_e); a rotation vector bends what a spring couples, so it is solved
by Newton's method from x_d on.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation as so3
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import BANDWIDTH, value_of
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.reference.orientation import representation_of
from taskspec.program.world import tip_pose
from taskspec.program.world.bushings import wrench_on_tip

Vector = NDArray[np.float64]

#: Steps after which Newton's method has converged, or does not.
_STEPS = 50
#: A step below this is none [m, rad].
_SOLVED = 1e-13


@dataclass(frozen=True, slots=True)
class Rest:
    """A stage at rest.

    Attributes:
        p, R: (3,), (3, 3) of the tip in the world.
        applied: (6,) what the robot applies at the tip, in the stage's axes [N, N m].
    """

    p: Vector
    R: Vector
    applied: Vector


def rest_pose(task: TaskPlan, plan: StagePlan) -> Rest | None:
    """A stage at rest on bushings, once ramps, blending and loops have settled.

    None where there is none in the world, or its law or the text of the task leave it open.
    """
    conditions = _conditions(plan)
    aim = _aim(task, plan) if conditions is not None else None
    if conditions is None or aim is None:
        return None
    spring, stiff, force = conditions
    wanted_p, wanted_R = aim
    frame = ca.DM(plan.rotation)
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 3)
    p, R = ca.DM(wanted_p) + a, so3.exp(b) @ ca.DM(wanted_R)
    turned = so3.log(ca.DM(wanted_R) @ R.T)
    error = ca.vertcat(frame.T @ -a, frame.T @ turned)
    on_tip = _environment(plan, p, R)
    applied = -ca.vertcat(frame.T @ on_tip[:3], frame.T @ on_tip[3:])
    # Lengths are as they are and forces by the law's own springs, so that rows compare.
    size = np.where(spring > 0, spring, 1.0)
    on_spring = (ca.DM(spring) * error - applied) / ca.DM(size)
    rows = [
        error[i] if stiff[i] else applied[i] - force[i] if np.isfinite(force[i]) else on_spring[i]
        for i in range(len(AXES))
    ]
    x = ca.vertcat(a, b)
    residual = ca.vertcat(*rows)
    step = ca.Function("step", [x], [residual, ca.jacobian(residual, x)])
    found = _solved(step)
    if found is None:
        return None
    at = ca.Function("at", [x], [p, R, applied])
    place, axes, effort = (np.array(part) for part in at(found))
    return Rest(place.ravel(), axes, effort.ravel())


def _conditions(plan: StagePlan) -> tuple[Vector, NDArray[np.bool_], Vector] | None:
    """(6,) springs of the law, axes where the error vanishes, forces of force loops (else nan).

    None where it is neither on each axis, or where the environment is more than springs.
    """
    context, law = plan.context, plan.law.control_law
    others = plan.contacts.touched or plan.contacts.gripped or plan.frame.at_origin or plan.met
    moves = plan.moving_base is not None or not plan.frame.still
    complete = plan.axes == AXES and representation_of(plan.law) is None
    if not context.bushings or others or moves or not complete or law.multipliers or plan.falls:
        return None
    if any(e.constraint.relation != "=" or e.joints for e in context.equations.values()):
        return None
    spring, stiff = np.zeros(6), np.zeros(6, dtype=bool)
    force = np.full(6, np.nan)
    for axis, one in plan.plans.items():
        own = value_of(plan.gains, "stiffness", axis)
        if one.force:
            value = None if one.axis.set_point is None else plan.known(one.axis.set_point.wanted)
            if value is None or value_of(plan.gains, "force.integral", axis) <= 0:
                return None
            force[axis.row] = value
        elif one.open_loop:
            if own <= 0 or _displaced(plan, axis) is None:
                return None
            spring[axis.row] = own
        elif not one.motion or one.mode.goes_on:
            return None
        elif law.force_loop and (own <= 0 or BANDWIDTH.name not in plan.gains):
            stiff[axis.row] = True
        elif own > 0:
            spring[axis.row] = own
        else:
            return None
    return spring, stiff, force


def _displaced(plan: StagePlan, axis: Axis) -> float | None:
    """f (1/k_m + 1/k_e), which an open-loop force displaces its reference by [m, rad]."""
    point, k = plan.plans[axis].axis.set_point, plan.environment.stiffness_of(axis)
    value = None if point is None else plan.known(point.wanted)
    own = value_of(plan.gains, "stiffness", axis)
    return None if value is None else value * (1 / own + (1 / k if k > 0 else 0.0))


def _aim(task: TaskPlan, plan: StagePlan) -> tuple[Vector, Vector] | None:
    """(3,), (3, 3) the reference pose of the tip as a stage's motion ends; None if unknown.

    References go from stage to stage, so it is that of all stages up to this one.
    """
    p, R = plan.context.start_p, plan.context.start_R
    for stage in task.stages.values():
        course, plans = stage.nominal.course, stage.plans.values()
        goes = any(one.mode.moves and not one.open_loop for one in plans if one.motion)
        if (course is None and goes) or not stage.frame.still or stage.frame.at_origin:
            return None
        moved = {} if course is None else course.moved(course.duration)
        own = np.array([moved.get(axis, 0.0) for axis in AXES])
        sprung = [axis for axis, one in stage.plans.items() if one.open_loop]
        if sprung and stage.name != next(iter(task.stages)):
            # Where a later one counts its displacement from is measured.
            return None
        for axis in sprung:
            own[axis.row] = _displaced(stage, axis) or 0.0
        if not np.isfinite(own).all() or (stage.spec.until is not None and own.any()):
            return None
        p = p + stage.rotation @ own[:3]
        R = np.array(ca.evalf(so3.exp(ca.SX(stage.rotation @ own[3:])))) @ R
        if stage.name == plan.name:
            return p, R
    return None


def _environment(plan: StagePlan, p: ca.SX, R: ca.SX) -> ca.SX:
    """(6,) wrench of bushings and equations on a tip at rest, world axes."""
    pose, found = tip_pose.pose(p, R), ca.SX.zeros(6)
    for model in plan.context.bushings.values():
        found += wrench_on_tip(pose, ca.SX.zeros(6), ca.SX(model.numbers))[0]
    for name, equation in plan.context.equations.items():
        terms = equation.terms(pose if equation.turns else p, ca.SX(0))
        force = plan.context.compliances[name].stiffness * terms.distance * terms.normal.T
        found[: force.shape[0]] -= force
    return found


def _solved(step: ca.Function) -> Vector | None:
    """The root (6,) of a residual and its Jacobian, from zero on."""
    x = np.zeros(6)
    for _ in range(_STEPS):
        residual, J = (np.array(part) for part in step(x))
        if not (np.isfinite(J).all() and np.linalg.matrix_rank(J) == len(x)):
            return None
        change = np.linalg.solve(J, residual.ravel())
        x = x - change
        if float(np.abs(change).max()) < _SOLVED:
            return x
    return None
