"""The folder of a sweep: rows as they come, and in the end the table, the summary and the page."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record import folder as folders
from taskspec_runner.record.folder import RUNS, Json, RunFolder, plain
from taskspec_runner.record.lock import FolderLock
from taskspec_runner.record.names import TASK
from taskspec_runner.record.whole import open_regular
from taskspec_runner.sweep.world_run import Row

SWEEP, TABLE, PAGE, JOURNAL = "sweep.json", "worlds.parquet", "sweep.html", "worlds.jsonl"
#: Of runs that are kept, below the sweep's folder.
KEPT = "worlds"
FORMAT = 1
#: Of a row's checksum, which stands before it.
_DIGITS = 16


class SweepFolder:
    """A folder that one process writes a sweep into, and that another continues.

    Attributes:
        path: the folder.
        said: what `sweep.json` says of the sweep.
        rows: that it has, by the number of their world.
    """

    def __init__(self, folder: RunFolder, said: Mapping[str, Any]) -> None:
        """A locked folder; `said` is what `sweep.json` is to say of the sweep."""
        self._folder, self.said = folder, dict(said)
        self.path = folder.path
        self.rows: dict[int, Row] = {}
        self._journal: BinaryIO | None = None

    def __enter__(self) -> SweepFolder:
        return self

    def __exit__(self, *_: object) -> None:
        if self._journal is not None:
            self._journal.close()
        self._folder.close()

    def begin(self, content: bytes) -> None:
        """Takes what is there already, and writes what the sweep is of.

        Raises:
            OutputError: it cannot be written.
        """
        path = self.path / JOURNAL
        try:
            self.rows, good = _read(path)
            self._folder.write(TASK, content)
            self._folder.write_sealed(SWEEP, self.said)
            self._journal = path.open("ab", buffering=0)
            # What a killed process has left half written.
            os.ftruncate(self._journal.fileno(), good)
        except OSError as error:
            raise OutputError.of(path, error) from error

    def add(self, row: Row) -> None:
        """Keeps the row of a world; from here on it is not run again.

        Raises:
            OutputError: it cannot be written.
        """
        assert self._journal is not None
        text = json.dumps(plain(row), ensure_ascii=False).encode()
        try:
            self._journal.write(_sum(text) + b" " + text + b"\n")
        except OSError as error:
            raise OutputError.of(self.path / JOURNAL, error) from error
        self.rows[int(row["world"])] = row

    def write(self, name: str, content: bytes | str) -> Path:
        """Writes a file whole or not at all."""
        return self._folder.write(name, content)

    def end(self, **entries: Any) -> None:
        """Says in `sweep.json` what came of it; the journal is not needed any more.

        Raises:
            OutputError: it cannot be written.
        """
        self.said |= entries
        self._folder.write_sealed(SWEEP, self.said)


def open_sweep(out: Path | None, name: str, said: Mapping[str, Any]) -> SweepFolder:
    """Makes or continues the folder of a sweep.

    Args:
        out: where; None for `runs/NAME-sweep`, or with -2, -3, ... where another sweep is there.
        name: of the task.
        said: what tells the sweep from others, `identity` among it.

    Raises:
        OutputError: it holds something else or another sweep, or another process writes into it.
    """
    usual = RUNS / f"{name}-sweep"
    path = _usual(usual, said) if out is None else out
    _check(path, said)
    try:
        path.mkdir(parents=True, exist_ok=True)
        locked = RunFolder(path, lock=FolderLock(path))
    except OSError as error:
        raise OutputError.of(path, error) from error
    try:
        _check(path, said)
    except BaseException:
        locked.close()
        raise
    return SweepFolder(locked, said)


def _usual(usual: Path, said: Mapping[str, Any]) -> Path:
    """The first place that is free, or holds the same sweep."""
    number = 1
    while True:
        path = usual if number == 1 else usual.with_name(f"{usual.name}-{number}")
        found = read_sweep(path)
        same = all(found.get(key) == said[key] for key in ("identity", "shard"))
        if not path.exists() or same:
            return path
        number += 1


def _check(path: Path, said: Mapping[str, Any]) -> None:
    found = read_sweep(path)
    own = isinstance(found.get("format"), int) and isinstance(found.get("identity"), str)
    folders.check_own(path, "sweep", own, (SWEEP, TABLE, PAGE, JOURNAL, TASK))
    if own and found["identity"] == said["identity"] and found.get("shard") != said["shard"]:
        raise OutputError(path, "it holds another share of this sweep; name another folder")
    if own and found["identity"] != said["identity"]:
        what = "another task, other values of it, another version" if (
            found.get("bundle") != said["bundle"]
        ) else "other worlds"  # fmt: skip
        raise OutputError(
            path, f"it holds the sweep of {what}, which is not thrown away; name another folder"
        )


def read_part(path: Path) -> tuple[Json, dict[int, Row]]:
    """What a share of a sweep says of itself, and its rows.

    Raises:
        InputError: it is no folder of a sweep.
    """
    said = read_sweep(path)
    if not isinstance(said.get("identity"), str):
        raise InputError(f"{path} is no folder of a sweep")
    return said, _read(path / JOURNAL)[0]


def read_sweep(path: Path) -> Json:
    """What a sweep's folder says of itself; empty where it holds none."""
    return folders.read_json(path / SWEEP)


def _sum(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest()[:_DIGITS].encode()


def _read(path: Path) -> tuple[dict[int, Row], int]:
    """The rows of a journal by their world, and how many of its bytes are whole rows."""
    rows: dict[int, Row] = {}
    good = 0
    try:
        with open_regular(path) as file:
            for line in file:
                digits, _, text = line.rstrip(b"\n").partition(b" ")
                if not line.endswith(b"\n") or _sum(text) != digits:
                    break
                row = json.loads(text)
                rows[int(row["world"])] = row
                good += len(line)
    except FileNotFoundError:
        pass
    return rows, good
