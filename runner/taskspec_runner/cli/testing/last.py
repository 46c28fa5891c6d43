"""Outcomes of the last test of task files, kept beside their runs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from taskspec_runner.cli.testing.outcome import FileOutcome
from taskspec_runner.errors import OutputError
from taskspec_runner.record.folder import mapping, number, read_json
from taskspec_runner.record.whole import write_whole

NAME = "last.json"


class LastOutcomes:
    """Exit codes by the paths of files; none where nothing that can be read is kept."""

    def __init__(self, folder: Path) -> None:
        """What a folder has.

        Raises:
            OutputError: it has a file of this name that is something else.
        """
        self._path = folder / NAME
        said = read_json(self._path).get("exit_codes")
        if self._path.exists() and not isinstance(said, Mapping):
            raise OutputError(self._path, "taskspec test did not write it; choose another --out")
        known = mapping(said)
        self._codes = {path: int(number(code) or 0) for path, code in known.items()}

    def failed(self, files: Iterable[Path]) -> list[Path]:
        """The files among some that did not pass."""
        return [path for path in files if self._codes.get(_key(path), 0)]

    def failed_first(self, files: Sequence[Path]) -> list[Path]:
        """All files, those that did not pass before the others."""
        failed = dict.fromkeys(self.failed(files))
        return [*failed, *(path for path in files if path not in failed)]

    def keep(self, outcomes: Iterable[FileOutcome]) -> None:
        """Notes what came of some files; others stay as they were.

        Raises:
            OutputError: it cannot be written.
        """
        self._codes |= {_key(Path(each.path)): each.code for each in outcomes}
        text = json.dumps({"exit_codes": self._codes}, indent=2, ensure_ascii=False)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError.of(self._path.parent, error) from error
        write_whole(self._path, text + "\n")


def _key(path: Path) -> str:
    return str(path.absolute())
