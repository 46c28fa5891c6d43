"""Poses of tool and task frame at the ticks of a log that comes in chunks."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.bound import RowFunction
from taskspec.program.program import Program
from taskspec.program.world import estimated_frames
from taskspec_runner.record.history import TO_REST, History
from taskspec_runner.verdict.replay import Replay, TrackingMemory

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Poses:
    """Poses in the world, one a tick.

    Attributes:
        places: (n, 3) [m].
        turns: (n, 4) unit quaternions, x, y, z, w.
    """

    places: Vector
    turns: Vector

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n,) Whether there is a pose; an estimated frame has none before its stage ended."""
        return np.asarray(np.isfinite(self.places).all(axis=1))

    def rows(self, part: slice) -> Vector:
        """(k, 7) some of them, places before turns."""
        return np.hstack([self.places[part], self.turns[part]])


class _Earlier(NamedTuple):
    """What replayed ticks owe to earlier ones.

    Attributes:
        placing: functions that have been made.
        memory: of a tracking frame.
        levers: of visits, by their first ticks.
    """

    placing: dict[str, RowFunction]
    memory: TrackingMemory | None = None
    levers: Mapping[int, Vector] = MappingProxyType({})


class _Replay(Replay):
    def begin(self, period: float, earlier: _Earlier) -> None:
        """Takes what follows from ticks that are not in the history."""
        self._period, self._placing = period, earlier.placing
        self._resumed, self._levers = earlier.memory, dict(earlier.levers)

    def earlier(self, rows: NDArray[np.int64]) -> _Earlier:
        """What is to be handed to a replay that begins with some ticks of this one."""
        memory = self._memory
        if memory is not None and memory.tick + 1 == len(self._history):
            memory = memory._replace(tick=len(rows) - 1)
        else:
            memory = None
        last = self._visits[-1].first
        levers = (
            {int(np.searchsorted(rows, last)): self._levers[last]} if last in self._levers else {}
        )
        return _Earlier(self._placing, memory, levers)

    def tool(self) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) the tip."""
        return self.tip_pose()

    def task_frame(self) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) the frame of each row's stage; of a following one at the foot.

        As the arm is brought to rest there is none.
        """
        p, R = (np.full_like(part, np.nan) for part in self.tip_pose())
        for visit in self._visits:
            if visit.stage == TO_REST:
                continue
            origin, axes = self.pose(self._stages[visit.stage].plan.frame)
            p[visit.rows], R[visit.rows] = origin[visit.rows], axes[visit.rows]
        return p, R

    def control_point(self) -> Vector:
        """(n, 3) what a row's forces and moments are about."""
        p = np.full((len(self._history), 3), np.nan)
        for visit in self._visits:
            if visit.stage != TO_REST:
                p[visit.rows] = self._point(visit.rows)
        return p


class PoseStream:
    """Works out the poses of one chunk after the other.

    What a frame owes to ticks of earlier chunks is kept as rows that are replayed along: the first
    of a visit, and the end of a visit that measures a frame.
    """

    def __init__(self, program: Program) -> None:
        context = program.context
        self._program, self._bases = program, context.moving_bases
        self._measuring = {f.estimate for f in context.frames.values() if f.estimate}
        self._window = estimated_frames.window(context.period)
        joints = [f"joint.{i + 1}.position" for i in range(context.robot.n)]
        self._names = ("clock", "t", *joints)
        self._tracks = any(frame.tracking is not None for frame in context.frames.values())
        self._kept: History | None = None
        self._earlier = _Earlier({})

    def add(self, chunk: History) -> tuple[Poses, Poses, Poses]:
        """Poses at the ticks of the next chunk: the tool's tip, the task frame, the wrench's.

        The last one has the axes of the task frame and its origin at the control point.
        """
        rows, kept = self._joined(chunk), 0 if self._kept is None else len(self._kept)
        context = self._program.context
        replay = _Replay(context.robot, context.frames, self._program.stages, rows, self._bases)
        replay.begin(context.period, self._earlier)
        found = (replay.tool(), replay.task_frame())
        tool, frame = (_poses(p[kept:], R[kept:]) for p, R in found)
        point = replay.control_point()[kept:]
        self._keep(rows, replay)
        return tool, frame, Poses(np.where(frame.known[:, None], point, np.nan), frame.turns)

    def _joined(self, chunk: History) -> History:
        names = [n for n in chunk.columns if n in self._names or self._measures(n)]
        columns = {name: chunk.columns[name] for name in names}
        if self._kept is None:
            return History(columns, chunk.stages)
        old = self._kept
        joined = {n: np.concatenate([old.columns[n], values]) for n, values in columns.items()}
        return History(joined, np.concatenate([old.stages, chunk.stages]))

    def _measures(self, name: str) -> bool:
        """Whether a column is needed to measure or to track a frame."""
        force = name.startswith("force.") and name.endswith(".measured")
        velocity = name.startswith("velocity.")
        return (force and (bool(self._measuring) or self._tracks)) or (velocity and self._tracks)

    def _keep(self, rows: History, replay: _Replay) -> None:
        visits = list(rows.visits())
        wanted = {visits[-1].first}
        for stage in self._measuring:
            ended = [v for v in visits[:-1] if v.stage == stage][-1:]
            running = [v for v in visits[-1:] if v.stage == stage]
            for visit in (*ended, *running):
                wanted.add(visit.first)
                tail = max(visit.first, visit.last + 1 - self._window)
                wanted.update(range(tail, visit.last + 1))
            wanted.update(v.last + 1 for v in ended)
        chosen = np.array(sorted(wanted))
        columns = {name: values[chosen] for name, values in rows.columns.items()}
        self._kept = History(columns, rows.stages[chosen])
        self._earlier = replay.earlier(chosen)


def _poses(p: Vector, R: Vector) -> Poses:
    turns = np.full((len(p), 4), np.nan)
    known = np.isfinite(R).all(axis=(1, 2))
    if known.any():
        axes = R[known]
        # Most frames do not turn.
        axes = axes[:1] if (axes == axes[0]).all() else axes
        turns[known] = _quaternions(axes)
    return Poses(p, turns)


def _quaternions(R: Vector) -> Vector:
    """(n, 4) unit quaternions x, y, z, w of rotation matrices (n, 3, 3), with w >= 0.

    By the row of 4 q q^T that is longest, in which no digits are lost.
    """
    trace = np.trace(R, axis1=1, axis2=2)
    squares = np.empty((len(R), 4, 4))
    squares[:, :3, :3] = R + np.swapaxes(R, 1, 2)
    squares[:, range(3), range(3)] += (1 - trace)[:, None]
    spin = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1)
    squares[:, :3, 3] = squares[:, 3, :3] = spin
    squares[:, 3, 3] = 1 + trace
    longest = squares[:, range(4), range(4)].argmax(axis=1)
    q = squares[np.arange(len(R)), longest]
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    return np.asarray(np.where(q[:, 3:] < 0, -q, q))
