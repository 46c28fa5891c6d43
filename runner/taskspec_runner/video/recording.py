"""A run as it is drawn: the task and the log of its folder, in world coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.spec import Task
from taskspec_runner.errors import InputError
from taskspec_runner.record.history import History, Visit
from taskspec_runner.runs import RebuildError, Run
from taskspec_runner.verdict.replay import Replay

Vector = NDArray[np.float64]

#: A longer run is drawn by every so many-th tick: of an hour at 1 kHz by every 30th.
MOST_TICKS = 120_000
#: A smaller force is no contact [N]; a share of the largest that is as good as it.
_CONTACT_FORCE, _SHARE_OF_LARGEST = 0.5, 0.9


@dataclass(frozen=True, slots=True)
class Recording:
    """Positions of a run tick by tick; of a long run, at some of its ticks.

    Attributes:
        program: the task of the folder, compiled.
        true: the task with the world as it was.
        history: its log.
        visits: in order.
        q: (n, joints) [rad or m].
        tip: (n, 3) the tool's tip in the world [m].
        point: (n, 3) the control point of the stage.
        axes: (n, 3, 3) the axes of the stage's frame; NaN where it is not known.
        force: (n, 3) what the robot applies, world axes [N].
        wanted: (n, 3) the reference of the control point [m].
    """

    program: Program
    true: Task
    history: History
    visits: tuple[Visit, ...]
    q: Vector
    tip: Vector
    point: Vector
    axes: Vector
    force: Vector
    wanted: Vector

    @classmethod
    def of(cls, run: Run) -> Recording:
        """A run as it is drawn; one that was cut short up to where its log ends.

        Raises:
            InputError: the run has no tick, or a task that cannot be read any more.
        """
        if not len(run):
            message = "its log holds no complete batch of ticks"
            raise InputError(f"cannot draw {run.folder}: {message}")
        try:
            return _recording(run.program, run.world.task, run.history.thinned(MOST_TICKS))
        except RebuildError as error:
            raise InputError(f"cannot draw {run.folder}: its task: {error}") from error
        except KeyError as error:
            message = f"its log has no column {error}; another version wrote it"
            raise InputError(f"cannot draw {run.folder}: {message}") from error

    def __len__(self) -> int:
        return len(self.history)

    @property
    def clock(self) -> Vector:
        """(n,) run time [s]."""
        return self.history.columns["clock"]

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.program.context.period

    @property
    def end(self) -> float:
        """Run time at the end of the last tick [s]."""
        return float(self.clock[-1]) + self.period

    def row(self, clock: float) -> int:
        """The tick that holds at a time [s]; before the first and after the last the nearest."""
        found = int(np.searchsorted(self.clock, clock + 1e-9, side="right")) - 1
        return min(max(found, 0), len(self) - 1)

    def visit(self, row: int) -> Visit:
        """The visit that a row belongs to."""
        return next(v for v in self.visits if v.first <= row <= v.last)

    def stage(self, visit: Visit) -> CompiledStage:
        """The stage of a visit."""
        return next(s for s in self.program.stages if s.name == visit.stage)


def _recording(program: Program, true: Task, history: History) -> Recording:
    context, columns = program.context, history.columns
    replay = Replay(context.robot, context.frames, program.stages, history, context.moving_bases)
    tip = replay.tip_pose()[0]
    point = tip + replay.offset()
    axes, error = np.empty((len(tip), 3, 3)), np.zeros_like(tip)
    visits = tuple(history.visits())
    stages = {stage.name: stage for stage in program.stages}
    for visit in visits:
        axes[visit.rows] = replay.pose(stages[visit.stage].plan.frame)[1][visit.rows]
        for i, axis in enumerate("xyz"):
            if f"error.{axis}" in columns:
                error[visit.rows, i] = np.nan_to_num(columns[f"error.{axis}"][visit.rows])
    force = [replay.signal("force", axis, "world") for axis in "xyz"]
    return Recording(
        program=program,
        true=true,
        history=history,
        visits=visits,
        q=np.column_stack([columns[f"joint.{i + 1}.position"] for i in range(context.robot.n)]),
        tip=tip,
        point=point,
        axes=axes,
        force=np.nan_to_num(np.column_stack(force)),
        wanted=point + np.nan_to_num(np.einsum("kij,kj->ki", axes, error)),
    )


def steadiest_contact(recording: Recording, span: float = 0.2) -> int:
    """A row of a large force that stays: by its mean over a while less twice its spread.

    Args:
        recording: of the run.
        span: the while [s].

    Returns:
        The middle one of the rows where that is nearly as large as anywhere; of a run without
        contact, the row where the tool has gone half of its path.
    """
    size = np.linalg.norm(recording.force, axis=1)
    between = float(np.median(np.diff(recording.clock))) if len(size) > 1 else recording.period
    width = max(1, min(len(size), round(span / between)))

    def mean(values: Vector) -> Vector:
        sums = np.cumsum(np.concatenate([[0.0], values]))
        return np.asarray((sums[width:] - sums[:-width]) / width)

    average = mean(size)
    lasting = average - 2 * np.sqrt(np.maximum(mean(size**2) - average**2, 0.0))
    if lasting.max() < _CONTACT_FORCE:
        steps = np.diff(recording.tip, axis=0, prepend=recording.tip[:1])
        distance = np.cumsum(np.linalg.norm(steps, axis=1))
        return min(int(np.searchsorted(distance, distance[-1] / 2)), len(size) - 1)
    good = np.flatnonzero(lasting >= _SHARE_OF_LARGEST * lasting.max())
    return int(good[len(good) // 2]) + width // 2
