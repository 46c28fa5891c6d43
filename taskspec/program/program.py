"""A compiled task."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.execution.machine import Machine, Views
from taskspec.program.execution.stage_solver import OwnSolver, no_own_solver
from taskspec.program.plan import TaskPlan
from taskspec.program.ports import fields_of
from taskspec.program.stages.stage import CompiledStage, compile_stage
from taskspec.program.world.estimated_frames import estimates
from taskspec.robot.model_terms import ModelTerms
from taskspec.text.diagnostic import Diagnostic, Severity

#: A world that `vary` allows is not that of a run: that a stage is unstable in one of them keeps
#: nothing from running.
_OF_OTHER_WORLDS = ("TS503",)


def compiled(task: TaskPlan) -> tuple[CompiledStage, ...]:
    """The stages of a task, as `compiled_stage` has them.

    Raises:
        SpecError: a stage cannot evaluate a signal.
    """
    return tuple(compiled_stage(task, name) for name in task.stages)


def compiled_stage(task: TaskPlan, name: str) -> CompiledStage:
    """A stage of a task, compiled once for its analysis and for all who run it.

    Raises:
        SpecError: it cannot evaluate a signal.
    """
    if name not in task.compiled:
        stage = task.follow(name)
        # Its design may have compiled it to see how the loop does.
        loop = stage.design.loop
        task.compiled[name] = (
            compile_stage(stage) if loop is None else replace(loop.stage, plan=stage)
        )
    found: CompiledStage = task.compiled[name]
    return found


@dataclass(frozen=True, slots=True)
class Program:
    """A compiled task.

    Attributes:
        plan: of the task.
        stages: compiled, in the order of the file.
        findings: all that was found about the task, errors that were lifted by force included.
    """

    plan: TaskPlan
    stages: tuple[CompiledStage, ...]
    findings: tuple[Diagnostic, ...] = ()

    @property
    def forced(self) -> tuple[str, ...]:
        """Codes of the findings that refuse the task and were lifted by force, each once."""
        return tuple(dict.fromkeys(d.code for d in refusals(self.findings)))

    @property
    def context(self) -> Context:
        """Robot, start, frames, surfaces."""
        return self.plan.context

    @property
    def output_size(self) -> int:
        """Length of a machine's `outputs`."""
        return sum(n for _, n in fields_of(self.context.loaded.task, self.context.robot.n))

    def past(self, stage: str, limit: str) -> Program:
        """The same program, one stage of which goes on beyond the limits of a name."""
        plan = next(each.plan for each in self.stages if each.name == stage)
        beyond = compile_stage(plan.but(unheeded=plan.unheeded | {limit}))
        stages = tuple(beyond if each.name == stage else each for each in self.stages)
        return replace(self, stages=stages)

    def machine(
        self,
        views: Views | None = None,
        terms: type[ModelTerms] = CompiledTerms,
        own: OwnSolver = no_own_solver,
    ) -> Machine:
        """A fresh machine.

        Args:
            views: 1-D arrays for its inputs and outputs; it makes its own without them.
            terms: who evaluates the model terms; Pinocchio is ready at once.
            own: makes the solvers that are tried before the named one.
        """
        n = self.context.robot.n
        context = self.context
        if views is None:
            lengths = (n, n, 6, len(context.loaded.task.reported), n, self.output_size)
            q, v, wrench, reactions, torque, outputs = (np.zeros(length) for length in lengths)
            views = (q, v, wrench, reactions, torque, outputs)
        return Machine(
            context.robot,
            self.stages,
            context.period,
            views,
            estimates(context.frames, context.period),
            terms,
            own,
        )


def refusals(findings: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """The findings that keep a task from being run."""
    return tuple(
        d for d in findings if d.severity is Severity.ERROR and d.code not in _OF_OTHER_WORLDS
    )
