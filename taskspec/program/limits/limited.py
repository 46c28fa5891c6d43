"""Limits of a stage under `solve: qp`, as rows of one quadratic program.

The torque of the law's closed form is u*. The program solves for the torque u = u* + L x with the
least x^T P x, where H = L L^T. With P = 1 this is Gauss's principle of least constraint: the joint
accelerations change as little as they can, each measured by the inertia that it moves, so newtons,
metres and radians need no weights of their own. P has the null space yield before the motion on
the task axes, and that before the forces of contacts.

Joint accelerations and contact multipliers follow from the torque, (4.77) and (4.78), and x = 0
is the closed form itself: as long as it keeps every limit there is nothing to solve. Before that
the pushes on contacts are brought within their bounds along the normals alone, through the same
inverse dynamics as the law's forces, so that a capped force does not shake the other axes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields
from typing import Self

import casadi as ca

from taskspec.control import linear
from taskspec.control.state import TaskState
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.limits.bounds import (
    COMMAND,
    FORCE,
    JOINT,
    SPEED,
    Bounds,
    Row,
    Source,
    add_joints,
    add_speed,
    add_torques,
)
from taskspec.program.limits.contacts import ContactRow
from taskspec.program.limits.pushes import Contacts, add_pushes, wanted_pushes
from taskspec.robot.model_terms import TermSymbols
from taskspec.spec import Limits

#: What a change of each part costs, in the metric of the inertia that it moves.
COST = {"force": 1e2, "motion": 1.0, "null space": 1e-2}

#: Carries a NaN over, and nothing else.
_NOTHING = 1e-300


@dataclass(frozen=True, slots=True)
class Matrices:
    """The program's matrices.

    Attributes:
        P: (n, n) what x costs.
        A: (m, n) the limits.
        requests: (r, n) what x adds to the force along each of the requested directions.
        factor: (n, n) lower, what x adds to the command.
    """

    P: ca.SX
    A: ca.SX
    requests: ca.SX
    factor: ca.SX


class Pieces(ABC):
    """Intermediate results of a tick that the matrices of its program are made of: its fields."""

    __slots__ = ()

    @abstractmethod
    def matrices(self, sources: Sequence[Source]) -> Matrices:
        """The program's matrices.

        Args:
            sources: where the rows of A come from.
        """

    def parts(self) -> list[ca.SX]:
        """All of them, in order, without the zeros that they always have."""
        return [ca.sparsify(getattr(self, name)) for name in self._names()]

    def flat(self) -> ca.SX:
        """Their entries as one vector."""
        return ca.vertcat(ca.SX(0, 1), *(x for part in self.parts() for x in part.nonzeros()))

    def symbols(self) -> Self:
        """Symbols of the same shapes, with the same zeros."""
        shapes = [part.sparsity() for part in self.parts()]
        return type(self)(
            *(ca.SX.sym(n, shape) for n, shape in zip(self._names(), shapes, strict=True))
        )

    @classmethod
    def _names(cls) -> list[str]:
        return [part.name for part in fields(cls)]  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class TorquePieces(Pieces):
    """Those of a program of torques.

    Attributes:
        L: (n, n) Cholesky factor of H.
        T: (n, t) L^-1 J^T of the t task axes; M: (t, t) Cholesky factor of J H^-1 J^T; both empty
            where the arm is not redundant.
        C: (n, c) L^-1 J_c^T of the contacts, 0 for those that are not there.
        inertia: (c, c) Lambda_c.
        active: (c,) whether each is there.
        J: (3, n) of the tip.
        directions: (3, k) unit vectors along which its speed is kept; world axes.
        requests: (r, n) rows along which forces are requested.
    """

    L: ca.SX
    T: ca.SX
    M: ca.SX
    C: ca.SX
    inertia: ca.SX
    active: ca.SX
    J: ca.SX
    directions: ca.SX
    requests: ca.SX

    def matrices(self, sources: Sequence[Source]) -> Matrices:
        """The program's matrices."""
        n = self.L.shape[0]
        from_joints = linear.backward(self.L, ca.SX.eye(n))
        multipliers = self.inertia @ self.C.T
        onto = self.J @ from_joints
        made = {
            COMMAND: self.L,
            JOINT: from_joints,
            FORCE: ca.diag(self.active) @ multipliers if multipliers.shape[0] else multipliers,
            SPEED: self.directions.T @ onto,
        }
        return Matrices(
            P=_cost(self, multipliers),
            A=ca.vertcat(ca.SX(0, n), *(made[kind][i, :] for kind, i in sources)),
            requests=_onto(self.requests, self.L).T,
            factor=self.L,
        )


