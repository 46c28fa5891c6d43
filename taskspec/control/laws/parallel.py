"""Parallel force/position control (section 4.2): a force loop that wins over the position loop."""

from __future__ import annotations

import casadi as ca

from taskspec.control.reference import Reference
from taskspec.control.resolution import Command
from taskspec.control.state import TaskState


def parallel(
    state: TaskState,
    reference: Reference,
    mass: ca.DM,
    stiffness: ca.DM,
    damping: ca.DM,
    proportional: ca.DM,
    integral: ca.DM,
) -> Command:
    """Parallel control by inverse dynamics, (4.36)-(4.38).

    u_0 = x''_d + H_m^-1 (D_m e' + K_m e) - H_m^-1 (K_F (f_d - f) + K_I int (f_d - f) dt)

    With K_F = 1, K_I = 0 and f_d = 0 this is the impedance law (4.16).

    Args:
        state: the arm at the control point; f by the environment on the tool.
        reference: e, x'_d, x''_d, f_d and the integral of f_d - f (f_d in the sign of f).
        mass, stiffness, damping: (m,) diagonals of H_m, D_m, K_m.
        proportional, integral: (m,) K_F [1] and K_I [1/s]; zero on axes without a force.
    """
    velocity_error = reference.velocity - state.velocity
    motion = damping * velocity_error + stiffness * reference.error
    force = proportional * (reference.force - state.f) + integral * reference.force_integral
    return Command(acceleration=reference.acceleration + (motion - force) / mass, wrench=-state.f)


def parallel_pid(
    state: TaskState,
    reference: Reference,
    stiffness: ca.DM,
    damping: ca.DM,
    proportional: ca.DM,
    integral: ca.DM,
) -> Command:
    """The parallel PID regulator, (4.50): position PD, gravity, force feedforward and force PI.

    u = J^T [k_m e - d_m x' - (f_d + k_F (f_d - f) + k_I int (f_d - f) dt)] + g

    Needs no dynamic model but gravity; for set points.

    Args:
        state: the arm at the control point; f by the environment on the tool.
        reference: e, f_d and the integral of f_d - f (f_d in the sign of f).
        stiffness, damping: (m,) k_m and d_m. proportional, integral: (m,) k_F [1], k_I [1/s].
    """
    force = (
        reference.force
        + proportional * (reference.force - state.f)
        + integral * reference.force_integral
    )
    return Command(wrench=stiffness * reference.error - damping * state.velocity - force)
