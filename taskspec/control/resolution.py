"""From what a law wants to joint torques: inverse dynamics, with the posture in the null space."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from taskspec.control import linear
from taskspec.control.state import TaskState


@dataclass(frozen=True, slots=True)
class Command:
    """What a law asks for.

    Attributes:
        wrench: (m,) w*, sent through J^T.
        acceleration: (m,) a* for the inverse-dynamics core (4.14), or None for the laws that
            only send a wrench through J^T and compensate gravity.
        joint: (n,) torque added in the joints, such as their damping, or None.
        bare: nothing is compensated, not even gravity.
    """

    wrench: ca.SX
    acceleration: ca.SX | None = None
    joint: ca.SX | None = None
    bare: bool = False


def torque(
    command: Command, state: TaskState, H: ca.SX, bias: ca.SX, gravity: ca.SX, posture: ca.SX | None
) -> ca.SX:
    """Joint torques (n,) [N m] of a command.

    With a*:     u = J^T (Lambda (a* - J' q' - J q''_p) + w*) + H q''_p + C q' + g     (4.14)
    without a*:  u = J^T (w* - Lambda J q''_p) + H q''_p + g                           (4.21)

    Lambda = (J H^-1 J^T)^-1. For n = m this is the chapter's form, since H J^-1 = J^T Lambda. For
    n > m the posture's acceleration q''_p acts through (I - J^bar J) and leaves the task alone.

    Args:
        command: what the law wants on the m task axes.
        state: the arm on those axes.
        H: (n, n) joint inertia, upper triangle; bias: (n,) C q' + g; gravity: (n,) g.
        posture: (n,) desired null-space acceleration, None where the arm is not redundant.
    """
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
        u = u + (ca.triu2symm(ca.triu(H)) @ posture)
    return u


def posture_acceleration(q: ca.SX, v: ca.SX, target: ca.SX, frequency: float) -> ca.SX:
    """Critically damped acceleration (n,) towards the posture `target` (n,); frequency in Hz."""
    w = 2 * ca.pi * frequency
    return w**2 * (target - q) - 2 * w * v
