"""What contacts return of what a stage under a program asks for."""

from __future__ import annotations

import numpy as np

from taskspec.modes import DEFAULT_RAMP
from taskspec.program.execution.stage_solver import ReturnedForces
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.robot.model_terms import PinocchioTerms


def returned_at_start(program: Program, stage: CompiledStage) -> ReturnedForces | None:
    """Once the ramps are over, at the start pose; None for a closed form, or without forces."""
    if stage.resolution is None:
        return None
    machine = program.machine(terms=PinocchioTerms)
    machine.q[:] = np.asarray(program.context.start)
    forces = [plan.axis.set_point for plan in stage.plan.plans.values()]
    ramps = [force.rise for force in forces if force is not None]
    return machine.returned_forces(program.stages.index(stage), max([DEFAULT_RAMP, *ramps]))
