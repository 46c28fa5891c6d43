"""A plugin of pytest: task files of given folders are test files, their expectations are tests.

    [tool.pytest.ini_options]
    taskspec_paths = ["tasks"]

or `pytest --taskspec tasks`. A file is run once, when the first of its tests is; libraries are
loaded only where there is such a file.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from taskspec_runner.record.names import has_results

if TYPE_CHECKING:
    from taskspec_runner.cli.testing.outcome import CaseOutcome, FileOutcome

_SUFFIXES = (".yaml", ".yml")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds `--taskspec` and the setting `taskspec_paths`."""
    group = parser.getgroup("taskspec", "task files of robots in contact")
    group.addoption(
        "--taskspec",
        metavar="PATH",
        action="append",
        default=[],
        help="Run the task files of this folder, or this one, as tests; may be repeated.",
    )
    parser.addini("taskspec_paths", "Folders of task files that are run as tests", "paths", [])


def pytest_configure(config: pytest.Config) -> None:
    """Has pytest look into the folders that `--taskspec` names."""
    config.addinivalue_line("markers", "xdist_group(name): goes to one process of pytest-xdist")
    asked = [Path(config.invocation_params.dir, path) for path in config.getoption("taskspec")]
    for path in asked:
        if not path.exists():
            raise pytest.UsageError(f"--taskspec: there is no {path}")
    given = [Path(config.invocation_params.dir, text.split("::")[0]) for text in config.args]
    config.args.extend(str(path) for path in asked if not _below(path, given))


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> TaskFile | None:
    """A task file of one of the folders."""
    config = parent.config
    asked = [Path(config.invocation_params.dir, path) for path in config.getoption("taskspec")]
    folders = [*asked, *config.getini("taskspec_paths")]
    if file_path.suffix not in _SUFFIXES or not _below(file_path, folders):
        return None
    if has_results(file_path.parent):
        return None
    made: TaskFile = TaskFile.from_parent(parent, path=file_path)
    return made


def _below(path: Path, folders: list[Path]) -> bool:
    path = path.resolve()
    return any(path.is_relative_to(folder.resolve()) for folder in folders)


class MissedError(Exception):
    """A case that did not pass; the message says why."""


class TaskFile(pytest.File):
    """A task file."""

    def collect(self) -> Iterator[TaskCase]:
        """The run itself, and each expectation."""
        from taskspec.spec import load_task
        from taskspec.text.diagnostic import SpecError
        from taskspec_runner.cli.testing.outcome import ENDS_WELL

        names = [ENDS_WELL]
        try:
            expected = load_task(self.path).task.expect
        except (SpecError, OSError, UnicodeDecodeError):
            # The first case says what is wrong.
            expected = ()
        names += [each.name or each.text for each in expected]
        for number, name in enumerate(names):
            case: TaskCase = TaskCase.from_parent(self, name=name, number=number)
            # All cases of a file are of one run.
            case.add_marker(pytest.mark.xdist_group(str(self.path)))
            yield case

    @cached_property
    def outcome(self) -> FileOutcome:
        """What came of the file, which is run when this is first asked for."""
        from taskspec_runner.cli.testing.execution import Manner, try_file

        factory = self.config._tmp_path_factory  # type: ignore[attr-defined]
        folder = factory.mktemp(self.path.stem, numbered=True) / "run"
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        return try_file(self.path, Manner({self.path: folder}))


class TaskCase(pytest.Item):
    """The run itself, or an expectation of it."""

    parent: TaskFile

    def __init__(self, *, number: int, **options: Any) -> None:
        super().__init__(**options)
        self._number = number

    @property
    def _case(self) -> CaseOutcome:
        return self.parent.outcome.cases[self._number]

    def runtest(self) -> None:
        """Runs the file, if that has not been done.

        Raises:
            MissedError: the case did not pass.
        """
        case = self._case
        if case.passed is None:
            pytest.skip(case.message)
        if not case.passed:
            raise MissedError(self.parent.outcome.problem or case.message)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """What was expected and what was found, without a traceback."""
        if not isinstance(excinfo.value, MissedError):
            return super().repr_failure(excinfo, style)
        outcome, case = self.parent.outcome, self._case
        if outcome.problem:
            return outcome.problem
        place = f"{self.path}:{case.line}" if case.line is not None else str(self.path)
        lines = [f"{place}: {case.title}", case.message]
        return "\n".join([*lines, *([f"report: {outcome.report}"] if outcome.report else [])])

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Where it stands; a line is known once the file was run."""
        # Of a heading that ends its node's name, pytest would take the dots for those of modules.
        return self.path, None, f"{self.path.name}: {self.name}"
