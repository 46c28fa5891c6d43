"""From a loaded task to a program: robot, frames, stages as functions, and their machine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.check import check_stages
from taskspec.program.context import Context
from taskspec.program.errors import spec_error
from taskspec.program.execution.machine import Machine, Views
from taskspec.program.execution.sensor_zero import sensor_zero
from taskspec.program.ports import fields
from taskspec.program.prepare import frame_at_start, prepare
from taskspec.program.reference.paths import path_shape
from taskspec.program.signals import UnknownSignalError
from taskspec.program.stages.stage import CompiledStage, compile_stage
from taskspec.program.world.felt import estimates
from taskspec.spec import FILE, LoadedTask
from taskspec.text.diagnostic import Diagnostic, Severity, SpecError

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Program:
    """A compiled task.

    Attributes:
        context: robot, start, frames, surfaces. stages: in the order of the file.
        warnings: findings that do not keep the task from running.
    """

    context: Context
    stages: tuple[CompiledStage, ...]
    warnings: tuple[Diagnostic, ...]

    @property
    def output_size(self) -> int:
        """Length of a machine's `outputs`."""
        return sum(length for _, length in fields(len(self.context.equations)))

    def machine(self, views: Views | None = None) -> Machine:
        """A fresh machine; `views` are 1-D arrays for its inputs and outputs."""
        n = self.context.robot.pin.nv
        context = self.context
        if views is None:
            lengths = (n, n, 6, len(context.equations), n, self.output_size)
            q, v, wrench, reactions, torque, outputs = (np.zeros(length) for length in lengths)
            views = (q, v, wrench, reactions, torque, outputs)
        return Machine(
            context.robot,
            self.stages,
            context.period,
            views,
            sensor_zero(context.loaded.task, context.robot),
            estimates(context.frames, context.period),
        )


def compile_task(loaded: LoadedTask) -> Program:
    """Compiles a task.

    Raises:
        SpecError: the robot, its start, a frame or an axis is not as the file says; it carries
            everything that was found.
    """
    context = prepare(loaded)
    found = check_stages(context)
    if any(d.severity is Severity.ERROR for d in found):
        raise SpecError(found, loaded.sources)
    stages = []
    for name, stage in loaded.task.stages.items():
        rotation = frame_at_start(context, context.frame_of(stage))
        path = path_shape(context, name, rotation)
        ready = path.ready() if path is not None else None
        try:
            stages.append(compile_stage(context, name, ready, rotation))
        except UnknownSignalError as error:
            message = f"stage {name!r} cannot evaluate {error}"
            raise spec_error(loaded, FILE.stages[name], "TS224", message) from error
    return Program(context, tuple(stages), (*loaded.warnings, *found))
