"""A task file that is open in an editor, and what is known of it while it is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from taskspec.examination import ExaminationBounds, examine
from taskspec.program.program import refusals
from taskspec.spec import LoadedTask, load_text
from taskspec.spec.load import tree_of
from taskspec.text.diagnostic import Diagnostic, Diagnostics, SpecError
from taskspec.text.nodes import Mapping
from taskspec.text.source import Source
from taskspec.text.yaml import read
from taskspec.unread import with_robot
from taskspec_runner.editor.names import TaskNames


class OpenedFile:
    """A text and the newest names that could be read of it.

    Attributes:
        path: of the file; it need not exist.
        source: the text as it is now.
        names: of the last text that could be read; None before one could.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.names: TaskNames | None = None
        self.source = Source(str(path), "")
        self.change(text)

    def change(self, text: str) -> None:
        """Takes a new text."""
        self.source = Source(str(self.path), text.replace("\r\n", "\n"))
        own = read(self.source, Diagnostics(str(self.path)))
        root = tree_of(self.source.text, str(self.path), self.path.parent)
        if root is not None and isinstance(own, Mapping) and own.entries:
            self.names = TaskNames(root, own)

    @property
    def is_task(self) -> bool:
        """Whether it says that it is a task; another YAML file gets no findings."""
        return any(line.startswith("taskspec:") for line in self.source.text.split("\n"))

    def read(self) -> tuple[Diagnostic, ...]:
        """Findings of text, names, units and modes."""
        return self._of_loaded(lambda loaded: loaded.warnings, robot=False)

    def examined(self, *, stability: bool = True) -> tuple[Diagnostic, ...]:
        """Findings of all rules; of a file that cannot be read those of `read`."""
        return self._of_loaded(
            lambda loaded: examine(loaded, stability=stability, bounds=ExaminationBounds()).findings
        )

    def tried(self) -> tuple[Diagnostic, ...]:
        """Findings of all rules and of a trial."""
        from taskspec_runner.trial.check import check

        return self._of_loaded(lambda loaded: check(loaded).findings)

    def picture(self) -> bytes | None:
        """The start pose as SVG; None of a text in which an error is found."""
        from taskspec_runner.preview import TaskPicture

        try:
            loaded = load_text(self.source.text, str(self.path), base=self.path.parent)
        except SpecError:
            return None
        examined = examine(loaded, stability=False, bounds=ExaminationBounds())
        if examined.plan is None or refusals(examined.findings):
            return None
        return TaskPicture(examined.plan).svg(rows=False, fineness=1.0)

    def _of_loaded(
        self, find: Callable[[LoadedTask], tuple[Diagnostic, ...]], *, robot: bool = True
    ) -> tuple[Diagnostic, ...]:
        """Findings of the text as it is now; of one that cannot be read what is wrong with it.

        Args:
            find: what is found in one that can be read.
            robot: whether the robot is looked at in one that cannot.
        """
        try:
            return find(load_text(self.source.text, str(self.path), base=self.path.parent))
        except SpecError as error:
            return with_robot(error).diagnostics if robot else error.diagnostics
