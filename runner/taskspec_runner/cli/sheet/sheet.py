"""The sheet of a task, as data: all that `explain` shows of a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec_runner.cli.sheet.collisions import collision_rows
from taskspec_runner.cli.sheet.defaults import default_rows
from taskspec_runner.cli.sheet.live import LiveRow, live_rows
from taskspec_runner.cli.sheet.objects import object_rows
from taskspec_runner.cli.sheet.stability import StabilitySheet, stability_sheet
from taskspec_runner.cli.sheet.stage import (
    FrameRow,
    StageSheet,
    frame_rows,
    robot_rows,
    stage_sheet,
)
from taskspec_runner.cli.sheet.visits import how_it_ended, stage_trials
from taskspec_runner.record.folder import plain
from taskspec_runner.trial.trial import Trial

Pairs = tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Sheet:
    """A compiled task.

    Attributes:
        name, about: of the task.
        robot, world, defaults: pairs of a name and what it is.
        live: params that may be set while a stage runs.
        frames: all of them.
        stages: in order, with their poles and bounds where they touch or hold something.
        expected: expectations as written, and what the trial made of each; empty without one.
        trial: of the program; None where it was left out.
        how: the trial came to its end, or why there is none.
    """

    name: str
    about: str
    robot: Pairs
    world: Pairs
    live: tuple[LiveRow, ...]
    frames: tuple[FrameRow, ...]
    stages: tuple[tuple[StageSheet, StabilitySheet | None], ...]
    expected: Pairs
    defaults: Pairs
    trial: Trial | None
    how: str


def sheet(
    program: Program, trial: Trial | None, why_none: str = "", *, terms: bool = False
) -> Sheet:
    """The sheet of a task.

    Args:
        program: the compiled task.
        trial: of it, in the file's own world; None to tell what the plan has alone.
        why_none: why there is none, in words.
        terms: whether stages have the terms of operational space.
    """
    task = program.context.loaded.task
    came_to = {} if trial is None else stage_trials(trial)
    stages = tuple(
        (
            stage_sheet(program, stage, trial, came_to.get(stage.name), terms=terms),
            stability_sheet(program, stage.name),
        )
        for stage in program.stages
    )
    if trial is None:
        expected = tuple((each.title, "") for each in task.expect)
    else:
        expected = tuple(
            (each.title, f"{'missed: ' if each.missed else ''}{each.explanation}")
            for each in trial.judged
        )
    return Sheet(
        name=task.name,
        about=task.about or "",
        robot=(*robot_rows(program), *collision_rows(program)),
        world=tuple(object_rows(program)),
        live=live_rows(task),
        frames=frame_rows(program),
        stages=stages,
        expected=expected,
        defaults=tuple(default_rows(program)),
        trial=trial,
        how=why_none if trial is None else how_it_ended(trial),
    )


def as_data(made: Sheet) -> dict[str, Any]:
    """The sheet for other programs: words as they are shown, and the numbers behind them [SI]."""
    found: dict[str, Any] = {
        "name": made.name,
        "about": made.about,
        "robot": _named(made.robot),
        "world": dict(made.world),
        "live": {r.name: {**r.numbers, "unit": r.unit} for r in made.live},
        "frames": [asdict(frame) for frame in made.frames],
        "trial": None if made.trial is None else _trial(made.trial) | {"how": made.how},
        "stages": [
            _open(stage)
            | {"kept": dict(stage.kept), "beside": _named(stage.beside)}
            | {"ends": _named(stage.ends)}
            | {"selection": dict(stage.selection)}
            | {"trial": None if stage.trial is None else stage.trial.as_data()}
            | {"stability": None if stability is None else asdict(stability)}
            for stage, stability in made.stages
        ],
        "expect": [text for text, _ in made.expected],
        "defaults": dict(made.defaults),
    }
    plain_data: dict[str, Any] = plain(found)
    return plain_data


def _named(pairs: Pairs) -> list[dict[str, str]]:
    """Pairs whose names may come twice."""
    return [{"name": name, "value": value} for name, value in pairs]


def _trial(trial: Trial) -> dict[str, Any]:
    """How a trial ended [SI]."""
    outcome = trial.outcome
    return {
        "status": outcome.status,
        "reason": outcome.reason,
        "stage": outcome.stage,
        "duration": outcome.clock,
        "exit_code": trial.exit_code,
        "expectations": [each.as_data() for each in trial.judged],
        "findings": [each.as_data() for each in trial.findings],
    }


def _open(value: Any) -> Any:
    """Dataclasses as mappings, arrays as lists."""
    if is_dataclass(value):
        return {f.name: _open(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {key: _open(entry) for key, entry in value.items()}
    if isinstance(value, tuple):
        return [_open(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value.value if isinstance(value, Enum) else value
