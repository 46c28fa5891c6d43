"""What a sweep comes to."""

from __future__ import annotations

from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec.spec import Task
from taskspec_runner.record.folder import Json
from taskspec_runner.sweep.world_run import Row


@dataclass(frozen=True, slots=True)
class SweepResult:
    """A sweep that is over, or one share of it.

    Attributes:
        task: of it.
        path: of its folder.
        rows: in the order of the worlds.
        summary: what `sweep.json` says; of a share, without a verdict.
        continued: worlds that were there before.
        shard: which share it is, and of how many; (1, 1) for all of it.
    """

    task: Task
    path: Path
    rows: tuple[Row, ...]
    summary: Json
    continued: int = 0
    shard: tuple[int, int] = (1, 1)
