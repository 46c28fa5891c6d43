"""What a stage under `solve: qp` may not do: limits as rows of one quadratic program.

The torque of the law's closed form is u*. The program looks for the torque u = u* + L x with the
least x^T P x, where H = L L^T. With P = 1 this is Gauss's principle of least constraint: the joint
accelerations change as little as they can, each measured by the inertia that it moves, so newtons,
metres and radians need no weights of their own. P has the null space give way before the motion on
the task axes, and that before the forces of contacts.

Joint accelerations and contact multipliers follow from the torque, (4.77) and (4.78), and x = 0
is the closed form itself: as long as it keeps every limit there is nothing to solve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from taskspec.control import linear
from taskspec.control.admissible import (
    braking_deceleration,
    highest_push,
    joint_accelerations,
)
from taskspec.control.model_terms import TermSymbols
from taskspec.control.state import TaskState
from taskspec.program.contacts import ContactRow
from taskspec.program.context import Context
from taskspec.spec import Limits
from taskspec.text.show import show

#: Where limits collide, the one that comes first here is kept.
TORQUE, JOINT, FORCE, SPEED = "torque", "joint", "force", "speed"
PRECEDENCE = (TORQUE, JOINT, FORCE, SPEED)

#: What a change of each part costs, in the metric of the inertia that it moves.
COST = {"force": 1e2, "motion": 1.0, "null space": 1e-2}

#: A limit that would stop the run is kept at this share, or this far inside.
FORCE_SHARE, SPEED_SHARE, VELOCITY_SHARE = 0.97, 0.98, 0.99
POSITION_MARGIN = 1e-3


@dataclass(frozen=True, slots=True)
class Row:
    """One limit: its kind, of `PRECEDENCE`, and what a reader calls it."""

    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class LimitRows:
    """lower <= A x <= upper, as expressions.

    Attributes:
        rows: what each of the m rows is. A: (m, n). lower, upper: (m,); x = 0 is u*.
        P: (n, n) what x costs. factor: (n, n) L. requests: (r, n) what x adds to the force along
            each of the requested directions.
    """

    rows: tuple[Row, ...]
    A: ca.SX
    lower: ca.SX
    upper: ca.SX
    P: ca.SX
    factor: ca.SX
    requests: ca.SX

    @property
    def violation(self) -> ca.SX:
        """How far u* is beyond its limits: not above 0 where it keeps all of them."""
        return ca.mmax(ca.vertcat(self.lower, -self.upper))


def limit_rows(
    *,
    context: Context,
    limits: Limits,
    state: TaskState,
    terms: TermSymbols,
    contacts: Sequence[ContactRow],
    requests: ca.SX,
    wanted: ca.SX,
    last: ca.SX | None,
    q: ca.SX,
    v: ca.SX,
    environment: ca.SX,
) -> LimitRows:
    """The limits of a stage, around the torque that its law asks for.

    Args:
        context: of the task. limits: of the stage. state: the arm on the task axes.
        terms: model terms, in the world. contacts: of the stage.
        requests: (r, n) rows along which the stage asks for forces.
        wanted: (n,) u* [N m]. last: (n,) the torque before, None without a limit on its rate.
        q, v: (n,) measured. environment: (n,) torque that the environment exerts [N m].
    """
    robot, n = context.robot, wanted.shape[0]
    L = state.H_factor
    acceleration = linear.solve(L, wanted + environment - terms.bias)
    from_joints = linear.backward(L, ca.SX.eye(n))
    on = _Contacts(contacts, L)
    rows: list[Row] = []
    A: list[ca.SX] = []
    bounds: list[tuple[ca.SX, ca.SX]] = []

    def add(kind: str, text: str, row: ca.SX, lower: ca.SX, upper: ca.SX) -> None:
        rows.append(Row(kind, text))
        A.append(row)
        bounds.append((lower, upper))

    most = ca.SX(ca.DM(robot.torque_limit))
    lowest, highest = -most, most
    if last is not None:
        assert limits.torque_rate is not None
        step = limits.torque_rate * context.period
        lowest, highest = ca.fmax(lowest, last - step), ca.fmin(highest, last + step)
    for i in range(n):
        if np.isfinite(robot.torque_limit[i]) or last is not None:
            add(
                TORQUE,
                f"torque of joint {i + 1}",
                L[i, :],
                (lowest - wanted)[i],
                (highest - wanted)[i],
            )
    least, greatest = _joint_bounds(context, q, v)
    for i in range(n):
        low, high, fastest = robot.lower[i], robot.upper[i], robot.velocity_limit[i]
        if np.isfinite([low, high, fastest]).any():
            add(
                JOINT,
                f"position and velocity of joint {i + 1}",
                from_joints[i, :],
                least[i] - acceleration[i],
                greatest[i] - acceleration[i],
            )
    push = on.multipliers(acceleration)
    cap = None if limits.force is None else FORCE_SHARE * limits.force
    for i, contact in enumerate(contacts):
        bound = _push_bounds(contact, cap, on.inertia[i, i], context.period)
        if bound is None:
            continue
        inactive = ca.logic_not(contact.active)
        text = f"force on {contact.name}"
        add(
            FORCE,
            text,
            contact.active * on.map[i, :],
            ca.if_else(inactive, -ca.inf, bound[0] - push[i]),
            ca.if_else(inactive, ca.inf, bound[1] - push[i]),
        )
    if limits.speed is not None:
        _add_speed(add, SPEED_SHARE * limits.speed, terms, acceleration, from_joints, context)

    rates = linear.forward(L, requests.T)
    weight = ca.vertcat(ca.SX(0, 1), *(ca.sumsqr(rates[:, k]) for k in range(rates.shape[1])))
    return LimitRows(
        rows=tuple(rows),
        A=ca.vertcat(ca.SX(0, n), *A),
        lower=ca.vertcat(ca.SX(0, 1), *(low for low, _ in bounds)),
        upper=ca.vertcat(ca.SX(0, 1), *(high for _, high in bounds)),
        P=_cost(state, on),
        factor=L,
        requests=rates.T / weight,
    )


def _joint_bounds(context: Context, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    robot = context.robot
    braking = braking_deceleration(robot.torque_limit, context.start_gravity, context.start_inertia)
    return joint_accelerations(
        q,
        v,
        (ca.DM(robot.lower + POSITION_MARGIN), ca.DM(robot.upper - POSITION_MARGIN)),
        ca.DM(VELOCITY_SHARE * robot.velocity_limit),
        ca.DM(np.maximum(braking, 1e-3)),
        context.period,
    )


class _Contacts:
    """Inertia and multipliers of the contacts that are there now; those that are not count as 0."""

    def __init__(self, contacts: Sequence[ContactRow], L: ca.SX) -> None:
        n, c = L.shape[0], len(contacts)
        self.contacts = contacts
        self.drift = ca.vertcat(ca.SX(0, 1), *(row.drift for row in contacts))
        self.measured = ca.vertcat(ca.SX(0, 1), *(row.measured for row in contacts))
        active = ca.vertcat(ca.SX(0, 1), *(row.active for row in contacts))
        self.J = ca.vertcat(ca.SX(0, n), *(row.J for row in contacts))
        self.C = linear.forward(L, self.J.T) @ ca.diag(active) if c else ca.SX(n, 0)
        mobility = self.C.T @ self.C + ca.diag(1 - active)
        self.inertia = linear.solve(linear.cholesky(mobility), ca.SX.eye(c)) if c else mobility
        #: (c, n) what x adds to the multipliers.
        self.map = self.inertia @ self.C.T

    def multipliers(self, acceleration: ca.SX) -> ca.SX:
        """What a rigid contact would return (c,), (4.77), as the robot applies it."""
        return self.measured + self.inertia @ (self.J @ acceleration + self.drift)


def _push_bounds(
    contact: ContactRow, cap: float | None, mass: ca.SX, period: float
) -> tuple[ca.SX, ca.SX] | None:
    """Bounds of one multiplier; None where it has none."""
    free = cap is None or contact.joints
    if free and not contact.pressed:
        return None
    lower = ca.SX(0) if contact.pressed else ca.SX(-ca.inf)
    upper = ca.SX(ca.inf)
    if not free:
        assert cap is not None
        k = contact.stiffness
        # What is measured is a period old.
        now = contact.measured + k * period * ca.fmax(contact.closing, 0)
        upper = highest_push(cap, now, contact.closing, mass, k)
        if contact.both_ways:
            back = -contact.measured + k * period * ca.fmax(-contact.closing, 0)
            lower = -highest_push(cap, back, -contact.closing, mass, k)
        lower = ca.fmin(lower, upper)
    return lower, upper


def _add_speed(
    add: object,
    fastest: float,
    terms: TermSymbols,
    acceleration: ca.SX,
    from_joints: ca.SX,
    context: Context,
) -> None:
    """Rows that keep the tip's speed: along the way it goes, and along the world's axes."""
    assert callable(add)
    J, v = terms.J[:3, :], terms.twist[:3]
    rate = J @ acceleration + terms.drift[:3]
    onto = J @ from_joints
    size = ca.norm_2(v)
    along = v / ca.fmax(size, 1e-6)
    add(
        SPEED,
        f"speed {show(fastest, 'mm/s')}",
        along.T @ onto,
        ca.SX(-ca.inf),
        (fastest - size) / context.period - ca.dot(along, rate),
    )
    for i, axis in enumerate("xyz"):
        if axis in context.robot.axes:
            add(
                SPEED,
                f"speed along {axis}",
                onto[i, :],
                (-fastest - v[i]) / context.period - rate[i],
                (fastest - v[i]) / context.period - rate[i],
            )


def _cost(state: TaskState, on: _Contacts) -> ca.SX:
    """P (n, n), by the orthogonal parts of x: null space, motion, contact force."""
    n = state.H_factor.shape[0]
    null, motion, force = (COST[part] for part in ("null space", "motion", "force"))
    P = motion * ca.SX.eye(n)
    if n > len(state.axes):
        T = linear.forward(state.H_factor, state.J.T)
        Y = linear.forward(linear.cholesky(state.mobility), T.T)
        P = null * ca.SX.eye(n) + (motion - null) * (Y.T @ Y)
    if on.contacts:
        P = P + (force - motion) * on.C @ on.map
    return P
