"""Logs of shipped tasks that end within a stage: the exit code of judge, and the task file's.

    python campaigns/cut_logs.py tasks/corner.yaml ...

What is expected follows from the text of the stage alone: the log of a run that went on does not
show that the stage was over, by a time or a guard that was recorded; what no log shows is open.
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
from typer.testing import CliRunner

from taskspec.spec import LoadedTask, load_task
from taskspec_runner.cli import app
from taskspec_runner.exit_codes import FAILED, UNDECIDED
from taskspec_runner.export import export_run
from taskspec_runner.record.history import Visit
from taskspec_runner.session import execute

TASKS = Path(__file__).resolve().parents[1] / "tasks"
#: Words of guards whose values no log has.
_INNER = ("travel", "path_done", "error", "limited", "force_inconsistent", "joint_error")


@dataclass(frozen=True)
class Cut:
    """A log that ends within a stage.

    Attributes:
        task: file.
        stage: in which it ends.
        ticks: that are left.
        expected: exit codes that the task file allows.
        code: that was given.
        output: of the command.
    """

    task: str
    stage: str
    ticks: int
    expected: tuple[int, ...]
    code: int
    output: str

    @property
    def survived(self) -> bool:
        """Whether the exit code is right."""
        return self.code in self.expected

    def __str__(self) -> str:
        text = f"{self.task}: {self.ticks} ticks, until {self.stage}: {self.code}"
        return f"{text}, not {' or '.join(map(str, self.expected))}"


def expected(loaded: LoadedTask, stage: str, ticks: int, period: float) -> tuple[int, ...]:
    """Exit codes of a log that ends some ticks after a visit of a stage began, before its end."""
    stages = loaded.task.stages
    names, spec = [*stages], stages[stage]
    following = names[names.index(stage) + 1] if stage != names[-1] else "end"
    if "end" not in (*spec.targets(following), spec.on_fail):
        return (FAILED,)
    if spec.until is not None:
        inner = any(word in str(spec.until) for word in _INNER)
        return (UNDECIDED, FAILED) if inner else (FAILED,)
    if spec.time is not None and ticks * period < spec.time - period / 2:
        return (FAILED,)
    return (UNDECIDED,)


def cuts(task: Path, work: Path, seed: int = 0) -> Iterator[Cut]:
    """A log of a task, cut within each of its visits of stages; and whole, as its run was."""
    dice, loaded = random.Random(f"{seed} {task.name}"), load_task(task)
    run = execute(loaded, work / "run", report=False)
    log = export_run(run, "parquet", work / "whole.parquet").path
    table, period = pq.read_table(log), run.period
    visits: list[Visit] = list(run.history.visits())
    whole = _judged(task, log, work)
    yield Cut(task.name, "end", len(table), (run.exit_code,), *whole)
    for visit in visits:
        if visit.last == visit.first:
            continue
        last = dice.randrange(visit.first, visit.last)
        cut = work / "cut.parquet"
        pq.write_table(table.slice(0, last + 1), cut)
        codes = expected(loaded, visit.stage, last + 1 - visit.first, period)
        yield Cut(task.name, visit.stage, last + 1, codes, *_judged(task, cut, work))


def _judged(task: Path, log: Path, work: Path) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["judge", str(task), str(log), "--out", str(work / "judged")])
    return done.exit_code, done.output


def main() -> int:
    """Cuts logs of tasks, all shipped ones without arguments; 1 if a code is not right."""
    wrong = 0
    for path in map(Path, sys.argv[1:] or sorted(TASKS.glob("*.yaml"))):
        with tempfile.TemporaryDirectory(prefix="taskspec-cut-") as work:
            for cut in cuts(path, Path(work)):
                wrong += not cut.survived
                mark = "ok" if cut.survived else f"WRONG {cut.output[-300:]}"
                sys.stdout.write(f"{cut.task} {cut.stage} {cut.ticks} {cut.code} {mark}\n")
                sys.stdout.flush()
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