@dataclass(frozen=True, slots=True)
class LimitRows:
    """lower <= A x <= upper, as expressions.

    Attributes:
        rows: what each of the m rows is.
        sources: where the rows of A come from.
        lower, upper: (m,); x = 0 is u*.
        pieces: what A is made of.
        command: (n,) u*, with the pushes on contacts within their bounds.
        clamped: sum of 2^i over the rows i of pushes that were not.
        cut: (r,) what that took from each of the requested forces.
        finite: a number that is finite only if everything in here is.
    """

    rows: tuple[Row, ...]
    sources: tuple[Source, ...]
    lower: ca.SX
    upper: ca.SX
    pieces: Pieces
    command: ca.SX
    clamped: ca.SX
    cut: ca.SX
    finite: ca.SX

    @property
    def violation(self) -> ca.SX:
        """The violation of limits by u*: not above 0 where it keeps all of them.

        NaN where a number is not finite, which the larger of two numbers would hide.
        """
        beyond = ca.mmax(ca.vertcat(self.lower, -self.upper))
        return beyond + _NOTHING * self.finite


def _onto(requests: ca.SX, L: ca.SX) -> ca.SX:
    """(n, r) what x adds to the force along each of the requested rows (r, n)."""
    columns = []
    for k in range(requests.shape[0]):
        rate = linear.forward(L, requests[k, :].T)
        columns.append(rate / ca.sumsqr(rate))
    return ca.horzcat(ca.SX(L.shape[0], 0), *columns)


def _cost(pieces: TorquePieces, multipliers: ca.SX) -> ca.SX:
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
    """The limits of a stage, around the torque that its law commands.

    Args:
        context: of the task.
        limits: of the stage.
        state: the arm on the task axes.
        terms: model terms, in the world.
        contacts: of the stage.
        requests: (r, n) rows along which the stage requests forces.
        wanted: (n,) u* [N m].
        last: (n,) the torque before, None without a limit on its rate.
        q, v: (n,) measured.
        environment: (n,) torque that the environment exerts [N m].
    """
    L = state.H_factor
    acceleration = linear.solve(L, wanted + environment - terms.bias)
    on = Contacts(contacts, L)
    pushes = wanted_pushes(context, limits, on, acceleration)
    T, M = linear.forward(L, state.J.T), linear.cholesky(state.mobility)
    x = on.along_normals(T, M, pushes.shift())
    wanted = wanted + L @ x
    acceleration = acceleration + linear.backward(L, x)
    directions = ca.SX(3, 0)
    found = Bounds()
    add_torques(found, context, limits, wanted, last)
    add_joints(found, context, limits, q, v, acceleration)
    clamped = add_pushes(found, pushes, on.inertia @ (on.C.T @ x))
    if limits.speed is not None:
        directions = add_speed(found, context, limits, terms, L, acceleration)
    n, t = L.shape[0], len(state.axes)
    redundant = n > t
    return LimitRows(
        rows=tuple(found.rows),
        sources=tuple(found.sources),
        lower=ca.vertcat(ca.SX(0, 1), *found.lower),
        upper=ca.vertcat(ca.SX(0, 1), *found.upper),
        pieces=TorquePieces(
            L=L,
            T=T if redundant else ca.SX(n, 0),
            M=M if redundant else ca.SX(0, 0),
            C=on.C,
            inertia=on.inertia,
            active=on.active,
            J=terms.J[:3, :],
            directions=directions,
            requests=requests,
        ),
        command=wanted,
        clamped=clamped,
        cut=_onto(requests, L).T @ x,
        finite=ca.sumsqr(acceleration) + ca.sumsqr(pushes.wanted) + ca.sumsqr(v),
    )
