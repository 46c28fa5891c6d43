"""What a stage under `solve: qp` may not do: limits as rows of one quadratic program.

The torque of the law's closed form is u*. The program looks for the torque u = u* + L x with the
least x^T P x, where H = L L^T. With P = 1 this is Gauss's principle of least constraint: the joint
accelerations change as little as they can, each measured by the inertia that it moves, so newtons,
metres and radians need no weights of their own. P has the null space give way before the motion on
the task axes, and that before the forces of contacts.

Joint accelerations and contact multipliers follow from the torque, (4.77) and (4.78), and x = 0
is the closed form itself: as long as it keeps every limit there is nothing to solve. Before that
the pushes on contacts are brought within their bounds along the normals alone, through the same
inverse dynamics as the law's forces, so that a capped force does not shake the other axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from taskspec.control import linear
from taskspec.control.admissible import (
    BRAKING,
    approach,
    braking_deceleration,
    highest_push,
    joint_accelerations,
)
from taskspec.control.model_terms import TermSymbols
from taskspec.control.state import TaskState
from taskspec.program.consistency import tangents
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
#: The tip's speed may turn aside by this share of its limit in one control period. With it
#: sqrt(1 + 2 * 0.1^2) * 0.98 = 0.99 of the limit are the most there is.
TURN_SHARE = 0.1
#: A push this far [N] beyond its bounds is within them but for rounding.
_ROUNDING = 1e-6
#: Square of the share of a contact's normal that the task's axes have to have.
_UNREACHED = 1e-9
#: Carries a NaN over, and nothing else.
_NOTHING = 1e-300


@dataclass(frozen=True, slots=True)
class Row:
    """One limit: its kind, of `PRECEDENCE`, and what a reader calls it."""

    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class Pieces:
    """What a tick has worked out anyway and the matrices of its program are made of.

    Attributes:
        L: (n, n) Cholesky factor of H. T: (n, t) L^-1 J^T of the t task axes; M: (t, t) Cholesky
            factor of J H^-1 J^T; both empty where the arm is not redundant.
        C: (n, c) L^-1 J_c^T of the contacts, 0 for those that are not there.
        inertia: (c, c) Lambda_c. active: (c,) whether each is there.
        J: (3, n) of the tip. ways: (3, k) unit vectors along which its speed is kept; world axes.
        requests: (r, n) rows along which forces are asked for.
    """

    L: ca.SX
    T: ca.SX
    M: ca.SX
    C: ca.SX
    inertia: ca.SX
    active: ca.SX
    J: ca.SX
    ways: ca.SX
    requests: ca.SX

    def parts(self) -> list[ca.SX]:
        """All of them, in order, without the zeros that they always have."""
        return [ca.sparsify(getattr(self, part.name)) for part in fields(self)]

    def flat(self) -> ca.SX:
        """Their entries as one vector."""
        return ca.vertcat(ca.SX(0, 1), *(x for part in self.parts() for x in part.nonzeros()))

    def symbols(self) -> Pieces:
        """Symbols of the same shapes, with the same zeros."""
        names = [part.name for part in fields(self)]
        shapes = [part.sparsity() for part in self.parts()]
        return Pieces(*(ca.SX.sym(n, shape) for n, shape in zip(names, shapes, strict=True)))


#: Where a row of A comes from: of which piece, and which of its rows.
Source = tuple[str, int]


@dataclass(frozen=True, slots=True)
class LimitRows:
    """lower <= A x <= upper, as expressions.

    Attributes:
        rows: what each of the m rows is. sources: where the rows of A come from.
        lower, upper: (m,); x = 0 is u*. pieces: what A is made of.
        torque: (n,) u*, with the pushes on contacts within their bounds.
        clamped: sum of 2^i over the rows i of pushes that were not. cut: (r,) what that took from
            each of the requested forces.
        finite: a number that is finite only if everything in here is.
    """

    rows: tuple[Row, ...]
    sources: tuple[Source, ...]
    lower: ca.SX
    upper: ca.SX
    pieces: Pieces
    torque: ca.SX
    clamped: ca.SX
    cut: ca.SX
    finite: ca.SX

    @property
    def violation(self) -> ca.SX:
        """How far u* is beyond its limits: not above 0 where it keeps all of them.

        NaN where a number is not finite, which the larger of two numbers would hide.
        """
        beyond = ca.mmax(ca.vertcat(self.lower, -self.upper))
        return beyond + _NOTHING * self.finite


@dataclass(frozen=True, slots=True)
class Matrices:
    """The program's matrices.

    Attributes:
        P: (n, n) what x costs. A: (m, n) the limits.
        requests: (r, n) what x adds to the force along each of the requested directions.
    """

    P: ca.SX
    A: ca.SX
    requests: ca.SX


def matrices(sources: Sequence[Source], pieces: Pieces) -> Matrices:
    """The matrices of a program from the pieces that its tick hands over."""
    n = pieces.L.shape[0]
    from_joints = linear.backward(pieces.L, ca.SX.eye(n))
    multipliers = pieces.inertia @ pieces.C.T
    onto = pieces.J @ from_joints
    made = {
        TORQUE: pieces.L,
        JOINT: from_joints,
        FORCE: ca.diag(pieces.active) @ multipliers if multipliers.shape[0] else multipliers,
        SPEED: pieces.ways.T @ onto,
    }
    return Matrices(
        P=_cost(pieces, multipliers),
        A=ca.vertcat(ca.SX(0, n), *(made[kind][i, :] for kind, i in sources)),
        requests=_onto(pieces.requests, pieces.L).T,
    )


def _onto(requests: ca.SX, L: ca.SX) -> ca.SX:
    """(n, r) what x adds to the force along each of the requested rows (r, n)."""
    columns = []
    for k in range(requests.shape[0]):
        rate = linear.forward(L, requests[k, :].T)
        columns.append(rate / ca.sumsqr(rate))
    return ca.horzcat(ca.SX(L.shape[0], 0), *columns)


def _cost(pieces: Pieces, multipliers: ca.SX) -> ca.SX:
    """P (n, n), by the orthogonal parts of x: null space, motion, contact force."""
    n = pieces.L.shape[0]
    null, motion, force = (COST[part] for part in ("null space", "motion", "force"))
    P = motion * ca.SX.eye(n)
    if pieces.T.shape[1]:
        Y = linear.forward(pieces.M, pieces.T.T)
        P = null * ca.SX.eye(n) + (motion - null) * (Y.T @ Y)
    if multipliers.shape[0]:
        P = P + (force - motion) * pieces.C @ multipliers
    return P


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
    L = state.H_factor
    acceleration = linear.solve(L, wanted + environment - terms.bias)
    on = _Contacts(contacts, L)
    pushes = _pushes(context, limits, on, acceleration)
    T, M = linear.forward(L, state.J.T), linear.cholesky(state.mobility)
    x = on.along_normals(T, M, pushes.shift())
    wanted = wanted + L @ x
    acceleration = acceleration + linear.backward(L, x)
    ways = ca.SX(3, 0)
    found = _Bounds()
    _add_torques(found, context, limits, wanted, last)
    _add_joints(found, context, limits, q, v, acceleration)
    clamped = _add_pushes(found, pushes, on.inertia @ (on.C.T @ x))
    if limits.speed is not None:
        ways = _add_speed(found, context, limits, terms, L, acceleration)
    n, t = L.shape[0], len(state.axes)
    redundant = n > t
    return LimitRows(
        rows=tuple(found.rows),
        sources=tuple(found.sources),
        lower=ca.vertcat(ca.SX(0, 1), *found.lower),
        upper=ca.vertcat(ca.SX(0, 1), *found.upper),
        pieces=Pieces(
            L=L,
            T=T if redundant else ca.SX(n, 0),
            M=M if redundant else ca.SX(0, 0),
            C=on.C,
            inertia=on.inertia,
            active=on.active,
            J=terms.J[:3, :],
            ways=ways,
            requests=requests,
        ),
        torque=wanted,
        clamped=clamped,
        cut=_onto(requests, L).T @ x,
        finite=ca.sumsqr(acceleration) + ca.sumsqr(pushes.wanted) + ca.sumsqr(v),
    )


class _Bounds:
    """Rows with their bounds, one after the other."""

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.sources: list[Source] = []
        self.lower: list[ca.SX] = []
        self.upper: list[ca.SX] = []

    def add(self, kind: str, number: int, text: str, lower: ca.SX, upper: ca.SX) -> None:
        self.rows.append(Row(kind, text))
        self.sources.append((kind, number))
        self.lower.append(lower)
        self.upper.append(upper)


def _add_torques(
    found: _Bounds, context: Context, limits: Limits, wanted: ca.SX, last: ca.SX | None
) -> None:
    most = context.robot.torque_limit
    lowest, highest = ca.SX(ca.DM(-most)), ca.SX(ca.DM(most))
    if last is not None:
        assert limits.torque_rate is not None
        step = limits.torque_rate * context.period
        # A torque that is beyond its limit comes back at once.
        lowest, highest = (
            ca.fmin(ca.fmax(lowest, last - step), ca.DM(most)),
            ca.fmax(ca.fmin(highest, last + step), ca.DM(-most)),
        )
    for i in range(len(most)):
        if np.isfinite(most[i]) or last is not None:
            text = f"torque of joint {i + 1}"
            found.add(TORQUE, i, text, lowest[i] - wanted[i], highest[i] - wanted[i])


def _add_joints(
    found: _Bounds, context: Context, limits: Limits, q: ca.SX, v: ca.SX, acceleration: ca.SX
) -> None:
    robot, jerk = context.robot, None
    if limits.torque_rate is not None:
        # As with braking, the other half is for what the other joints do.
        jerk = ca.DM(BRAKING * limits.torque_rate / np.diag(context.start_inertia))
    braking = braking_deceleration(robot.torque_limit, context.start_gravity, context.start_inertia)
    least, greatest = joint_accelerations(
        q,
        v,
        (ca.DM(robot.lower + POSITION_MARGIN), ca.DM(robot.upper - POSITION_MARGIN)),
        ca.DM(VELOCITY_SHARE * robot.velocity_limit),
        ca.DM(braking),
        context.period,
        jerk,
    )
    for i, ends in enumerate(zip(robot.lower, robot.upper, robot.velocity_limit, strict=True)):
        if np.isfinite(ends).any():
            text = f"position and velocity of joint {i + 1}"
            found.add(JOINT, i, text, least[i] - acceleration[i], greatest[i] - acceleration[i])


@dataclass(frozen=True, slots=True)
class _Pushes:
    """What a law pushes with on each contact, and how much it may.

    Attributes:
        contacts: all of them. wanted: (c,) by (4.77). lower, upper: of those that have bounds.
    """

    contacts: Sequence[ContactRow]
    wanted: ca.SX
    lower: dict[int, ca.SX]
    upper: dict[int, ca.SX]

    def shift(self) -> ca.SX:
        """(c,) what brings each push within its bounds; 0 for contacts that are not there."""
        shift = ca.SX.zeros(len(self.contacts))
        for i in self.lower:
            within = ca.fmin(ca.fmax(self.wanted[i], self.lower[i]), self.upper[i])
            shift[i] = ca.if_else(self.contacts[i].active, within - self.wanted[i], 0)
        return shift


def _pushes(context: Context, limits: Limits, on: _Contacts, acceleration: ca.SX) -> _Pushes:
    cap = None if limits.force is None else FORCE_SHARE * limits.force
    lower, upper = {}, {}
    for i, contact in enumerate(on.contacts):
        bounds = _push_bounds(contact, cap, on.inertia[i, i], context.period)
        if bounds is not None:
            lower[i], upper[i] = bounds
    return _Pushes(on.contacts, on.multipliers(acceleration), lower, upper)


def _add_pushes(found: _Bounds, pushes: _Pushes, added: ca.SX) -> ca.SX:
    """Adds the rows of the pushes; the sum of 2^i over those that have been shifted.

    Args:
        found: where to. pushes: as the law wants them. added: (c,) what has been added to them.
    """
    shift, clamped = pushes.shift(), ca.SX(0)
    for i, lower in pushes.lower.items():
        contact, now = pushes.contacts[i], pushes.wanted[i] + added[i]
        low, high = lower - now, pushes.upper[i] - now
        clamped += 2 ** len(found.rows) * (shift[i] != 0)
        absent = ca.logic_not(contact.active)
        found.add(
            FORCE,
            i,
            f"force on {contact.name}",
            ca.if_else(absent, -ca.inf, ca.if_else(low > _ROUNDING, low, ca.fmin(low, 0))),
            ca.if_else(absent, ca.inf, ca.if_else(high < -_ROUNDING, high, ca.fmax(high, 0))),
        )
    return clamped


class _Contacts:
    """Inertia and multipliers of the contacts that are there now; those that are not count as 0."""

    def __init__(self, contacts: Sequence[ContactRow], L: ca.SX) -> None:
        n, c = L.shape[0], len(contacts)
        self.contacts = contacts
        self.drift = ca.vertcat(ca.SX(0, 1), *(row.drift for row in contacts))
        self.measured = ca.vertcat(ca.SX(0, 1), *(row.measured for row in contacts))
        self.active = ca.vertcat(ca.SX(0, 1), *(row.active for row in contacts))
        self.J = ca.vertcat(ca.SX(0, n), *(row.J for row in contacts))
        self.C = linear.forward(L, self.J.T) @ ca.diag(self.active) if c else ca.SX(n, 0)
        mobility = self.C.T @ self.C + ca.diag(1 - self.active)
        self.inertia = linear.solve(linear.cholesky(mobility), ca.SX.eye(c)) if c else mobility

    def along_normals(self, T: ca.SX, M: ca.SX, shift: ca.SX) -> ca.SX:
        """x (n,) that adds `shift` (c,) to the multipliers by accelerating along normals alone.

        The other accelerations on the task axes stay: with the contacts' rows S = C^T T Lambda on
        the task axes, the task accelerates by S^T (S S^T)^-1 of what the contacts have to.

        Args:
            T: (n, t) L^-1 J^T. M: (t, t) Cholesky factor of J H^-1 J^T.
        """
        if not self.contacts:
            return ca.SX.zeros(T.shape[0])
        S = linear.solve(M, T.T @ self.C).T
        # A contact that the task's axes do not reach is left to the program.
        gram = S @ S.T + ca.diag(1 - self.active) + _UNREACHED * ca.SX.eye(len(self.contacts))
        along = linear.solve(linear.cholesky(gram), (self.C.T @ self.C) @ shift)
        found: ca.SX = T @ linear.solve(M, S.T @ along)
        return found

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
        k, cap = contact.stiffness, contact.highest(cap)
        # What is measured is a period old.
        now = contact.measured + k * period * ca.fmax(contact.closing, 0)
        upper = highest_push(cap, now, contact.closing, mass, k)
        if contact.both_ways:
            back = -contact.measured + k * period * ca.fmax(-contact.closing, 0)
            lower = -highest_push(cap, back, -contact.closing, mass, k)
        lower = ca.fmin(lower, upper)
    return lower, upper


def _add_speed(
    found: _Bounds,
    context: Context,
    limits: Limits,
    terms: TermSymbols,
    L: ca.SX,
    acceleration: ca.SX,
) -> ca.SX:
    """Rows that keep the tip's speed: along the way that it takes, and aside from it.

    The velocity after this period lies in a box inside the ball of the limit, whose axis turns
    towards what the law asks for. A plane across the way alone lets the tip escape sideways: where
    the law asks for T a > v aside, faster than it turns.

    Returns:
        (3, k) the unit vectors of the rows.
    """
    assert limits.speed is not None
    v, J, T = terms.twist[:3], terms.J[:3, :], context.period
    fastest = SPEED_SHARE * limits.speed
    aside, change = TURN_SHARE * fastest, T * (J @ acceleration + terms.drift[:3])
    ahead = _heading(v, v + change, aside)
    jerk = None
    if limits.torque_rate is not None:
        # The most that torques of size 1 do along the way.
        most = ca.sum1(ca.fabs(linear.solve(L, J.T @ ahead)))
        jerk = BRAKING * limits.torque_rate * most
    rate, along = ca.dot(ahead, change) / T, ca.dot(ahead, v)
    found.add(
        SPEED,
        0,
        f"speed {show(fastest, 'mm/s')}",
        -approach(fastest + along, jerk, T) - rate,
        approach(fastest - along, jerk, T) - rate,
    )
    inside = ca.norm_2(v + change) < fastest
    sides = _sides(ahead, "z" in context.robot.axes)
    for i, side in enumerate(sides):
        rate, across = ca.dot(side, change) / T, ca.dot(side, v)
        low, high = (-aside - across) / T - rate, (aside - across) / T - rate
        found.add(
            SPEED,
            i + 1,
            f"speed aside, {i + 1}",
            ca.if_else(inside, ca.fmin(low, 0), low),
            ca.if_else(inside, ca.fmax(high, 0), high),
        )
    return ca.horzcat(ahead, *sides)


def _heading(v: ca.SX, wanted: ca.SX, aside: float) -> ca.SX:
    """Unit vector along `wanted`, turned back until v (3,) is no more than `aside` beside it."""
    size = ca.fmax(ca.norm_2(v), 1e-9)
    now, then = v / size, wanted / ca.fmax(ca.norm_2(wanted), 1e-9)
    turned = then - now * ca.dot(now, then)
    sine = ca.norm_2(turned)
    free = ca.logic_or(size <= aside, ca.logic_and(ca.dot(now, then) > 0, size * sine <= aside))
    least = ca.fmin(aside / size, 1)
    held = now * ca.sqrt(1 - least**2) + turned / ca.fmax(sine, 1e-9) * least
    found = ca.if_else(free, then, held)
    # Neither moving nor about to: any direction will do.
    return ca.if_else(ca.norm_2(found) > 0.5, found, ca.SX(ca.DM([1.0, 0.0, 0.0])))


def _sides(ahead: ca.SX, spatial: bool) -> tuple[ca.SX, ...]:
    """Unit vectors (3,) across `ahead`: the one in the plane of a planar arm, else two."""
    if not spatial:
        return (ca.vertcat(-ahead[1], ahead[0], 0),)
    return tangents(ahead, ca.SX.zeros(3))
