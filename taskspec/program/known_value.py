"""The value of an expression of the file before anything has been measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from taskspec.expression import Expression, FloatAlgebra
from taskspec.expression.evaluate import Lookup, prepared
from taskspec.program.context import Context


class KnownValues:
    """Values of a task's expressions at many times: each is prepared once."""

    def __init__(self, context: Context) -> None:
        """Takes the task whose params they have."""
        params = {name: q.value for name, q in context.loaded.task.params.items()}
        self._constants = {"pi": math.pi} | params
        self._prepared: dict[int, tuple[Expression, Callable[[Lookup[float]], float]]] = {}

    def __call__(
        self, expression: Expression, clocks: Mapping[str, float] | None = None
    ) -> float | None:
        """The value from params and the given clocks; None where it depends on anything else."""
        # By identity, which is there at once: the expression is kept, so that no other gets it.
        found = self._prepared.get(id(expression))
        if found is None:
            found = expression, prepared(expression.tree, FloatAlgebra())
            self._prepared[id(expression)] = found
        known = self._constants | dict(clocks) if clocks else self._constants
        try:
            return found[1](lambda name: known[str(name)])
        except KeyError:
            return None


def known_value(
    context: Context, expression: Expression, clocks: Mapping[str, float] | None = None
) -> float | None:
    """The value of one expression, see `KnownValues`."""
    return KnownValues(context)(expression, clocks)
