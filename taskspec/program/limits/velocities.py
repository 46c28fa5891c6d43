"""Limits of a stage under `solve: qp` whose law commands velocities, as rows of one program.

The law's closed form wants the joint velocities z*. The program solves for z = z* + x with the
least x^T P x. P has the null space yield before the motion on the task axes, and that before what
moves along contacts and constraints. x = 0 is the closed form.

A velocity is the robot's own business to follow. So that its servo meets no limit of its own, what
is commanded

- changes within a period by no more than the reference follows within its acceleration and jerk;
- comes nearer to a limit of speed as slowly as the reference forgets an overshoot;
- leaves room before a limit of position, and before a contact is pressed too hard, that is used up
  at a rate which the delay of servo and sensor allows.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.control.admissible import joint_velocities
from taskspec.control.servo import overshoot
from taskspec.control.state import ARM_LENGTH, TaskState
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.limits.bounds import (
    COMMAND,
    FORCE,
    JOINT,
    POSITION_MARGIN,
    SPEED,
    SPEED_SHARE,
    VELOCITY_SHARE,
    Bounds,
    Source,
    sides,
)
from taskspec.program.limits.contacts import ContactRow
from taskspec.program.limits.limited import COST, LimitRows, Matrices, Pieces
from taskspec.program.limits.pushes import FORCE_SHARE, Contacts
from taskspec.robot.model_terms import TermSymbols
from taskspec.spec import Limits
from taskspec.text.units import ANGULAR_VELOCITY, VELOCITY, show

Vector = NDArray[np.float64]

#: A speed below this has no direction [m/s, rad/s].
_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class VelocityPieces(Pieces):
    """Intermediate results of a tick that the matrices of its program are made of.

    Attributes:
        metric: (n, n) what a change costs that leaves contacts alone.
        C: (c, n) of contacts and constraints.
        active: (c,) whether each is there.
        along: (k, n) velocities along the directions in which speeds are kept.
        requests: (r, n) force that a velocity stands for, along each requested one.
        unit: (1,) what a velocity adds to a command: 1, or the period where that is a position.
    """

    metric: ca.SX
    C: ca.SX
    active: ca.SX
    along: ca.SX
    requests: ca.SX
    unit: ca.SX

    def matrices(self, sources: Sequence[Source]) -> Matrices:
        """The program's matrices."""
        n = self.metric.shape[0]
        one = ca.SX.eye(n)
        made = {COMMAND: one, JOINT: one, FORCE: self.C, SPEED: self.along}
        return Matrices(
            P=self._cost(),
            A=ca.vertcat(ca.SX(0, n), *(made[kind][i, :] for kind, i in sources)),
            requests=self.requests,
            factor=self.unit * one,
        )

    def _cost(self) -> ca.SX:
        """P (n, n)."""
        if not self.C.shape[0]:
            return self.metric
        there = ca.diag(self.active) @ self.C
        return self.metric + (COST["force"] - COST["motion"]) * there.T @ there


def task_metric(state: TaskState) -> ca.SX:
    """(n, n) what a change of joint velocities costs: the twist that it is, and inner motion.

    A radian on the task axes counts as `ARM_LENGTH` metres, so that a limit of one axis changes no
    other. Inner motion counts by the inertia that it moves, of which a kilogram is as a metre:
    H - J^T Lambda J.
    """
    H = state.H_factor @ state.H_factor.T
    scale = ca.DM([ARM_LENGTH if axis.is_rotation else 1.0 for axis in state.axes])
    twist = ca.diag(scale) @ state.J
    found = COST["motion"] * twist.T @ twist
    if state.J.shape[1] > len(state.axes):
        moved = linear.forward(linear.cholesky(state.mobility), state.J)
        found += COST["null space"] * (H - moved.T @ moved)
    return found


def joint_metric(turns: Sequence[bool]) -> ca.SX:
    """(n, n) what a change costs where joints are led: one is as good as the other.

    Args:
        turns: which of them are hinges.
    """
    return ca.diag(ca.SX(ca.DM([1.0 if hinge else ARM_LENGTH**-2 for hinge in turns])))


