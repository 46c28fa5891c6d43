"""The frames of a run: what was measured and commanded, picked from its log by time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import RowFunction
from taskspec.program.reference.orientation import displaced, representation_of
from taskspec.program.stages.stage import CompiledStage
from taskspec_runner.dataset.features import (
    ACTION,
    DONE,
    FRAME,
    ROW,
    STAGE,
    STATE,
    SUCCESS,
    TIMESTAMP,
    WRENCH,
    FrameLayout,
)
from taskspec_runner.errors import InputError
from taskspec_runner.record.history import History, NotRecordedError, Visit
from taskspec_runner.record.named import param_column
from taskspec_runner.runs import RebuildError, Run
from taskspec_runner.verdict.replay import Replay

Vector = NDArray[np.float64]

#: Two times that differ by less are the same [s].
_ROUNDING = 1e-9


class RunFrames:
    """The frames of a run.

    Frame n shows the newest tick at n / fps after the first one, so frames do not drift against
    the log, whatever the rates.

    Attributes:
        run: whose they are.
        layout: what they hold.
    """

    def __init__(self, run: Run, layout: FrameLayout) -> None:
        """Frames of a run whose task can be compiled; see `layout_of`."""
        self.run, self.layout = run, layout

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """(n,) the row in the log of each frame."""
        clock, fps = self.run.history.columns["clock"], self.layout.fps
        since = clock - clock[0]
        count = int(np.floor(since[-1] * fps + _ROUNDING * fps)) + 1
        times = np.arange(count) / fps
        return np.searchsorted(since, times + _ROUNDING, side="right") - 1

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """By name, each feature of the frames but those that number them in the dataset.

        Raises:
            InputError: a signal was not recorded, or has no number.
        """
        rows = self.rows
        try:
            found = self._signals(rows)
        except NotRecordedError as error:
            raise InputError(
                f"{self.run.folder} cannot be an episode: {error.column} was not recorded; a frame "
                "needs joint positions and velocities, and of every axis of its stages .measured "
                "forces, error, and set points"
            ) from error
        for name, values in found.items():
            bad = ~np.isfinite(values).reshape(len(rows), -1).all(axis=1)
            if bad.any():
                clock = self.run.history.columns["clock"][rows[np.argmax(bad)]]
                raise InputError(
                    f"{self.run.folder} cannot be an episode: at {clock:.3f} s {name} has no number"
                )
        last = np.arange(len(rows)) == len(rows) - 1
        numbers = np.arange(len(rows))
        return {
            **{name: values.astype(np.float32) for name, values in found.items()},
            DONE: last,
            SUCCESS: last & self.run.passed,
            STAGE: self.run.history.stages[rows],
            ROW: rows,
            TIMESTAMP: (numbers / self.layout.fps).astype(np.float32),
            FRAME: numbers,
        }

    def _signals(self, rows: NDArray[np.int64]) -> dict[str, Vector]:
        columns, joints = self.run.history.columns, range(1, self.layout.joints + 1)
        measured = self._efforts("measured")
        place, axes = self._tip
        state = [columns[f"joint.{i}.{what}"][rows] for what in ("position", "velocity")
                 for i in joints]  # fmt: skip
        ages = np.arange(self.layout.window - 1, -1, -1)
        pose = _pose(place[rows], axes[rows])
        return {
            STATE: np.column_stack([*state, pose, measured[rows]]),
            WRENCH: measured[np.maximum(rows[:, np.newaxis] - ages, 0)],
            ACTION: np.column_stack(
                [
                    _pose(*self._reference(rows)),
                    self._efforts("ref")[rows],
                    *(columns[name][rows] for name in self.layout.live),
                ]
            ),
        }

    @cached_property
    def _replay(self) -> Replay:
        return self._replayed(self.run.history)

    def _replayed(self, history: History) -> Replay:
        program = self.run.program
        context = program.context
        return Replay(context.robot, context.frames, program.stages, history, context.moving_bases)

    @cached_property
    def _tip(self) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) the tip's place and axes in the world, of every tick."""
        return self._replay.tip_pose()

    @cached_property
    def _offset(self) -> Vector:
        """(n, 3) from the tip to the control point, world axes [m]."""
        return self._replay.offset()

    def _visits(self) -> Iterator[tuple[Visit, CompiledStage]]:
        stages = {stage.name: stage for stage in self.run.program.stages}
        for visit in self.run.history.visits():
            yield visit, stages[visit.stage]

    def _axes(self, stage: CompiledStage, rows: slice) -> Vector:
        """(k, 3, 3) the axes of a stage's frame in the world."""
        return self._replay.pose(stage.plan.frame)[1][rows]

    def _logged(self, visit: Visit, stage: CompiledStage, name: str) -> Vector:
        """(k, 6) of a visit, a vector of the log in the axes of its frame, 0 where it has none.

        Args:
            visit, stage: which.
            name: as in `{effort}.{axis}.ref`.
        """
        columns = self.run.history.columns
        found = np.zeros((visit.last + 1 - visit.first, 6))
        for axis in stage.plan.axes:
            found[:, axis.row] = columns[name.format(effort=axis.effort, axis=axis)][visit.rows]
        return found

    def _efforts(self, which: str) -> Vector:
        """(n, 6) force and moment about the tip in the tool's axes, of every tick.

        Args:
            which: `measured`, or `ref` for set points.
        """
        found = np.zeros((len(self.run.history), 6))
        tip = self._tip[1]
        for visit, stage in self._visits():
            logged = self._logged(visit, stage, f"{{effort}}.{{axis}}.{which}")
            if which == "ref":
                logged = np.nan_to_num(logged)
            axes = self._axes(stage, visit.rows)
            force, moment = (np.einsum("kij,kj->ki", axes, logged[:, p]) for p in _HALVES)
            moment = moment + np.cross(self._offset[visit.rows], force)
            for part, values in zip(_HALVES, (force, moment), strict=True):
                found[visit.rows, part] = np.einsum("kji,kj->ki", tip[visit.rows], values)
        return found

    def _reference(self, rows: NDArray[np.int64]) -> tuple[Vector, Vector]:
        """(k, 3), (k, 3, 3) the reference of the tip's pose in the world at some ticks.

        It lies the logged error beyond the pose; on axes without a reference it is the pose.
        """
        place, axes = (np.array(each[rows]) for each in self._tip)
        for visit, stage in self._visits():
            here = np.flatnonzero((rows >= visit.first) & (rows <= visit.last))
            if not len(here):
                continue
            at = rows[here]
            error = np.nan_to_num(self._logged(visit, stage, "error.{axis}")[at - visit.first])
            frame = self._axes(stage, visit.rows)[at - visit.first]
            given = (_flat(frame), place[here], _flat(axes[here]), self._offset[at], error)
            place[here], turned = RowFunction(_beyond(stage))(*given)
            axes[here] = turned.reshape(-1, 3, 3).transpose(0, 2, 1)
        return self._on_joint_paths(rows, place, axes)

    def _on_joint_paths(
        self, rows: NDArray[np.int64], place: Vector, axes: Vector
    ) -> tuple[Vector, Vector]:
        """The same with the tip where the joints' references have it, on a path of joints."""
        history = self.run.history
        names = [f"joint.{i}.position" for i in range(1, self.layout.joints + 1)]
        if not all(f"{name}.ref" in history.columns for name in names):
            return place, axes
        wanted = {name: history.columns[f"{name}.ref"][rows] for name in names}
        on_path = np.isfinite(np.column_stack([*wanted.values()])).all(axis=1)
        if on_path.any():
            at = rows[on_path]
            columns = {name: values[on_path] for name, values in wanted.items()}
            columns |= {name: history.columns[name][at] for name in ("clock", "t")}
            part = replace(history, columns=columns, stages=history.stages[at], rest=None)
            place[on_path], axes[on_path] = self._replayed(part).tip_pose()
        return place, axes


