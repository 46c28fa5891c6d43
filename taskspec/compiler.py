"""From a loaded task to a program: robot, frames, stages as functions, and their machine.

What refuses a task on this way is `admit`; `validate` shows the same findings.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.examination import Examination, examine
from taskspec.foresight.task_plan import TaskPlan, plan_task
from taskspec.program.context import Context
from taskspec.program.errors import spec_error
from taskspec.program.execution.machine import Machine, Views
from taskspec.program.execution.sensor_zero import sensor_zero
from taskspec.program.ports import fields
from taskspec.program.signals import UnknownSignalError
from taskspec.program.stages.stage import CompiledStage, compile_stage
from taskspec.program.world.estimated_frames import estimates
from taskspec.spec import FILE, LoadedTask
from taskspec.text.diagnostic import Diagnostic, Severity, SpecError

Vector = NDArray[np.float64]


#: The code of a stage that is predicted to be unstable in the world of its file.
UNSTABLE = "TS501"
#: A world that `vary` allows is not that of a run: that a stage is unstable in one of them keeps
#: nothing from running.
_OF_OTHER_WORLDS = ("TS503",)


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
        return sum(length for _, length in fields(len(self.context.equations)))

    def machine(self, views: Views | None = None) -> Machine:
        """A fresh machine; `views` are 1-D arrays for its inputs and outputs."""
        n = self.context.robot.pin.nv
        context, task = self.context, self.context.loaded.task
        if views is None:
            lengths = (n, n, 6, len(context.equations), n, self.output_size)
            q, v, wrench, reactions, torque, outputs = (np.zeros(length) for length in lengths)
            views = (q, v, wrench, reactions, torque, outputs)
        return Machine(
            context.robot,
            self.stages,
            context.period,
            views,
            sensor_zero(task, task.robot.sensor, context.robot),
            estimates(context.frames, context.period),
        )


def refusals(findings: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """The findings that keep a task from being run."""
    return tuple(
        d for d in findings if d.severity is Severity.ERROR and d.code not in _OF_OTHER_WORLDS
    )


def compile_task(loaded: LoadedTask, *, force: bool = False) -> Program:
    """Compiles a task that nothing speaks against.

    Args:
        loaded: the task.
        force: whether findings are lifted behind which a program still compiles.

    Raises:
        SpecError: the task is refused; it carries everything that was found.
    """
    return admit(examine(loaded), force=force)


def admit(examined: Examination, *, force: bool = False) -> Program:
    """Compiles an examined task: the one gate that a task passes on its way to a run.

    Args:
        examined: the task with what was found about it.
        force: whether findings are lifted behind which a program still compiles.

    Raises:
        SpecError: the task is refused; it carries everything that was found.
    """
    findings, plan = examined.findings, examined.plan
    sources = examined.loaded.sources
    against = refusals(findings)
    if plan is None or (against and not force):
        raise SpecError(findings, sources)
    try:
        return Program(plan, _stages(plan), findings)
    except Exception as error:
        if against:
            # Behind an error that was lifted nothing is promised to the compiler.
            raise SpecError(findings, sources) from error
        if isinstance(error, SpecError):
            raise SpecError((*findings, *error.diagnostics), sources) from error
        raise


def compile_unchecked(loaded: LoadedTask) -> Program:
    """Compiles a task without a look at whether it should run, such as that of an earlier run.

    Raises:
        SpecError: the robot, its start, a frame or an axis is not as the file says.
    """
    plan = plan_task(loaded)
    return Program(plan, _stages(plan))


def _stages(task: TaskPlan) -> tuple[CompiledStage, ...]:
    loaded, stages = task.context.loaded, []
    for name, plan in task.stages.items():
        try:
            stages.append(compile_stage(plan))
        except UnknownSignalError as error:
            message = f"stage {name!r} cannot evaluate {error}"
            raise spec_error(loaded, FILE.stages[name], "TS224", message) from error
    return tuple(stages)
