"""The form that a law takes on a held mechanism: it drives what the mechanism leaves free.

A grip is stiff and damped well. A law that takes the measured wrench off, axis by axis, takes the
grip's damping off a tick late, and the masses that axes have by themselves may be hundreds of times
less than what the mechanism lets move. This form takes no measured force off: it works along the
twists that the mechanism leaves free, in units of the inertia L = Lambda, and the grip, which is
passive, holds the rest.

    F = L T s''                                        drive, s'' from the motion axes
      + S_m^T M_mm^-1 K_P (e - T T_m^+ e_m)             what of their error the grip holds
      - a (L - L A (A^T L A)^-1 A^T L) (v - v_d)        damper that does no work along A = [T T_o]
      + (I - L T (T^T L T)^-1 T^T) S_y^T w              forces of the other axes, without work on T

T are the free twists that motion axes m drive, T_o the others, both as columns, and

    s'' = T_m^+ (x''_d + K_P e + K_D x'_d) - T_m^+ K_D T_m s',    s' = (T^T L T)^-1 T^T L v.

Damper and rate feedback are symmetric in units of L, so that sampled they take at most a T and
K_D T of a rate, whatever the condition of M = L^-1.
"""

from __future__ import annotations

import casadi as ca

from taskspec.control import linear
from taskspec.control.command import Command
from taskspec.control.state import ARM_LENGTH
from taskspec.geometry.axis import Axis
from taskspec.laws.case import Case, FreeWays

#: The damper takes away what it damps at this rate [1/s], or at a third of the sampling's.
_RATE = 100.0


def damping_rate(period: float) -> float:
    """a [1/s] of the damper of the form, with a control period [s]."""
    return min(_RATE, 1 / (3 * period))


def command(
    case: Case, ways: FreeWays, drives: dict[Axis, ca.SX], K_P: ca.DM, K_D: ca.DM
) -> Command:
    """The form's command.

    Args:
        case: the stage.
        ways: what its mechanism leaves free.
        drives: what the robot applies on force axes and soft ones [N, N m], without the damper.
        K_P, K_D: (m,) of the motion axes [1/s^2, 1/s].
    """
    state, reference = case.state, case.reference
    m = len(state.axes)
    L = linear.solve(linear.cholesky(state.mobility), ca.SX.eye(m))
    moving = [a for a in state.axes if a not in drives]
    rows = state.rows(moving)
    others, T = ways.others, _clear_of(ways.driven, ways.others, L)

    wrench = ca.SX.zeros(m)
    for axis, drive in drives.items():
        wrench[state.axes.index(axis)] = drive
    acceleration = ca.SX.zeros(m)
    held = ca.SX(reference.error)
    if T.shape[1]:
        wanted = reference.acceleration + K_P * reference.error + K_D * reference.velocity
        inverse = _inverse(T[rows, :], moving)
        rate = linear.small_solve(T.T @ L @ T, T.T @ L @ state.velocity)
        drive = inverse @ (wanted[rows] - K_D[rows] * (T[rows, :] @ rate))
        acceleration = T @ drive
        held = held - T @ (inverse @ reference.error[rows])
        wrench = wrench - _onto(T, L, wrench)
    elif rows:
        acceleration[rows] = reference.acceleration[rows]
    if rows:
        block = linear.cholesky(state.mobility[rows, rows])
        wrench[rows] += linear.solve(block, K_P[rows] * held[rows])
    momentum = L @ (state.velocity - reference.velocity)
    free = ca.horzcat(T, others)
    if free.shape[1]:
        momentum = momentum - _onto(free, L, momentum)
    return Command(acceleration=acceleration, wrench=wrench - ways.rate * momentum)


def _clear_of(T: ca.SX, others: ca.SX, L: ca.SX) -> ca.SX:
    """The same directions, without what the arm would move along the others as it drives them."""
    if not (T.shape[1] and others.shape[1]):
        return T
    return T - others @ linear.small_solve(others.T @ L @ others, others.T @ L @ T)


def _inverse(T: ca.SX, axes: list[Axis]) -> ca.SX:
    """T^+ (d, r) of the driven rows (r, d); angles count as distances at the arm's length."""
    weight = ca.diag(ca.DM([ARM_LENGTH**2 if a.is_rotation else 1.0 for a in axes]))
    return linear.small_solve(T.T @ weight @ T, T.T @ weight)


def _onto(basis: ca.SX, L: ca.SX, wrench: ca.SX) -> ca.SX:
    """L B (B^T L B)^-1 B^T w: the part of a wrench that does work along the columns of B."""
    through = L @ basis
    return through @ linear.small_solve(basis.T @ through, basis.T @ wrench)
