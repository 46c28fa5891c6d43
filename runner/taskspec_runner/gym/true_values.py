"""What is worked out of ticks: signals and formulas, in the truth of a world or as measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from taskspec.expression import tree
from taskspec.program.program import Program
from taskspec.spec import Task
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.truth import Formulas, Truth

Vector = NDArray[np.float64]


class Values:
    """Works values out of ticks, for one thread at a time: its functions have memory of their own.

    Attributes:
        names: of what it works out.
    """

    def __init__(self, truth: Truth) -> None:
        self._truth, self.names, self._lock = truth, truth.names, Lock()

    def __call__(self, rows: Vector) -> Vector:
        """(ticks, names) values, from rows of the bus (ticks, fields)."""
        with self._lock:
            return self._truth(rows)


class TrueValues:
    """Values of ticks, in whichever world; those that no object bears on are compiled once."""

    def __init__(
        self, program: Program, names: Sequence[str], formulas: Formulas | None = None
    ) -> None:
        """Takes the names of signals, as a log has them, and formulas by theirs."""
        self._program, self._formulas = program, formulas or {}
        self.names = (*names, *self._formulas)
        task = program.context.loaded.true_task
        alike = not any(_of_objects(path, task) for path in self._paths(names))
        self._alike = values_of(program, task, self.names, self._formulas) if alike else None

    def _paths(self, names: Sequence[str]) -> Iterator[tuple[str, ...]]:
        yield from (tuple(name.split(".")) for name in names)
        for of_stage in self._formulas.values():
            for node in of_stage.values():
                yield from (each.path for each in tree.walk(node) if isinstance(each, tree.Name))

    def of(self, task: Task) -> Values | None:
        """What works them out where a task has the true world; None where there are none."""
        if not self.names:
            return None
        return self._alike or values_of(self._program, task, self.names, self._formulas)


def _of_objects(path: tuple[str, ...], task: Task) -> bool:
    """Whether the value of a name depends on where objects truly are."""
    # A param may have the name of a stage.
    inner = path[1:] if len(path) > 1 and path[0] in task.stages else path
    return inner[:1] == ("gap",) or inner[0] in task.world


def values_of(
    program: Program,
    task: Task,
    names: Sequence[str],
    formulas: Formulas | None = None,
    *,
    measured: bool = False,
) -> Values:
    """What works out signals of ticks.

    Args:
        program: of the task.
        task: whose world it is: the true one, or of what is measured the nominal one.
        names: of the signals and formulas.
        formulas: by name.
        measured: whether they are to be as the controller has them.
    """
    robot, nominal = program.context.robot, program.context.loaded.task
    places: Mapping[str, int] = LogLayout.of(program, nominal).fields_of_columns
    fields, stages = Bus(robot.n, nominal).slices, program.stages
    truth = Truth(robot, task, stages, fields, names, places, formulas=formulas, measured=measured)
    return Values(truth)
