"""Impedance control (section 4.1): the robot as a mass, a spring and a damper."""

from __future__ import annotations

import casadi as ca

from taskspec.control.reference import Reference
from taskspec.control.resolution import Command
from taskspec.control.state import TaskState


def impedance(
    state: TaskState, reference: Reference, mass: ca.DM, stiffness: ca.DM, damping: ca.DM
) -> Command:
    """Impedance with force feedback, (4.16) and (4.17).

    u_0 = x''_d + H_m^-1 (D_m e' + K_m e + f), sent through the core that cancels f.

    Args:
        state: the arm at the control point.
        reference: e, x'_d, x''_d on the same axes.
        mass, stiffness, damping: (m,) diagonals of H_m, D_m, K_m in the task frame.
    """
    velocity_error = reference.velocity - state.velocity
    pull = damping * velocity_error + stiffness * reference.error + state.f
    return Command(acceleration=reference.acceleration + pull / mass, wrench=-state.f)


def impedance_natural(
    state: TaskState, reference: Reference, stiffness: ca.DM, damping: ca.DM
) -> Command:
    """Impedance at the robot's natural inertia, H_m = H_x(q), (4.18)-(4.20): no force sensor.

    u = H J^-1 (x''_d - J' q') + C q' + g + J^T (D_m e' + K_m e)
    """
    velocity_error = reference.velocity - state.velocity
    return Command(
        acceleration=reference.acceleration,
        wrench=damping * velocity_error + stiffness * reference.error,
    )


def pd(state: TaskState, reference: Reference, stiffness: ca.DM, damping: ca.DM) -> Command:
    """PD with gravity compensation, (4.21): u = J^T (K_m e - D_m x') + g."""
    return Command(wrench=stiffness * reference.error - damping * state.velocity)


def pd_joint(
    reference: Reference, joint_velocity: ca.SX, stiffness: ca.DM, joint_damping: ca.DM
) -> Command:
    """PD with the damping in the joints, (4.31): u = J^T K_m e - D_q q' + g.

    It also stops what a redundant arm does in its null space.

    Args:
        reference: e on the task axes.
        joint_velocity: (n,) q'. stiffness: (m,) K_m. joint_damping: (n,) D_q [N m s/rad].
    """
    return Command(wrench=stiffness * reference.error, joint=-joint_damping * joint_velocity)


def stiffness_control(reference: Reference, stiffness: ca.DM) -> Command:
    """Stiffness control, (4.32) and (4.33): u = J^T K_m J (q_d - q).

    For the small deflections that it is made for, J (q_d - q) is e (4.32). Gravity is left to a
    counterweight and damping to the joints: by itself it does not settle.
    """
    return Command(wrench=stiffness * reference.error, bare=True)
