"""A task with the plans of its stages, followed in the order of the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.program.plan.design import Design
from taskspec.program.plan.stage import StagePlan
from taskspec.program.prepare import prepare
from taskspec.program.reference.paths import joint_end
from taskspec.program.trajectory import Nominal

Vector = NDArray[np.float64]


class Walk(Protocol):
    """What tells where the tool goes, stage after stage."""

    @property
    def tool(self) -> tuple[Vector, Vector]:
        """(3,), (3, 3) where the tip is last known to be, world axes."""

    def stage(self, stage: StagePlan) -> Nominal:
        """The nominal trajectory of the stage that comes next in the file."""


class TaskPlan:
    """A task with the plans of its stages.

    Attributes:
        context: robot, start, frames and surfaces.
        stages: by name, in the order of the file.
        framed: those of them whose frame is known to have axes as the run begins; they are entered
            as the task is examined.
        loops: the sampled loops of stages that were analysed, by name.
        courses: of their forces, once they were asked for.
        compiled: their functions, once they were asked for, by name.
    """

    def __init__(
        self,
        context: Context,
        walk: Callable[[Context], Walk],
        choose: Callable[[StagePlan], Design] | None = None,
    ) -> None:
        """The plans of the stages of a task.

        Args:
            context: robot, start, frames and surfaces.
            walk: makes what tells where the tool goes, from the start pose on.
            choose: knows the best design of a stage that holds a mechanism.
        """
        self.context, self._choose = context, choose
        self._walk_from_start, self._walk = walk, walk(context)
        self.stages: Mapping[str, StagePlan] = {
            name: StagePlan(at, name, self._tool, choose) for name, at in _contexts(context)
        }
        self.framed: dict[str, StagePlan] = {}
        self.loops: dict[str, Any] = {}
        self.courses: tuple[Any, ...] = ()
        self.compiled: dict[str, Any] = {}

    def unvaried(self) -> TaskPlan:
        """The plan of the same task with nothing that varies."""
        loaded = self.context.loaded
        alone = loaded.task.model_copy(update={"vary": {}})
        context = replace(self.context, loaded=replace(loaded, task=alone))
        return TaskPlan(context, self._walk_from_start, self._choose)

    def _tool(self) -> tuple[Vector, Vector]:
        return self._walk.tool

    def follow(self, name: str) -> StagePlan:
        """A stage with its nominal trajectory, which goes on from that of the last one followed.

        Args:
            name: of the stage; stages are followed in the order of the file.
        """
        stage = self.stages[name]
        if not stage.followed:
            # Where the stage starts is known now: the walk goes on from there.
            stage.kinematics.tool = self._walk.tool
            stage.nominal = self._walk.stage(stage)
        return stage


def _contexts(context: Context) -> Iterator[tuple[str, Context]]:
    """Each stage in the order of the file, with the arm from which its law is designed.

    That is the arm at the start of the run, and after a path of joints the arm at its end: gains,
    stability and what is near count from where the tool works, not from where it was folded.
    """
    for name, spec in context.loaded.task.stages.items():
        yield name, context
        path = spec.path
        if path is None or path.joints is None:
            continue
        target = joint_end(context, path.joint_motion, path.time or 0.0)
        if path.joint_targets:
            target = np.array(path.joint_targets[-1], dtype=float)
        # What does not fit the arm is for the rules to say.
        if target is not None and len(target) == context.robot.n:
            context = prepare(context.loaded, context.robot, target)
