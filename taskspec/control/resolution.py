"""From what a law wants to joint torques: inverse dynamics, with the posture in the null space."""

from __future__ import annotations

import casadi as ca

from taskspec.control import linear
from taskspec.control.command import Command
from taskspec.control.state import TaskState


def torque(
    command: Command, state: TaskState, H: ca.SX, bias: ca.SX, gravity: ca.SX, posture: ca.SX | None
) -> ca.SX:
    """Joint torques (n,) [N m] of a command.

    With a*:     u = J^T (Lambda (a* - J' q' - J q''_p) + w*) + H q''_p + C q' + g     (4.14)
    without a*:  u = J^T (w* - Lambda J q''_p) + H q''_p + g                           (4.21)

    Lambda = (J H^-1 J^T)^-1. For n = m this is the chapter's form, since H J^-1 = J^T Lambda. For
    n > m the posture's acceleration q''_p acts through (I - J^bar J) and leaves the task alone.
    A command of joint accelerations is u = H q'' + C q' + g + J^T w*.

    Args:
        command: what the law wants on the m task axes.
        state: the arm on those axes.
        H: (n, n) joint inertia; bias: (n,) C q' + g; gravity: (n,) g.
        posture: (n,) desired null-space acceleration, None where the arm is not redundant.
    """
    if command.joint_acceleration is not None:
        u = H @ command.joint_acceleration + bias + state.J.T @ command.wrench
        return u if command.joint is None else u + command.joint
    task = command.wrench
    through_core = ca.SX.zeros(len(state.axes))
    if command.acceleration is not None:
        through_core = command.acceleration - state.drift
    if posture is not None:
        through_core = through_core - state.J @ posture
    if command.acceleration is not None or posture is not None:
        task = task + linear.solve(linear.cholesky(state.mobility), through_core)
    u = state.J.T @ task
    if not command.bare:
        u = u + (bias if command.acceleration is not None else gravity)
    if command.joint is not None:
        u = u + command.joint
    if posture is not None:
        u = u + H @ posture
    return u


def full_acceleration(acceleration: ca.SX, state: TaskState, posture: ca.SX | None) -> ca.SX:
    """q'' (n,) that gives the task its acceleration, J^bar (a* - J' q' - J q''_p) + q''_p.

    Args:
        acceleration: (m,) a*.
        state: the arm.
        posture: (n,) q''_p, None where the arm is not redundant.
    """
    return resolved(acceleration - state.drift, state, posture)


def resolved(rates: ca.SX, state: TaskState, posture: ca.SX | None) -> ca.SX:
    """Joint rates (n,) that give the task its own, J^bar (rates - J p) + p.

    Args:
        rates: (m,) of the axes.
        state: the arm.
        posture: (n,) p, None where the arm is not redundant.
    """
    if posture is not None:
        rates = rates - state.J @ posture
    found = inverse_directions(state) @ rates
    return found if posture is None else found + posture


def inverse_directions(state: TaskState) -> ca.SX:
    """J^bar = H^-1 J^T Lambda (n, m): joint accelerations of each task axis; J^-1 for n = m."""
    weighted = linear.solve(linear.cholesky(state.mobility), state.J)
    return linear.solve(state.H_factor, weighted.T)
