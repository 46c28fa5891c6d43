"""Time as the stage's functions see it, and derivatives along it."""

from __future__ import annotations

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.robot.model_terms import TermSymbols


@dataclass(frozen=True, slots=True)
class Clock:
    """Symbols of time.

    Attributes:
        t: [s] since the stage began.
        clock: [s] since the run began.
        live: (k,) params that may be set while the stage runs; None where a task has none.
        live_rate: (k,) their derivatives by time, which do not change while they go on.
    """

    t: ca.SX
    clock: ca.SX
    live: ca.SX | None = None
    live_rate: ca.SX | None = None

    def rate(self, expression: ca.SX) -> ca.SX:
        """Partial derivative by time, everything but t, clock and live params held."""
        rate = ca.jtimes(expression, ca.vertcat(self.t, self.clock), ca.SX.ones(2))
        if self.live is not None:
            # A sum of its own: what no live param bears on has the bits that it has without one.
            rate += ca.jtimes(expression, self.live, self.live_rate)
        return rate

    def apart(self, expression: ca.SX) -> tuple[ca.SX, ...]:
        """The summands of an expression, where one of two follows from live params alone.

        Computed apart and then added, the other has the bits that it has without them.
        """
        if self.live is None or not (expression.is_op(ca.OP_ADD) or expression.is_op(ca.OP_SUB)):
            return (expression,)
        one, other = expression.dep(0), expression.dep(1)
        other = other if expression.is_op(ca.OP_ADD) else -other
        one_moves, other_moves = (bool(ca.depends_on(x, self.live)) for x in (one, other))
        if one_moves is other_moves:
            return (expression,)
        return (other, one) if one_moves else (one, other)

    def total_rate(self, expression: ca.SX, terms: TermSymbols) -> ca.SX:
        """Derivative by time along the tool's actual motion, of an expression of time and pose."""
        terms = terms.world or terms
        R_rate = ca.skew(terms.twist[3:]) @ terms.R
        pose = ca.vertcat(terms.p, ca.vec(terms.R))
        motion = ca.vertcat(terms.twist[:3], ca.vec(R_rate))
        return self.rate(expression) + ca.jtimes(expression, pose, motion)
