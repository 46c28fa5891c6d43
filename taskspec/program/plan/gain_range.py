"""The values that the expressions take by which a stage's gains vary, before anything moves."""

from __future__ import annotations

import math

from taskspec.expression import Expression, FloatAlgebra, evaluate
from taskspec.expression.tree import Name
from taskspec.program.context import Context
from taskspec.program.interval import Interval
from taskspec.program.reference.path_share import values_within
from taskspec.program.signals import declared
from taskspec.spec import Stage


class GainRange:
    """Nominal values and ranges of such expressions."""

    def __init__(self, context: Context, spec: Stage, contact: str | None, longest: float) -> None:
        """Of a stage.

        Args:
            context: the arm at the start pose.
            spec: its entry in the file.
            contact: the object whose `gap` is meant; None without one.
            longest: after which the stage has ended whatever happens [s].
        """
        self._context, self._spec, self._contact, self._longest = context, spec, contact, longest

    def nominal(self, expression: Expression) -> float:
        """The value that gains are designed for and explained with [SI].

        It is that at the beginning, at the gaps of the start pose and with all other signals zero.
        Where this is not positive, it is the middle of a bounded range, else 1.
        """
        value = self.at_start(expression)
        if math.isfinite(value) and value > 0:
            return value
        within = self.of(expression)
        middle = (max(within.low, 0.0) + within.high) / 2
        return middle if math.isfinite(middle) and middle > 0 else 1.0

    def at_start(self, expression: Expression) -> float:
        """The value at the beginning, whatever it is [SI]; see `nominal`."""
        return evaluate(expression.tree, FloatAlgebra(), self._start)

    def _start(self, name: Name) -> float:
        known = declared(self._context, name)
        if known is not None:
            return known
        text = str(name)
        of = self._contact if text == "gap" else text.removesuffix(".gap")
        return float(self._context.start_gaps.get(of or "", 0.0)) if text.endswith("gap") else 0.0

    def of(self, expression: Expression) -> Interval:
        """The range while signals stay within their nature and the stage within its limits [SI]."""
        return values_within(self._context, self._spec, expression, self._longest)
