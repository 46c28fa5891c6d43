"""The sheet of a task, as data: all that `explain` shows of a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.prediction import Extreme, StagePrediction, TaskPrediction, look, predict
from taskspec.program.program import Program
from taskspec_runner.cli.sheet.collisions import collision_rows
from taskspec_runner.cli.sheet.defaults import default_rows
from taskspec_runner.cli.sheet.objects import object_rows
from taskspec_runner.cli.sheet.predicted import duration_text
from taskspec_runner.cli.sheet.stability import StabilitySheet, stability_sheet
from taskspec_runner.cli.sheet.stage import (
    FrameRow,
    StageSheet,
    frame_rows,
    robot_rows,
    stage_sheet,
)
from taskspec_runner.record.folder import plain

Pairs = tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Sheet:
    """A compiled task.

    Attributes:
        name, about: of the task.
        robot, world, defaults: pairs of a name and what it is.
        duration: of the run.
        frames: all of them.
        stages: in order, with their poles and bounds where they touch or hold something.
        expected: expectations as written.
        prediction: the numbers behind it.
    """

    name: str
    about: str
    robot: Pairs
    duration: str
    world: Pairs
    frames: tuple[FrameRow, ...]
    stages: tuple[tuple[StageSheet, StabilitySheet | None], ...]
    expected: tuple[str, ...]
    defaults: Pairs
    prediction: TaskPrediction


def sheet(program: Program) -> Sheet:
    """The sheet of a task."""
    task = program.context.loaded.task
    looked = {stage.name: look(program, stage.name) for stage in program.stages}
    prediction = predict(program, looked)
    stages = tuple(
        (
            stage_sheet(program, stage, prediction[stage.name]),
            stability_sheet(program, looked[stage.name]),
        )
        for stage in program.stages
    )
    lasting = prediction.duration
    why = f": {lasting.why}" if lasting.expected is None else ""
    return Sheet(
        name=task.name,
        about=task.about or "",
        robot=(*robot_rows(program), *collision_rows(program)),
        duration=duration_text(lasting) + why,
        world=tuple(object_rows(program)),
        frames=frame_rows(program),
        stages=stages,
        expected=tuple(expectation.title for expectation in task.expect),
        defaults=tuple(default_rows(program)),
        prediction=prediction,
    )


def as_data(made: Sheet) -> dict[str, Any]:
    """The sheet for other programs: words as they are shown, and the numbers behind them [SI]."""
    found: dict[str, Any] = {
        "name": made.name,
        "about": made.about,
        "robot": _named(made.robot),
        "world": dict(made.world),
        "frames": [asdict(frame) for frame in made.frames],
        "stages": [
            asdict(stage)
            | {"kept": dict(stage.kept), "ends": _named(stage.ends)}
            | {"selection": dict(stage.selection)}
            | {"stability": None if stability is None else asdict(stability)}
            | {"prediction": _prediction(made.prediction[stage.name])}
            for stage, stability in made.stages
        ],
        "duration": asdict(made.prediction.duration),
        "expect": list(made.expected),
        "defaults": dict(made.defaults),
    }
    plain_data: dict[str, Any] = plain(found)
    return plain_data


def _named(pairs: Pairs) -> list[dict[str, str]]:
    """Pairs whose names may come twice."""
    return [{"name": name, "value": value} for name, value in pairs]


def _prediction(stage: StagePrediction) -> dict[str, Any]:
    """The numbers of a stage [SI], with those that follow from others."""
    found = _open(stage)
    assert isinstance(found, dict)
    if stage.impact is not None:
        found["impact"]["peak"] = stage.impact.peak
    for axis, mode in stage.settling.items():
        found["settling"][axis]["settling_time"] = mode.settling_time
    return found


def _open(value: Any) -> Any:
    """Dataclasses as mappings; a value of `vary` by its path, with its component if it has one."""
    if isinstance(value, Extreme):
        parts = [{"path": p, "index": i, "value": v} for (p, i), v in value.values.items()]
        return {"value": value.value, "with": parts}
    if is_dataclass(value):
        return {f.name: _open(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {key: _open(entry) for key, entry in value.items()}
    if isinstance(value, tuple):
        return [_open(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value.value if isinstance(value, Enum) else value
