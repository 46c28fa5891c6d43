"""Where episodes come from: folders of runs, and the worlds of sweeps, which are run again."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from taskspec.compiler import compile_task
from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec_runner.errors import InputError
from taskspec_runner.record.extent import ENDED
from taskspec_runner.record.folder import is_sweep, read_json
from taskspec_runner.record.manifest import inputs, versions
from taskspec_runner.record.names import MANIFEST, SWEEP
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program
from taskspec_runner.sweep.engine import fastest_loop
from taskspec_runner.sweep.kept import folder_of
from taskspec_runner.sweep.session import read_result
from taskspec_runner.sweep.world_run import BROKEN, Row
from taskspec_runner.sweep.worlds import Worlds


class RunSource(Protocol):
    """Some runs.

    Attributes:
        note: what is left out and why, or empty.
    """

    note: str

    def __len__(self) -> int: ...

    def runs(self) -> Iterator[tuple[str, Run]]:
        """Each of them with a name; it may be gone when the next one is taken."""
        ...


def source_of(path: Path) -> RunSource:
    """The runs of a folder: of a run, or of a sweep.

    Raises:
        InputError: it is neither, or what it holds cannot be used.
        SpecError: this version does not take the task of a sweep.
    """
    return SweptRuns.of(path) if is_sweep(path / SWEEP) else SavedRun(path, Run.load(path))


@dataclass(slots=True)
class SavedRun:
    """The run of a folder.

    Attributes:
        path: the folder.
        run: in it.
        note: empty.
    """

    path: Path
    run: Run
    note: str = ""

    def __len__(self) -> int:
        return 1

    def runs(self) -> Iterator[tuple[str, Run]]:
        """The run."""
        yield self.path.resolve().name, self.run


@dataclass(slots=True)
class SweptRuns:
    """The worlds of a sweep that is over.

    A sweep keeps what came of each world, and the logs of few. The others are run again from their
    seeds, which gives the same bytes, one at a time in a folder that is removed.

    Attributes:
        path: the folder of the sweep.
        program: of its task.
        worlds: of it.
        rows: of the worlds that did not break.
        note: which did.
    """

    path: Path
    program: Program
    worlds: Worlds
    rows: tuple[Row, ...]
    note: str

    @classmethod
    def of(cls, path: Path) -> SweptRuns:
        """The sweep of a folder.

        Raises:
            InputError: worlds are missing, or they would not be the same here.
            SpecError: this version does not take its task.
        """
        result, read = read_result(path)
        here, there = versions(), read.said["versions"]
        if others := [f"{name} {here.get(name)}, not {each}" for name, each in there.items()
                      if here.get(name) != each]:  # fmt: skip
            raise InputError(
                f"the worlds of {path} cannot be run again, as this is {'; '.join(others)}: sweep "
                "it again, or install what it was swept with"
            )
        program = compile_task(read.task, force=bool(read.said.get("force")))
        if inputs(program) != read.said["inputs"]:
            raise InputError(
                f"the worlds of {path} cannot be run again: a file that its task draws on has "
                "changed; sweep it again"
            )
        rows = tuple(row for row in result.rows if row["status"] != BROKEN)
        broken = [str(row["world"]) for row in result.rows if row["status"] == BROKEN]
        note = f"without the worlds of {path} that broke: {', '.join(broken)}" if broken else ""
        return cls(path, program, Worlds(**read.said["worlds"]), rows, note)

    def __len__(self) -> int:
        return len(self.rows)

    def runs(self) -> Iterator[tuple[str, Run]]:
        """Each world in order, of those that are kept the run that there is.

        Raises:
            InputError: a world did not come to what the sweep says of it.
        """
        name = self.path.resolve().name
        with tempfile.TemporaryDirectory(prefix="taskspec-") as scratch:
            for row in self.rows:
                index = int(row["world"])
                run = self._run(index, Path(scratch) / "run")
                if len(run) != row["ticks"]:
                    raise InputError(
                        f"world {index} of {self.path} came to {len(run)} ticks here, and to "
                        f"{row['ticks']} in the sweep; sweep it again"
                    )
                yield f"{name}/{index}", run

    def _run(self, index: int, scratch: Path) -> Run:
        there = folder_of(self.path, index)
        if read_json(there / MANIFEST).get("status") in ENDED:
            return Run(there, program=self.program)
        world = self.worlds.world(self.program.context, index)
        return execute_program(
            self.program, scratch, world=world, report=False, loop=fastest_loop()
        )
