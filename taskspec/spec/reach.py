"""Fields that hold an interval of constants around 0: `0..90 deg` or `+- 90 deg`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from taskspec.spec import values
from taskspec.spec.kinds import Kind
from taskspec.spec.reading import Reading
from taskspec.text.data import Real, Text, Whole
from taskspec.text.expression import Problem, ScopeKind, check
from taskspec.text.expression.tree import Interval, Spread
from taskspec.text.units import Dimension, describe, fitting


@dataclass(frozen=True)
class Reach(Kind):
    """From a least to a greatest value, 0 between them."""

    dimension: Dimension

    def read(self, value: object, reading: Reading) -> tuple[float, float]:
        """Return both ends in SI units."""
        node = values.parsed(value, "uncertain", reading, "an interval")
        if node is None:
            return 0.0, 0.0
        assert isinstance(value, Text | Whole | Real)
        checked = check(node, reading.scope(ScopeKind.CONSTANT), self.dimension)
        problems = checked.problems
        if not problems and not isinstance(node, Interval | Spread):
            message = f"an interval of {describe(self.dimension)} is needed here"
            hint = "write a..b or '+- x'"
            problems = (Problem("TS023", message, node.start, node.end, hint),)
        reading.problems(value, problems)
        if problems:
            return 0.0, 0.0
        if isinstance(node, Spread):
            half = values.number(value, node.x, reading) or 0.0
            return -half, half
        assert isinstance(node, Interval)
        low = values.number(value, node.low, reading) or 0.0
        high = values.number(value, node.high, reading) or 0.0
        if low >= high:
            message = "this interval ends before it begins"
            problem = Problem("TS711", message, node.start, node.end, "write the smaller first")
            reading.problems(value, (problem,))
        elif not low <= 0 <= high:
            message = "this leaves out 0, where the mechanism is as it is declared"
            hint = "count from there: the run begins at 0"
            reading.problems(value, (Problem("TS118", message, node.start, node.end, hint),))
        return low, high

    def json(self) -> dict[str, Any]:
        """Describe the interval."""
        unit = fitting(self.dimension)[0]
        return {
            "type": "string",
            "description": f"From a least to a greatest value in {unit}: 'a..b' or '+- x'",
            "examples": [f"0..90 {unit}", f"+- 90 {unit}"],
        }
