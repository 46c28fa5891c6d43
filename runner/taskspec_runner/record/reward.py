"""The reward that a file states, tick by tick: a column of the log."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from taskspec.expression import Expression, resolve
from taskspec.expression.scope import CONSTANTS, ScopeKind
from taskspec.expression.tree import Name
from taskspec.program.algebra import CasadiAlgebra
from taskspec.signals import Situation
from taskspec.spec import Task
from taskspec_runner.record.named import column_of, scope_of

#: The column that has it [1/s].
REWARD = "reward"


def rate_of(
    rate: Expression | None, task: Task, at: Situation, columns: Mapping[str, ca.SX]
) -> ca.SX:
    """The reward in a second, of the truth of a tick.

    Args:
        rate: as the file has it for the stage; None where that earns nothing.
        task: with its params.
        at: the tool, in truth.
        columns: what the log has as a number of the tick, by its name.
    """
    if rate is None:
        return ca.SX(0)
    scope = scope_of(task, ScopeKind.REWARD)

    def value(name: Name) -> ca.SX:
        meaning = resolve(name.path, scope)
        assert meaning is not None, name
        if meaning.kind == "param":
            return ca.SX(task.params[meaning.name].value)
        if meaning.kind == "constant":
            return ca.SX(CONSTANTS[meaning.name][0])
        if meaning.kind == "link":
            # Plant and controller are one loop, or one waits for the other.
            return columns.get(column_of(meaning), ca.SX(0))
        column = column_of(meaning)
        found = columns.get(column)
        found = at.signal(*column.split(".")) if found is None else found
        return ca.SX(np.nan) if found is None else found

    return CasadiAlgebra(None, 1 / task.control.rate).translate(rate, value)
