"""What a picture of a task shows of its stages: frame, who controls which axis, path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.explain.artificial import artificial, force_symbol, rate_symbol
from taskspec.geometry.axis import TRANSLATIONS, Axis
from taskspec.program.plan import StagePlan, TaskPlan

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PicturedStage:
    """A stage of a plan.

    Attributes:
        name: of the stage.
        frame: name of its task frame.
        point: (3,) its control point as it starts [m].
        axes: (3, 3) its frame then, world axes.
        kinds: of its axes that exist: force, motion or free.
        words: lines of text with their kinds: what each axis is to do.
        path: (n, 3) where the control point is expected [m].
    """

    name: str
    frame: str
    point: Vector
    axes: Vector
    kinds: Mapping[Axis, str]
    words: tuple[tuple[str, str], ...]
    path: Vector


def pictured(task: TaskPlan) -> tuple[PicturedStage, ...]:
    """All stages of a plan, in the order of the file."""
    return tuple(_pictured(task.follow(name)) for name in task.stages)


def _pictured(stage: StagePlan) -> PicturedStage:
    nominal, context = stage.nominal, stage.context
    passage = nominal.passage or nominal.about
    if passage is not None:
        # The control point goes along with the tool.
        lever = context.start_R.T @ stage.kinematics.lever
        path = np.array([each.p + each.R @ lever for each in passage.instants])
        planned = [p for _, p in nominal.way()]
        if len(planned) > len(path):
            path = np.array(planned) + stage.kinematics.lever
        axes = np.asarray(passage.instants[0].frame)
    else:
        start = context.start_p if nominal.start is None else nominal.start
        path = (start + stage.kinematics.lever)[None]
        axes = np.asarray(nominal.rotation)
    kinds = {axis: _kind(stage, axis) for axis in stage.axes}
    words = tuple(_words(stage, kinds))
    return PicturedStage(stage.name, stage.frame.name, path[0], axes, kinds, words, path)


def _kind(stage: StagePlan, axis: Axis) -> str:
    """Who controls an axis: force, motion or free."""
    plan = stage.plans[axis]
    if plan.set_point:
        return "force"
    return "motion" if plan.motion else "free"


def _words(stage: StagePlan, kinds: Mapping[Axis, str]) -> Iterator[tuple[str, str]]:
    """Kind and text of what a stage's axes are to do; those that stand still together."""
    if stage.joint_path is not None:
        yield "motion", "all joints by a path of their own"
        kinds = {}
    still: dict[str, list[Axis]] = {}
    for axis, kind in kinds.items():
        text = artificial(stage, axis)
        if text in ("", f"{rate_symbol(axis)} = 0", f"{force_symbol(axis)} = 0"):
            still.setdefault(kind, []).append(axis)
        else:
            yield kind, text
    for kind, axes in still.items():
        what = {"motion": "held", "force": "without force", "free": "free"}[kind]
        yield kind, f"{', '.join(axes)} {what}"
    for name in stage.active:
        yield "force", f"{name}: constrained"


def triad(stage: PicturedStage) -> Iterator[tuple[Axis, str, Vector]]:
    """Name, kind and direction (3,) of a stage's translations whose directions are known."""
    for axis in TRANSLATIONS:
        direction = stage.axes[:, axis.column]
        if axis in stage.kinds and np.isfinite(direction).all():
            yield axis, stage.kinds[axis], direction
