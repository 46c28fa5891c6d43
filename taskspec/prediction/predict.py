"""The prediction of a task, from its compiled stages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.prediction.at_start import StageAtStart, stages_at_start
from taskspec.prediction.duration import Known, guarded, mechanism_rate, planned, whole
from taskspec.prediction.equilibrium import at_rest
from taskspec.prediction.forecast import moved
from taskspec.prediction.impact import cut_short, impact
from taskspec.prediction.natural import natural
from taskspec.prediction.returned_forces import returned_at_start
from taskspec.prediction.selection import selection
from taskspec.prediction.settling import settling
from taskspec.prediction.types import StagePrediction, TaskPrediction
from taskspec.program.program import Program
from taskspec.stability.loop import Mode, UnfitError
from taskspec.stability.sampled_stage import SampledStage, loop_of


@dataclass(frozen=True, slots=True)
class Looked:
    """A stage as a sampled loop, and its modes."""

    sampled: SampledStage
    modes: tuple[Mode, ...]


def look(program: Program, name: str) -> Looked | None:
    """The sampled loop of a stage; None where it cannot be looked at, or controls joints."""
    if program.plan.stages[name].joint_path is not None:
        return None
    try:
        sampled = loop_of(program.plan, name)
        return None if sampled is None else Looked(sampled, sampled.modes())
    except (UnfitError, np.linalg.LinAlgError):
        return None


def predict(program: Program, looked: Mapping[str, Looked | None] | None = None) -> TaskPrediction:
    """What every stage of a task is expected to do.

    Args:
        program: the compiled task.
        looked: sampled loops by stage, where a caller has them already; looked at here otherwise,
            which takes most of the time.
    """
    if looked is None:
        looked = {stage.name: look(program, stage.name) for stage in program.stages}
    found = tuple(predict_stages(program, looked))
    return TaskPrediction(found, whole(program.context.loaded.task.stages, found))


def predict_stages(
    program: Program, looked: Mapping[str, Looked | None]
) -> Iterator[StagePrediction]:
    """One prediction after the other, in the order of the file; `looked` as for `predict`."""
    coordinate: float | None = 0.0
    begins = 0.0
    for here in stages_at_start(program):
        one = _stage(program, here, looked.get(here.stage.name), coordinate, begins)
        yield one
        begins += one.duration.expected or 0.0
        coordinate = _coordinate_after(here, coordinate, one)


def _stage(
    program: Program,
    here: StageAtStart,
    looked: Looked | None,
    coordinate: float | None,
    begins: float,
) -> StagePrediction:
    poles = {} if looked is None else settling(looked.sampled, looked.modes)
    lasts = planned(here)
    met = impact(here)
    within = here.stage.plan.spec.within
    longest = (within.time if within else None) if lasts is None else lasts.expected
    sampled = None if looked is None else looked.sampled
    returned = returned_at_start(program, here.stage)
    rest = at_rest(here, longest, returned, sampled, begins)
    if lasts is None:
        lasts = guarded(here, Known(met, rest.forces, coordinate))
        met = None if met is None else cut_short(here, met, lasts.expected)
    found = StagePrediction(
        name=here.stage.name,
        duration=lasts,
        equilibrium=rest.forces,
        depths=rest.depths,
        settling=poles,
        impact=met,
        drift=rest.drift,
        left_out=rest.left_out,
    )
    return replace(found, natural=natural(here, found), selection=selection(here))


def _coordinate_after(
    here: StageAtStart, coordinate: float | None, one: StagePrediction
) -> float | None:
    """Of the held mechanism as the stage ends [rad, m]; None where that is unknown."""
    rate, lasts = mechanism_rate(here), one.duration.expected
    if not here.stage.plan.contacts.held or coordinate is None:
        return coordinate
    held = here.context.loaded.task.mechanisms[here.stage.plan.contacts.held]
    if rate is None or lasts is None:
        return None
    low, high = held.stop or (-np.inf, np.inf)
    return float(np.clip(coordinate + moved(rate, lasts), low, high))
