"""The plan of a task: its stages, and where the tool is expected to be in each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from taskspec.foresight.nominal import Walk
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.program.prepare import prepare
from taskspec.spec import LoadedTask


class TaskPlan:
    """A task with the plans of its stages.

    Attributes:
        context: robot, start, frames and surfaces.
        stages: by name, in the order of the file.
        framed: those of them whose frame is known to have axes as the run begins; they are entered
            as the task is examined.
    """

    def __init__(self, context: Context) -> None:
        self.context = context
        self._walk = walk = Walk(context)
        self.stages: Mapping[str, StagePlan] = {
            name: StagePlan(context, name, lambda: walk.tool) for name in context.loaded.task.stages
        }
        self.framed: dict[str, StagePlan] = {}

    def unvaried(self) -> TaskPlan:
        """The plan of the same task with nothing that varies."""
        loaded = self.context.loaded
        alone = loaded.task.model_copy(update={"vary": {}})
        return TaskPlan(replace(self.context, loaded=replace(loaded, task=alone)))

    def follow(self, name: str) -> StagePlan:
        """A stage with its nominal trajectory, which goes on from that of the last one followed.

        Args:
            name: of the stage; stages are followed in the order of the file.
        """
        stage = self.stages[name]
        if not stage.followed:
            stage.nominal = self._walk.stage(stage)
        return stage


def plan_task(loaded: LoadedTask) -> TaskPlan:
    """The plan of a task.

    Raises:
        SpecError: the robot cannot be loaded or its start cannot be reached.
    """
    return TaskPlan(prepare(loaded))