#: Of six components, translations and rotations.
_HALVES = (slice(0, 3), slice(3, 6))


def _pose(place: Vector, axes: Vector) -> Vector:
    """(n, 9) a pose as `features.POSE` has it."""
    return np.hstack([place, axes[:, :, 0], axes[:, :, 1]])


def _flat(axes: Vector) -> Vector:
    """(n, 9) of matrices (n, 3, 3), by columns."""
    return axes.transpose(0, 2, 1).reshape(-1, 9)


def _beyond(stage: CompiledStage) -> ca.Function:
    """The pose of the tip that lies an error beyond another.

    Axes of the frame (9,), place (3,) and axes (9,) of the tip, the lever to the control point
    (3,), all in the world, and the error (6,) in the frame's axes -> place (3,) and axes (9,).
    """
    symbols = [
        ca.SX.sym(name, size)
        for name, size in (("F", 9), ("p", 3), ("R", 9), ("lever", 3), ("error", 6))
    ]
    flat_frame, p, flat_tip, lever, error = symbols
    F, R = ca.reshape(flat_frame, 3, 3), ca.reshape(flat_tip, 3, 3)
    turned = F @ displaced(representation_of(stage.plan.law), F.T @ R, error[3:])
    # The control point is part of the tool.
    place = p + lever + F @ error[:3] - turned @ (R.T @ lever)
    return ca.Function("beyond", symbols, [ca.densify(place), ca.densify(ca.vec(turned))])


def layout_of(run: Run, fps: int, camera: tuple[int, int] | None = None) -> FrameLayout:
    """The frames that a run can have.

    Args:
        run: with a task and a tick.
        fps: frames a second.
        camera: height and width of a picture [px]; None without.

    Raises:
        InputError: it has no tick, or no task that can be compiled; or its log has fewer rows a
            second than there are to be frames.
    """
    if not len(run):
        raise InputError(f"{run.folder} holds no tick, so there is nothing to export")
    try:
        context = run.program.context
    except RebuildError as error:
        raise InputError(f"{run.folder} cannot be an episode: its task: {error}") from error
    rate = 1.0 / context.period
    if fps > rate + 1e-6:
        raise InputError(
            f"--fps {fps} is more than the log of {run.folder} has rows: {rate:g} a second; give "
            f"--fps {int(rate)} or less"
        )
    task = context.loaded.task
    live = tuple(map(param_column, task.live))
    return FrameLayout(Path(task.robot.model).stem, context.robot.n, rate, fps, live, camera)
