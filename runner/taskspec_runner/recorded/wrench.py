"""Forces and moments that were recorded in axes of the robot, in those of each stage's frame.

    f_stage = M f,   m_stage = M (m - r x f),   M = R_stage^T R_of R

R_stage and R_of are the axes of the stage's frame and of the robot's part in the world, R those of
the recording in that part; r is from the point that recorded moments are about to the tool's tip.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.geometry import rotation
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world.frames import FrameModel
from taskspec.robot.tool import make_tool
from taskspec_runner.errors import InputError
from taskspec_runner.record.file_array import blocks, full
from taskspec_runner.record.history import History, NotRecordedError, RecordedColumns
from taskspec_runner.recorded.assignment import Assigned
from taskspec_runner.recorded.column_map import WrenchAxes
from taskspec_runner.verdict.replay import Replay, constant_axes

Vector = NDArray[np.float64]

_PARTS = (("force", ("x", "y", "z")), ("torque", ("rx", "ry", "rz")))
#: Entries of a rotation below this are rounding.
_ROUNDING = 1e-12
#: What helps where the rotation of recorded axes is not known at each tick.
_REMEDY = (
    "or, where the tool keeps its orientation, state how the recorded axes are turned against that "
    "frame: frame: {rpy: [180 deg, 0, 0]}, or frame: stage where they are the same"
)
#: Samples at which the tip is compared with the joints, and the least cosine between both.
_COMPARED, _SAME_DIRECTION = 20, 0.8


class _Group:
    """The forces, or the moments, of one sensor.

    Attributes:
        names: of the signals along or about x, y and z.
        present: which of them were recorded.
        frame: the axes in which they were.
        forces: the group of the forces of the same sensor, for moments.
    """

    def __init__(
        self, names: Sequence[str], recorded: Mapping[str, Assigned], forces: _Group | None
    ) -> None:
        self.names, self.forces = tuple(names), forces
        self.present = tuple(name in recorded for name in names)
        frames = {recorded[name].frame for name in names if name in recorded}
        if len(frames) > 1:
            raise InputError(f"{', '.join(names)} are one vector, so they have the same 'frame'")
        self.frame = next(iter(frames), None)

    @property
    def of(self) -> str:
        """Whose axes they are."""
        return self.frame.of if self.frame is not None else "stage"

    def vector(self, values: Mapping[str, Vector], rows: slice) -> Vector:
        """(k, 3) the vector as recorded; zero along what was not."""
        found = np.zeros((rows.stop - rows.start, 3))
        for i, name in enumerate(self.names):
            if self.present[i]:
                found[:, i] = values[name][rows]
        return found


class WrenchTurn:
    """Turns recorded forces and moments into the axes of the stages.

    Attributes:
        needed: whether anything was recorded in other axes.
        half_turn: whether the controller's base was found to be turned against the robot's.
    """

    def __init__(
        self,
        program: Program,
        signals: Sequence[Assigned],
        known: Sequence[str],
        columns: Callable[[Sequence[str]], list[Vector] | None],
    ) -> None:
        """Takes what was recorded.

        Args:
            program: of the task.
            signals: of the log.
            known: every signal that a log of the task may have.
            columns: gives columns of the log by their names, as they are.

        Raises:
            InputError: parts of a vector have different axes, or a part is missing.
        """
        self._program, self._known = program, frozenset(known)
        recorded = {each.name: each for each in signals}
        self._groups: list[_Group] = []
        for suffix in ("", ".measured"):
            forces = None
            for head, axes in _PARTS:
                names = [f"{head}.{axis}{suffix}" for axis in axes]
                group = _Group(names, recorded, forces)
                forces = forces or group
                if group.frame is not None and group.frame != WrenchAxes():
                    self._groups.append(group)
        self.needed = bool(self._groups)
        #: The columns in axes that do not move, by M.
        self._turned: dict[bytes, dict[str, Vector]] = {}
        tips = {group.frame.tip for group in self._groups if group.frame is not None}
        tip = next((columns(each) for each in tips if each is not None), None)
        self.half_turn = tip is not None and self._is_turned(recorded, tip)

    def in_stage(self, stage: CompiledStage, values: Mapping[str, Vector]) -> dict[str, Vector]:
        """Columns (ticks,) in the axes of a stage's frame, as far as these do not move.

        Args:
            stage: whose frame it is.
            values: (ticks,) of all signals, as recorded.

        Raises:
            InputError: they do move, so that it has to be known when the stage is on.
        """
        turns = []
        for group in self._groups:
            turn = self._constant(group, stage.plan.frame)
            if turn is None:
                raise InputError(
                    f"{self._moved(group, stage)}. State the stages by a column ('stage') or by "
                    f"times ('stages') in the map, and record the joint positions; {_REMEDY}"
                )
            turns.append(turn)
        key = b"".join(turn.tobytes() for turn in turns)
        if key not in self._turned:
            made, ticks = dict(values), len(next(iter(values.values())))
            for group, turn in zip(self._groups, turns, strict=True):
                self._write(group, turn, values, made, (0, ticks), stage)
            self._turned[key] = made
        return self._turned[key]

    def over(self, history: History) -> dict[str, Vector]:
        """Columns (ticks,) of a history, each tick in the axes of its own stage's frame.

        Raises:
            InputError: a frame moves, and the joint positions were not recorded.
        """
        context, stages = self._program.context, {s.name: s for s in self._program.stages}
        values, made = history.columns, dict(history.columns)
        # What is turned in one stage may be what the frame of another one is measured by.
        for name in self._known.intersection(n for group in self._groups for n in group.names):
            if name in values:
                made[name] = full(len(history), np.nan)
        turning = replace(history, columns=RecordedColumns(made))
        replay = Replay(
            context.robot, context.frames, self._program.stages, turning, context.moving_bases
        )
        for visit in history.visits():
            stage = stages[visit.stage]
            for group in self._groups:
                turn: Vector | Replay | None = self._constant(group, stage.plan.frame)
                turn = replay if turn is None else turn
                self._write(group, turn, values, made, (visit.first, visit.last + 1), stage)
        return made

    def _write(
        self,
        group: _Group,
        turn: Vector | Replay,
        values: Mapping[str, Vector],
        made: dict[str, Vector],
        ticks: tuple[int, int],
        stage: CompiledStage,
    ) -> None:
        """Writes a vector in the axes of a stage into columns (ticks,), some ticks at a time.

        Args:
            group: the vector.
            turn: (3, 3) M; or what gives it tick by tick.
            values: as recorded.
            made: columns to write; one that is not yet a copy is NaN elsewhere.
            ticks: the first of them, and the one after the last.
            stage: for messages.
        """
        first, after = ticks
        for part in blocks(after - first):
            rows = slice(first + part.start, first + part.stop)
            M = self._moving(group, stage, turn, rows) if isinstance(turn, Replay) else turn
            for name, found in self._in_axes(group, M, values, rows, stage).items():
                if name not in made or made[name] is values.get(name):
                    made[name] = full(len(next(iter(values.values()))), np.nan)
                made[name][rows] = found

    def _constant(self, group: _Group, frame: FrameModel) -> Vector | None:
        """(3, 3) M where it is the same at all times, else None."""
        context, own = self._program.context, group.frame
        assert own is not None
        R = rotation.from_rpy(own.rpy)
        if own.of == "stage":
            return R
        if own.of != "base":
            return frame.rotation.T @ R if frame.kind == "tool" else None
        axes = constant_axes(context.robot, frame, context.moving_bases.get(frame.base_name))
        return None if axes is None else axes.T @ self._base() @ R

    def _moved(self, group: _Group, stage: CompiledStage) -> str:
        return (
            f"forces were recorded in axes of the {group.of}, and the frame of stage "
            f"'{stage.name}' moves against these"
        )

    def _base(self) -> Vector:
        """(3, 3) axes of the base in which forces were recorded, in the world."""
        axes = rotation.from_rpy(self._program.context.loaded.task.robot.base.rpy)
        return axes @ np.diag([-1.0, -1.0, 1.0]) if self.half_turn else axes

    def _is_turned(self, recorded: Mapping[str, Assigned], tip: Sequence[Vector]) -> bool:
        """Whether the recorded tip lies opposite to where the joints have it.

        Args:
            recorded: signals of the log.
            tip: (n,) its x and y in axes of the controller's base [m].

        Raises:
            InputError: it lies neither there nor where they have it.
        """
        robot, base = self._program.context.robot, self._program.context.loaded.task.robot.base
        names = [f"joint.{i + 1}.position" for i in range(robot.n)]
        if any(n not in recorded or len(recorded[n].values) != len(tip[0]) for n in names):
            return False
        rows = np.unique(np.linspace(0, len(tip[0]) - 1, _COMPARED).astype(int))
        q = np.array([recorded[n].si(np.array(recorded[n].values[rows])) for n in names]).T
        twin, along = robot.twin(), 0.0
        for row, joints in zip(rows, q, strict=True):
            world = twin.tip(joints).translation - np.array(base.xyz)
            own = (rotation.from_rpy(base.rpy).T @ world)[:2]
            there = np.array([tip[0][row], tip[1][row]])
            along += float(own @ there) / max(
                float(np.linalg.norm(own) * np.linalg.norm(there)), 1e-9
            )
        along /= len(rows)
        # Tools of another length leave the direction nearly as it is.
        if np.isnan(along) or abs(along) < _SAME_DIRECTION:
            raise InputError(
                "the recorded position of the tip is not where the recorded joint positions have "
                "it, with the base as it is nor with half a turn; leave 'tip' out of 'frame' and "
                "state how the axes are turned by 'rpy'"
            )
        return along < 0

    def _moving(self, group: _Group, stage: CompiledStage, replay: Replay, rows: slice) -> Vector:
        """(k, 3, 3) M at some ticks, from the joint positions."""
        own, frame = group.frame, stage.plan.frame
        assert own is not None
        if frame.tracking is not None and frame.tracking.of == "force":
            raise InputError(
                f"the frame of stage '{stage.name}' follows the force, which has to be recorded in "
                f"its axes, not in those of the {own.of}"
            )
        try:
            tip, axes = replay.axes(frame, rows)
        except NotRecordedError as error:
            raise InputError(
                f"{self._moved(group, stage)}: that needs {error.column}, which was not recorded; "
                f"{_REMEDY}"
            ) from error
        of = self._base() if own.of == "base" else tip
        return np.asarray(axes.transpose(0, 2, 1) @ of @ rotation.from_rpy(own.rpy))

    def _in_axes(
        self,
        group: _Group,
        turn: Vector,
        values: Mapping[str, Vector],
        rows: slice,
        stage: CompiledStage,
    ) -> dict[str, Vector]:
        """(k,) the parts of a vector in the axes of a stage, as far as what they need is there.

        Args:
            group: the vector.
            turn: (3, 3) or (k, 3, 3) M.
            values: (ticks,) as recorded.
            rows: of them.
            stage: for messages.

        Raises:
            InputError: one that was recorded cannot be worked out.
        """
        turn = np.where(np.abs(turn) < _ROUNDING, 0.0, turn)
        lever = self._lever(group)
        vector = group.vector(values, rows)
        absent = ~np.array(group.present)
        if lever.any() and group.forces is not None:
            vector = vector - np.cross(lever, group.forces.vector(values, rows))
            missing_forces = ~np.array(group.forces.present)
            absent = absent | (np.abs(pin.skew(lever)) > _ROUNDING) @ missing_forces
        turned = np.einsum("ij,kj->ki" if turn.ndim == 2 else "kij,kj->ki", turn, vector)
        needs = np.any(turn.reshape(-1, 3, 3), axis=0)
        found = {}
        for i, name in enumerate(group.names):
            lacking = needs[i] & absent
            if name in self._known and not lacking.any():
                found[name] = turned[:, i]
            elif group.present[i] and name in self._known:
                parts = [part for part, lacks in zip(group.names, lacking, strict=True) if lacks]
                raise InputError(
                    f"forces were recorded in axes of the {group.of}: {name} in the frame of stage "
                    f"'{stage.name}' needs {' and '.join(parts)} too, which the map does not name"
                )
        return found

    def _lever(self, group: _Group) -> Vector:
        """(3,) from what recorded moments are about to the tool's tip, in the recorded axes [m]."""
        own = group.frame
        if own is None or group.forces is None or own.of not in ("flange", "sensor"):
            return np.zeros(3)
        context = self._program.context
        tool = make_tool(context.loaded.task.robot.tool, "z" not in context.robot.axes)
        tip = np.array([0.0, 0.0, tool.length])
        return np.asarray(rotation.from_rpy(own.rpy).T @ (tip - np.array(own.xyz)))
