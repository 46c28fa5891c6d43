"""What can go wrong around a run, apart from the task itself."""

from __future__ import annotations

from pathlib import Path


class InputError(Exception):
    """Something that the command line names cannot be used; the message says what and why."""


class OutputError(Exception):
    """The run's folder cannot be written.

    Attributes:
        path: what could not be written.
        reason: why.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"cannot write {path}: {reason}")
        self.path, self.reason = path, reason

    @classmethod
    def of(cls, path: Path, error: OSError) -> OutputError:
        """The same as an error of the operating system."""
        return cls(path, error.strerror or str(error))


class RunCrashedError(Exception):
    """Something that must not happen has happened during a run.

    Attributes:
        folder: of the run; what was logged up to there is in it.
        trace: the file that tells more.
    """

    def __init__(self, folder: Path, trace: Path, message: str) -> None:
        super().__init__(message)
        self.folder, self.trace = folder, trace


class LinkError(Exception):
    """A robot, or who drives it, is no longer there.

    Attributes:
        name: a short name, such as `connection_lost`.
        text: the same as a sentence.
        ticks: of the run that were complete by then.
    """

    def __init__(self, name: str, text: str) -> None:
        super().__init__(text)
        self.name, self.text, self.ticks = name, text, 0
