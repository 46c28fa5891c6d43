"""A stage under `solve: qp`: its two programs as functions, and what to make of their answers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.program.drives import Drives
from taskspec.program.limits.bounds import CommandRange, Row
from taskspec.program.limits.consistency import Consistency, Requests
from taskspec.program.limits.limited import LimitRows
from taskspec.program.limits.velocities import VelocityPieces

#: What is left of a request below this share of it is rounding.
_ROUNDING = 1e-6
#: Outputs of `assemble`, in order; matrices are given by rows.
ASSEMBLED = ("P", "A", "factor", "requests")
#: Outputs of `look`, in order; matrices are given by rows.
LOOK_OUTPUTS = ("P", "g", "A", "lower", "upper", "effect", "values")


@dataclass(frozen=True, slots=True)
class Resolution:
    """Resolution of a stage's torque from its law's command under limits.

    Attributes:
        solver: `daqp` or `osqp`.
        velocities: whether it is of a law that commands velocities.
        rows: the m limits.
        commands: what the command of a tick stays within in any case.
        requested: names of the r force set points.
        handed: length of the pieces that the tick hands over, before lower and upper.
        assemble: these pieces -> `ASSEMBLED`.
        accept: `ASSEMBLED`, lower, upper, u* (n,), x (n,), dual (m,), the torque before (n,), the
            most and the largest step of a torque (n,) -> torque (n,), KKT residual, sum of 2^i over
            the limits i that bind, what limits take from each request (r,).
        look: the tick's inputs -> `LOOK_OUTPUTS`; None where nothing is requested of a contact.
        left: effect, values, forces x (g,) -> what contacts cannot return of each request (r,).
        generators: how many of them there are.
        conditions: on their sizes, in words.
    """

    solver: str
    velocities: bool
    rows: tuple[Row, ...]
    commands: CommandRange
    requested: tuple[str, ...]
    handed: int
    assemble: ca.Function
    accept: ca.Function
    look: ca.Function | None
    left: ca.Function | None
    generators: int
    conditions: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Resolved:
    """The programs of a stage as expressions.

    Attributes:
        solver: by name.
        requests: the stage's force set points.
        commands: what the command of a tick stays within in any case.
        limits: what binds the command.
        nearest: the forces that contacts return; None where nothing is requested of one.
    """

    solver: str
    commands: CommandRange
    requests: Requests
    limits: LimitRows
    nearest: Consistency | None

    @property
    def handed_over(self) -> ca.SX:
        """The inputs of the tick's program: pieces, lower, upper, and the cut of pushes."""
        limits = self.limits
        return ca.densify(ca.vertcat(limits.pieces.flat(), limits.lower, limits.upper, limits.cut))

    @property
    def residuals(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The violation of limits by the torque, the clamped pushes, and `unsettled`."""
        return self.limits.violation, self.limits.clamped, self.unsettled

    @property
    def unsettled(self) -> ca.SX:
        """Whether the nearest forces have to be solved for."""
        return ca.SX(0) if self.nearest is None else self.nearest.needed

    def compiled(self, arguments: Sequence[ca.SX]) -> Resolution:
        """The programs as functions of the tick's inputs."""
        limits, nearest, look = self.limits, self.nearest, None
        if nearest is not None:
            inputs = (
                nearest.P,
                nearest.g,
                nearest.A.T,
                nearest.lower,
                nearest.upper,
                nearest.effect.T,
                self.requests.values,
            )
            look = _flat("look", arguments, inputs)
        pieces = limits.pieces.symbols()
        made = pieces.matrices(limits.sources)
        handed = pieces.flat()
        m, n = made.A.shape
        return Resolution(
            solver=self.solver,
            velocities=isinstance(pieces, VelocityPieces),
            rows=limits.rows,
            commands=self.commands,
            requested=self.requests.names,
            handed=handed.shape[0],
            assemble=_flat(
                "assemble", [handed], (made.P, made.A.T, made.factor.T, made.requests.T)
            ),
            accept=_accept(n, m, len(self.requests.names)),
            look=look,
            left=None if nearest is None else _left(nearest.g.shape[0], len(self.requests.names)),
            generators=0 if nearest is None else nearest.g.shape[0],
            conditions=() if nearest is None else nearest.texts,
        )


def _flat(name: str, arguments: Sequence[ca.SX], parts: Sequence[ca.SX]) -> ca.Function:
    """A function whose results are dense vectors, matrices column by column."""
    return ca.Function(name, arguments, [ca.vec(ca.densify(p)) for p in parts], {"cse": True})


@cache
def _accept(n: int, m: int, r: int) -> ca.Function:
    """The torque of an answer x with its multipliers y, and its residuals.

    The residual is the largest of stationarity |P x + A'y| over max(1, |P x|), of violation
    |A x beyond its bounds| over max(1, |A x|), and of complementarity |y (A x - bound)| over
    max(1, x'P x).
    """
    P, A_rows = ca.SX.sym("P", n, n), ca.SX.sym("A", n, m)
    lower, upper = ca.SX.sym("l", m), ca.SX.sym("u", m)
    factor, requests = ca.SX.sym("L", n, n), ca.SX.sym("requests", n, r)
    torque, x, y = ca.SX.sym("torque", n), ca.SX.sym("x", n), ca.SX.sym("y", m)
    Px, at, zero = P @ x, A_rows.T @ x, ca.SX(0)
    above, below = at - upper, lower - at
    slack = [
        ca.if_else(y[i] > 0, y[i] * above[i], ca.if_else(y[i] < 0, y[i] * below[i], 0))
        for i in range(m)
    ]
    largest = [
        ca.mmax(ca.fabs(ca.vertcat(zero, part)))
        for part in (Px, at, Px + A_rows @ y, ca.vertcat(*slack))
    ]
    beyond = ca.mmax(ca.vertcat(zero, above, below))
    residual = ca.fmax(
        ca.fmax(largest[2] / ca.fmax(1, largest[0]), beyond / ca.fmax(1, largest[1])),
        largest[3] / ca.fmax(1, ca.dot(x, Px)),
    )
    binding = ca.sum1(ca.vertcat(zero, *(2**i * (y[i] != 0) for i in range(m))))
    given = (P, A_rows, factor, requests, lower, upper)
    before, most, step = (ca.SX.sym(name, n) for name in ("before", "most", "step"))
    # A solver that iterates leaves bounds by its tolerance.
    lowest = ca.fmin(ca.fmax(-most, before - step), most)
    highest = ca.fmax(ca.fmin(most, before + step), -most)
    return ca.Function(
        "accept",
        [*(ca.vec(part) for part in given), torque, x, y, before, most, step],
        [
            ca.fmin(ca.fmax(torque + factor.T @ x, lowest), highest),
            residual,
            binding,
            ca.densify(requests.T @ x),
        ],
        {"cse": True},
    )


@cache
def _left(g: int, r: int) -> ca.Function:
    """The part of r requests that contacts with g generators cannot return."""
    effect, values, x = ca.SX.sym("effect", g, r), ca.SX.sym("values", r), ca.SX.sym("x", g)
    left = values - effect.T @ x
    rounding = ca.norm_2(left) <= _ROUNDING * (1 + ca.norm_2(values))
    return ca.Function("left", [ca.vec(effect), values, x], [ca.if_else(rounding, 0, left)])


def saturated(drives: Drives, wanted: ca.SX) -> ca.SX:
    """Command (n,) as the joints take it of that of a closed form."""
    limit = ca.DM(drives.most)
    if drives.torques:
        return ca.fmax(ca.fmin(wanted, limit), -limit)
    # All joints slow down together, so that the tool keeps its way.
    return wanted / ca.fmax(1, ca.mmax(ca.fabs(wanted) / limit))
