"""What an expression of the file is worth before anything has been measured."""

from __future__ import annotations

import math
from collections.abc import Mapping

from taskspec.program.context import Context
from taskspec.text.expression import Expression, FloatAlgebra, evaluate


def known_value(
    context: Context, expression: Expression, clocks: Mapping[str, float] | None = None
) -> float | None:
    """The value from params and the given clocks; None where it depends on anything else."""
    params = {name: q.value for name, q in context.loaded.task.params.items()}
    known = {"pi": math.pi} | params | dict(clocks or {})
    try:
        return evaluate(expression.tree, FloatAlgebra(), lambda name: known[str(name)])
    except KeyError:
        return None
