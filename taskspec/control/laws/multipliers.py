"""Hybrid control under holonomic constraints (section 4.3.2): motion and multipliers apart.

Both laws are u = H (T E_2^T v_2 + Gamma) + C q' + g - J_phi^T (what they make of the multipliers).
The rows of J_phi are unit normals, so that multipliers are newtons (N m on joints).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from taskspec.control import constrained, linear
from taskspec.control.resolution import Command


@dataclass(frozen=True, slots=True)
class Multipliers:
    """Multipliers of a stage's m constraints, by the environment on the robot [N, N m].

    Attributes:
        J: (m, n) J_phi with unit normals. gamma: (m,) what J q'' has to cancel.
        directions: (n, m) T E_1^T.
        closing: (m,) J q' + r_t, zero on an ideal constraint [m/s, rad/s].
        desired, measured: (m,) lambda_d, lambda. integral: (m,) of lambda_d - lambda.
    """

    J: ca.SX
    gamma: ca.SX
    directions: ca.SX
    closing: ca.SX
    desired: ca.SX
    measured: ca.SX
    integral: ca.SX


def hybrid_multipliers(
    wanted: ca.SX,
    constraint: Multipliers,
    proportional: ca.DM,
    integral: ca.DM,
    damping: ca.DM,
    letting_go: ca.SX,
) -> Command:
    """PI on the multipliers, (4.104)-(4.106) and (4.117).

    lambda_c = lambda_d + K_lambda (lambda_d - lambda) + K_I int (lambda_d - lambda) dt

    Args:
        wanted: (n,) q'' that the motion loops ask for, q''_d + K_D e' + K_P e.
        constraint: the multipliers.
        proportional, integral: (m,) K_lambda [1], K_I [1/s].
        damping: (m,) along the normals [N s/m]; it does nothing on an ideal constraint.
        letting_go: wrench on the task axes that the last stage held and that fades.
    """
    error = constraint.desired - constraint.measured
    command = constraint.desired + proportional * error + integral * constraint.integral
    return _command(wanted, constraint, constraint.J.T @ command, damping, letting_go)


def hybrid_reaction(
    wanted: ca.SX,
    constraint: Multipliers,
    proportional: ca.DM,
    damping: ca.DM,
    letting_go: ca.SX,
) -> Command:
    """P on the reaction torque, (4.118)-(4.122).

    - J_phi^T lambda_d - T^-T E_1^T K_F E_1 T^T J_phi^T (lambda_d - lambda)

    Args:
        wanted: (n,) q'' that the motion loops ask for.
        constraint: the multipliers. proportional: (m,) K_F on the coordinates of q_1.
        damping: (m,) along the normals [N s/m]. letting_go: wrench that fades, on the task axes.
    """
    error = constraint.desired - constraint.measured
    # E_1 T^T J_phi^T, and with (4.94) T^-T E_1^T is J_phi^T times its inverse.
    on_first = (constraint.J @ constraint.directions).T
    correction = linear.small_solve(on_first, proportional * (on_first @ error))
    reaction = constraint.J.T @ (constraint.desired + correction)
    return _command(wanted, constraint, reaction, damping, letting_go)


def _command(
    wanted: ca.SX, on: Multipliers, reaction: ca.SX, damping: ca.DM, letting_go: ca.SX
) -> Command:
    return Command(
        wrench=letting_go,
        joint_acceleration=constrained.eliminate(on.J, on.gamma, on.directions, wanted),
        joint=-reaction - on.J.T @ (damping * on.closing),
    )