@dataclass(frozen=True, slots=True)
class Commands:
    """What joints are commanded, as a program has it.

    Attributes:
        wanted: (n,) z* [rad/s, m/s].
        last: (n,) z of the tick before.
        at: (n,) where the joints are, for their limits of position [rad, m].
        unit: what a velocity adds to a command: 1, or the period where that is a position.
    """

    wanted: ca.SX
    last: ca.SX
    at: ca.SX
    unit: float


@dataclass(frozen=True, slots=True)
class Pressed:
    """A contact or an equation, as a velocity meets it.

    Attributes:
        row: of it.
        yields: damping of a force loop on it that keeps its margins [N s/m, N m s/rad].
        gap: to it, where it is nominally [m]; None for an equation that constrains the stage.
    """

    row: ContactRow
    yields: float | ca.SX
    gap: ca.SX | None


def velocity_rows(
    *,
    context: Context,
    limits: Limits,
    metric: ca.SX,
    L: ca.SX,
    terms: TermSymbols,
    pressed: Sequence[Pressed],
    requests: ca.SX,
    commands: Commands,
    v: ca.SX,
) -> LimitRows:
    """The limits of a stage, around the velocities that its law commands.

    Args:
        context: of the task.
        limits: of the stage.
        metric: (n, n) what a change of the velocities costs.
        L: (n, n) Cholesky factor of H.
        terms: model terms, in the world.
        pressed: the contacts of the stage, and the equations that constrain it.
        requests: (r, n) force that a velocity stands for, along each requested one.
        commands: of the law.
        v: (n,) measured.
    """
    found, wanted = Bounds(), commands.wanted
    _add_commands(found, context, commands)
    _add_positions(found, context, commands)
    on = Contacts([each.row for each in pressed], L)
    for i, each in enumerate(pressed):
        _add_contact(found, limits, each, i, wanted, v)
    along = _add_speeds(found, context, limits, terms, commands)
    return LimitRows(
        rows=tuple(found.rows),
        sources=tuple(found.sources),
        lower=ca.vertcat(ca.SX(0, 1), *found.lower),
        upper=ca.vertcat(ca.SX(0, 1), *found.upper),
        pieces=VelocityPieces(
            metric=metric,
            C=on.J,
            active=on.active,
            along=along,
            requests=requests,
            unit=ca.SX(commands.unit),
        ),
        command=wanted,
        clamped=ca.SX(0),
        cut=ca.SX.zeros(requests.shape[0]),
        finite=ca.sumsqr(wanted) + ca.sumsqr(commands.last),
    )


def _add_commands(found: Bounds, context: Context, commands: Commands) -> None:
    """Rows of the velocities, and of how fast they may change."""
    drives, last = context.drives, commands.last
    most, share = _fastest(context), drives.approach(context.period)
    step = drives.rates * context.period
    for i in range(len(most)):
        if np.isfinite(most[i]) or np.isfinite(step[i]):
            low, high = (
                last[i] + ca.fmin(ca.fmax(share * (end - last[i]), -step[i]), step[i])
                for end in (-most[i], most[i])
            )
            wanted = commands.wanted[i]
            found.add(COMMAND, i, f"velocity of joint {i + 1}", low - wanted, high - wanted)


def _add_positions(found: Bounds, context: Context, commands: Commands) -> None:
    """Rows that keep joints from their limits of position."""
    robot, drives = context.robot, context.drives
    least, most = joint_velocities(
        commands.at,
        (ca.DM(robot.lower + POSITION_MARGIN), ca.DM(robot.upper - POSITION_MARGIN)),
        ca.DM(_fastest(context)),
        ca.DM(drives.rates),
        drives.lag,
    )
    for i, ends in enumerate(zip(robot.lower, robot.upper, strict=True)):
        if np.isfinite(ends).any():
            wanted = commands.wanted[i]
            text = f"position of joint {i + 1}"
            found.add(JOINT, i, text, least[i] - wanted, most[i] - wanted)


def _fastest(context: Context) -> Vector:
    """(n,) the velocity that a joint may be commanded [rad/s, m/s]."""
    drives = context.drives
    assert drives.timing is not None
    return np.asarray(VELOCITY_SHARE * drives.most / (1 + overshoot(drives.timing.ratio)))


