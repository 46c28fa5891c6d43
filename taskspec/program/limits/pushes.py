"""Forces with which a stage pushes on its contacts, and their bounds.

Pushes out of their bounds are clamped along the normals alone, before anything else is limited.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from taskspec.control import linear
from taskspec.control.admissible import highest_push
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.limits.bounds import FORCE, Bounds
from taskspec.program.limits.contacts import ContactRow
from taskspec.spec import Limits

#: The limit on force, which would stop the run, is kept at this share.
FORCE_SHARE = 0.97
#: A push this far [N] beyond its bounds is within them but for rounding.
_ROUNDING = 1e-6
#: Square of the share of a contact's normal that the task's axes have to have.
_INFEASIBLE = 1e-9
#: Square of the sine between a contact and those before it from which on it is one of its own.
_OWN_WAY = 1e-3


class Contacts:
    """Inertia and multipliers of the contacts that are there now; those that are not count as 0.

    Nor does one count that is along others before it, as a sheet on a table is: together they bear
    what the first one would, and how they share it is undetermined.
    """

    def __init__(self, contacts: Sequence[ContactRow], L: ca.SX) -> None:
        n, c = L.shape[0], len(contacts)
        self.drift = ca.vertcat(ca.SX(0, 1), *(row.drift for row in contacts))
        self.measured = ca.vertcat(ca.SX(0, 1), *(row.measured for row in contacts))
        self.J = ca.vertcat(ca.SX(0, n), *(row.J for row in contacts))
        apart = linear.forward(L, self.J.T) if c else ca.SX(n, 0)
        active = _apart(apart, [row.active for row in contacts])
        self.contacts = [replace(row, active=on) for row, on in zip(contacts, active, strict=True)]
        self.active = ca.vertcat(ca.SX(0, 1), *active)
        self.C = apart @ ca.diag(self.active) if c else ca.SX(n, 0)
        mobility = self.C.T @ self.C + ca.diag(1 - self.active)
        self.inertia = linear.solve(linear.cholesky(mobility), ca.SX.eye(c)) if c else mobility

    def along_normals(self, T: ca.SX, M: ca.SX, shift: ca.SX) -> ca.SX:
        """x (n,) that adds `shift` (c,) to the multipliers by accelerating along normals alone.

        The other accelerations on the task axes stay: with the contacts' rows S = C^T T Lambda on
        the task axes, the task accelerates by S^T (S S^T)^-1 of what the contacts have to.

        Args:
            T: (n, t) L^-1 J^T.
            M: (t, t) Cholesky factor of J H^-1 J^T.
        """
        if not self.contacts:
            return ca.SX.zeros(T.shape[0])
        S = linear.solve(M, T.T @ self.C).T
        # A contact that the task's axes do not reach is left to the program.
        gram = S @ S.T + ca.diag(1 - self.active) + _INFEASIBLE * ca.SX.eye(len(self.contacts))
        along = linear.solve(linear.cholesky(gram), (self.C.T @ self.C) @ shift)
        found: ca.SX = T @ linear.solve(M, S.T @ along)
        return found

    def multipliers(self, acceleration: ca.SX) -> ca.SX:
        """The forces of rigid contacts (c,), (4.77), as the robot applies them."""
        return self.measured + self.inertia @ (self.J @ acceleration + self.drift)


def _apart(directions: ca.SX, active: Sequence[ca.SX]) -> list[ca.SX]:
    """Which of the active contacts have directions, columns (n, c), of their own."""
    own: list[ca.SX] = []
    found: list[ca.SX] = []
    for i in range(directions.shape[1]):
        direction = left = directions[:, i]
        for each in own:
            left -= each * ca.dot(each, direction)
        size, rest = ca.sumsqr(direction), ca.sumsqr(left)
        # The first one has nothing before it.
        counts = ca.logic_and(active[i], rest > _OWN_WAY * size) if own else active[i]
        found.append(counts)
        own.append(ca.if_else(counts, left / ca.sqrt(ca.fmax(rest, 1e-300)), 0))
    return found


@dataclass(frozen=True, slots=True)
class Pushes:
    """Forces with which a law pushes on each contact, and their bounds.

    Attributes:
        contacts: all of them.
        wanted: (c,) by (4.77).
        lower, upper: of those that have bounds.
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


def wanted_pushes(context: Context, limits: Limits, on: Contacts, acceleration: ca.SX) -> Pushes:
    """The forces on contacts of a law's acceleration (n,), and their bounds."""
    cap = None if limits.force is None else FORCE_SHARE * limits.force
    lower, upper = {}, {}
    for i, contact in enumerate(on.contacts):
        bounds = _push_bounds(contact, cap, on.inertia[i, i], context.period)
        if bounds is not None:
            lower[i], upper[i] = bounds
    return Pushes(on.contacts, on.multipliers(acceleration), lower, upper)


def add_pushes(found: Bounds, pushes: Pushes, added: ca.SX) -> ca.SX:
    """Adds the rows of the pushes; the sum of 2^i over those that have been shifted.

    Args:
        found: where to.
        pushes: as the law wants them.
        added: (c,) what has been added to them.
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


def _push_bounds(
    contact: ContactRow, cap: float | None, mass: ca.SX, period: float
) -> tuple[ca.SX, ca.SX] | None:
    """Bounds of one multiplier; None where it has none."""
    free = cap is None or contact.angular
    if free and not contact.pressed:
        return None
    lower = ca.SX(0) if contact.pressed else ca.SX(-ca.inf)
    upper = ca.SX(ca.inf)
    if not free:
        assert cap is not None
        k, cap = contact.stiffness, contact.highest(cap)
        if math.isinf(k):
            # Nothing moves along it: what is pushed with is the force at once.
            return (-cap if contact.both_ways else lower), cap
        # What is measured is a period old.
        now = contact.measured + k * period * ca.fmax(contact.closing, 0)
        upper = highest_push(cap, now, contact.closing, mass, k)
        if contact.both_ways:
            back = -contact.measured + k * period * ca.fmax(-contact.closing, 0)
            lower = -highest_push(cap, back, -contact.closing, mass, k)
        lower = ca.fmin(lower, upper)
    return lower, upper
