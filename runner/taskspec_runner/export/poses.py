"""Poses of tool and task frame at the ticks of a log that comes in chunks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.program.world import estimated_frames
from taskspec_runner.record.history import TO_REST, History
from taskspec_runner.verdict.replay import Replay

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


class _Replay(Replay):
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
        self._kept: History | None = None

    def add(self, chunk: History) -> tuple[Poses, Poses]:
        """Poses of the tool's tip and of the task frame at the ticks of the next chunk."""
        rows, kept = self._joined(chunk), 0 if self._kept is None else len(self._kept)
        context = self._program.context
        replay = _Replay(context.robot, context.frames, self._program.stages, rows, self._bases)
        found = [_poses(p[kept:], R[kept:]) for p, R in (replay.tool(), replay.task_frame())]
        self._keep(rows)
        return found[0], found[1]

    def _joined(self, chunk: History) -> History:
        names = [n for n in chunk.columns if n in self._names or self._is_measured_force(n)]
        columns = {name: chunk.columns[name] for name in names}
        if self._kept is None:
            return History(columns, chunk.stages)
        old = self._kept
        joined = {n: np.concatenate([old.columns[n], values]) for n, values in columns.items()}
        return History(joined, np.concatenate([old.stages, chunk.stages]))

    def _is_measured_force(self, name: str) -> bool:
        """Whether a column is needed to measure a frame."""
        force = name.startswith("force.") and name.endswith(".measured")
        return bool(self._measuring) and force

    def _keep(self, rows: History) -> None:
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


def _poses(p: Vector, R: Vector) -> Poses:
    turns = np.full((len(p), 4), np.nan)
    known = np.isfinite(R).all(axis=(1, 2))
    if known.any():
        turns[known] = Rotation.from_matrix(R[known]).as_quat(canonical=True)
    return Poses(p, turns)
