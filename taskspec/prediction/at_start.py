"""Compiled stages as each of them begins, as far as the text of a task tells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.program.passage import Passage
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.trajectory import Course

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StageAtStart:
    """A stage that begins.

    Attributes:
        context: the task.
        stage: compiled.
        rotation: (3, 3) its frame in the world.
        gap: to the nominal contact [m]; None where that is unknown.
        nearing: at which its object comes towards the tool at rest [m/s].
        coordinates: of the tip in its frame [m, rad]; None where they are unknown.
        course: how it moves from there; None where that is not planned.
        carried: rates of the reference that is handed over [m/s, rad/s].
        passage: what the arm goes through; None where that is unknown.
    """

    context: Context
    stage: CompiledStage
    rotation: Vector
    gap: float | None
    nearing: float
    coordinates: Mapping[Axis, float] | None
    course: Course | None
    carried: Mapping[Axis, float]
    passage: Passage | None = None


def stages_at_start(program: Program) -> Iterator[StageAtStart]:
    """All stages, in the order of the file."""
    context = program.context
    for stage in program.stages:
        nominal = program.plan.follow(stage.name).nominal
        gap, nearing = nominal.gap, 0.0
        if gap is None and stage is program.stages[0]:
            gap, nearing = _carried(context, stage)
        rotation, coordinates = stage.plan.rotation, nominal.coordinates
        course, carried = nominal.course, nominal.carried
        yield StageAtStart(
            context, stage, rotation, gap, nearing, coordinates, course, carried, nominal.passage
        )


def _carried(context: Context, stage: CompiledStage) -> tuple[float | None, float]:
    """Distance [m] and speed [m/s], as the run begins, of an object that carries the frame."""
    base, contact = stage.plan.moving_base, stage.plan.contacts.main
    if contact is None or base is None:
        return None, 0.0
    moves = base.twist(0.0, context.start_p)[:3]
    return context.start_gaps[contact], float(context.start_normals[contact] @ moves)
