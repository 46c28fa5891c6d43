"""Hybrid force/velocity control in a task frame (section 4.3.3): one loop for each axis."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from taskspec.control.reference import Reference
from taskspec.control.resolution import Command
from taskspec.control.state import TaskState


def hybrid(
    state: TaskState,
    reference: Reference,
    motion_stiffness: ca.DM,
    motion_damping: ca.DM,
    yielding: Sequence[str],
    drive: ca.SX,
    normal: Sequence[str] = (),
) -> Command:
    """Motion axes by acceleration, yielding axes (force and soft ones) by force.

    Motion axis:    x'' = x''_d + K_D e' + K_P e.
    Yielding axes:  the accelerations that make h z'' = u + f hold whatever f is measured, with
        h^-1 the block of J H^-1 J^T that belongs to them. Sent through the same core, so that
        the force does not shake the motion axes.

    Args:
        state: the arm at the control point.
        reference: e, x'_d, x''_d on the same axes.
        motion_stiffness, motion_damping: (m,) K_P [1/s^2] and K_D [1/s].
        yielding: names of the force-controlled and the soft axes.
        drive: (len(yielding),) u, the force [N, N m] that the robot applies on those axes.
        normal: names of the motion axes along a contact's normal.
    """
    velocity_error = reference.velocity - state.velocity
    acceleration = (
        reference.acceleration
        + motion_damping * velocity_error
        + motion_stiffness * reference.error
    )
    met = state.rows(normal)
    if met:
        acceleration[met] += state.mobility[met, met] @ (state.f[met] - reference.force[met])
    rows = state.rows(yielding)
    if rows:
        block = state.mobility[rows, rows]
        acceleration[rows] = reference.acceleration[rows] + block @ (drive + state.f[rows])
    return Command(acceleration=acceleration, wrench=-state.f)


def force_drive(
    desired: ca.SX,
    measured: ca.SX,
    integral: ca.SX,
    velocity: ca.SX,
    gains: tuple[float, float, float],
) -> ca.SX:
    """u = f_d + p (f_d - f) + i int (f_d - f) dt - d v of one force axis (docs/language.md).

    Forces are those that the robot applies [N, N m]; velocity is relative to the frame; gains are
    p [1], i [1/s], d [N s/m, N m s/rad].
    """
    p, i, d = gains
    return desired + p * (desired - measured) + i * integral - d * velocity


def soft_drive(error: ca.SX, error_rate: ca.SX, stiffness: float, damping: float) -> ca.SX:
    """u = D e' + K e of one soft axis, so that h e'' + D e' + K e = 0 in free space."""
    return damping * error_rate + stiffness * error