def _add_contact(
    found: Bounds, limits: Limits, pressed: Pressed, number: int, wanted: ca.SX, v: ca.SX
) -> None:
    """The row of how fast a contact may be pressed further: it stops at the limit on force.

    What moves on a constraint neither leaves it nor is pressed into it by another limit.
    """
    row, capped = pressed.row, limits.force is not None and not pressed.row.angular
    into = row.J @ wanted + row.closing - row.J @ v
    low, high = ca.SX(-ca.inf), ca.SX(ca.inf)
    if pressed.gap is None:
        low, high = ca.fmin(into, 0), ca.fmax(into, 0)
    if capped:
        assert limits.force is not None
        cap = row.highest(FORCE_SHARE * limits.force)
        left = cap - row.measured
        if pressed.gap is not None:
            left += ca.if_else(row.active, 0, row.stiffness * ca.fmax(pressed.gap, 0))
        high = ca.fmin(high, left / pressed.yields)
        if row.both_ways:
            low = ca.fmax(low, -(cap + row.measured) / pressed.yields)
        low = ca.fmin(low, high)
    if capped or pressed.gap is None:
        found.add(FORCE, number, f"force on {row.name}", low - into, high - into)


def _add_speeds(
    found: Bounds, context: Context, limits: Limits, terms: TermSymbols, commands: Commands
) -> ca.SX:
    """Rows that keep the speed of the tip, and how fast the tool turns.

    What a velocity comes to by its rate of change lies in a box inside the ball of the limit, whose
    axis is along what the law commands. Aside it may be what it was, and it is so much slower
    ahead.

    Returns:
        (k, n) velocities along the directions of the rows.
    """
    drives, protection = context.drives, context.loaded.task.robot.protection
    tip, turn = (None, None) if protection is None else (protection.tip, protection.turn)
    speeds = [bound.speed for bound in (limits, tip) if bound is not None and bound.speed]
    kept = [(slice(0, 3), min(speeds), VELOCITY, "speed")] if speeds else []
    if turn is not None and turn.speed:
        kept.append((slice(3, 6), turn.speed, ANGULAR_VELOCITY, "rate of turning"))
    assert drives.timing is not None
    share, rows = drives.approach(context.period), ca.SX(0, commands.wanted.shape[0])
    for own, limit, unit, what in kept:
        fastest = SPEED_SHARE * limit
        most = fastest / (1 + overshoot(drives.timing.ratio))
        J = terms.J[own, :]
        # The arm has turned since: that alone makes another velocity of the same command.
        last = J @ commands.last - context.period * terms.drift[own]
        wanted = J @ commands.wanted
        ahead, first = _direction(wanted), rows.shape[0]
        directions = [ahead, *sides(ahead, "z" in context.robot.axes)]
        # Half of what is left of the ball is for going aside, and half for going ahead.
        spare = ca.fmax(most**2 - ca.sumsqr(last), 0)
        more = spare / (2 * len(directions[1:]))
        squares = [ca.dot(side, last) ** 2 + more for side in directions[1:]]
        left = ca.fmax(most**2 - sum(squares), 0)
        texts = [f"{what} {show(fastest, unit)}", *(f"{what} aside, {i + 1}" for i in (0, 1))]
        for i, (along, square) in enumerate(zip(directions, [left, *squares], strict=True)):
            before, now, end = ca.dot(along, last), ca.dot(along, wanted), ca.sqrt(square)
            low, high = (before + share * (side * end - before) - now for side in (-1, 1))
            found.add(SPEED, first + i, texts[i], low, high)
        rows = ca.vertcat(rows, ca.horzcat(*directions).T @ J)
    return rows


def _direction(v: ca.SX) -> ca.SX:
    """Unit vector along v (3,); any where that is nothing."""
    size = ca.norm_2(v)
    some = ca.SX(ca.DM([1.0, 0.0, 0.0]))
    return ca.if_else(size > _NOTHING, v / ca.fmax(size, _NOTHING), some)
