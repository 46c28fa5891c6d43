"""The plan of a loaded task: where its arm starts, where the tool goes, and which gains hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.plan import TaskPlan
from taskspec.program.prepare import prepare
from taskspec.program.walk.nominal import NominalWalk
from taskspec.program.walk.starts import roomiest
from taskspec.spec import LoadedTask
from taskspec.stability.held_design import best_design

Vector = NDArray[np.float64]


def plan_task(loaded: LoadedTask, stages: int | None = None) -> TaskPlan:
    """The plan of a task, from a start with room for its motions where the file leaves one.

    Args:
        loaded: the task.
        stages: so many of them, from the first on, are to have room; None for all of them.

    Raises:
        SpecError: the robot cannot be loaded or its start cannot be reached.
    """
    context = prepare(loaded)

    def start_at(q: Vector) -> TaskPlan:
        return TaskPlan(prepare(loaded, context.robot, q), NominalWalk, best_design)

    return roomiest(lambda: TaskPlan(context, NominalWalk, best_design), start_at, stages)
