"""The folder of a sweep: rows as they come, and in the end the table, the summary and the page."""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from taskspec.deferred_methods import dataclass
from taskspec.regular_file import open_regular
from taskspec.spec import LoadedTask, load_text
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record import folder as folders
from taskspec_runner.record.folder import LARGEST, RUNS, Json, RunFolder, mapping, plain
from taskspec_runner.record.lock import FolderLock
from taskspec_runner.record.manifest import SEAL, seal
from taskspec_runner.record.names import JOURNAL, SWEEP, TABLE, TASK
from taskspec_runner.sweep.world_run import Row

PAGE = "sweep.html"
#: Of runs that are kept, below the sweep's folder.
KEPT = "worlds"
FORMAT = 1
#: Of a row's checksum, which stands before it.
_DIGITS = 16
_APPEND = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


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
            self.write(TASK, content)
            self._folder.write_sealed(SWEEP, self.said)
            # Never through a link.
            self._journal = os.fdopen(os.open(path, _APPEND, 0o666), "ab", buffering=0)
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
        line = _sum(text) + b" " + text + b"\n"
        try:
            written = self._journal.write(line)
        except OSError as error:
            raise OutputError.of(self.path / JOURNAL, error) from error
        if written != len(line):
            # The disk took a part of it, which the next who continues cuts off.
            raise OutputError(self.path / JOURNAL, os.strerror(errno.ENOSPC))
        self.rows[int(row["world"])] = row

    def write(self, name: str, content: bytes | str) -> Path:
        """Writes a file whole or not at all; `sweep.json` has its checksum when it is written next.

        Raises:
            OutputError: it cannot be written.
        """
        found = content.encode() if isinstance(content, str) else content
        sums = mapping(self.said.get("sha256"))
        self.said["sha256"] = {**sums, name: hashlib.sha256(found).hexdigest()}
        return self._folder.write(name, found)

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
    found, own = read_sweep(path), folders.is_sweep(path / SWEEP)
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


#: The last bytes of a Parquet file.
_END_OF_TABLE = b"PAR1"


@dataclass(frozen=True, slots=True)
class WrittenSweep:
    """What the folder of a sweep, or of a share of one, holds.

    Attributes:
        said: by `sweep.json`, which has its own checksum.
        content: of the task file, byte by byte.
        rows: by the number of their world, as far as they are as they were written.
        damage: what else is not as it was written; empty if all is.
    """

    said: Json
    content: bytes
    rows: Mapping[int, Row]
    damage: str

    @property
    def task(self) -> LoadedTask:
        """The task of the sweep.

        Raises:
            SpecError: this version does not take it.
            InputError: a file that it includes has changed.
        """
        overrides = mapping(self.said["overrides"])
        sets = {str(key): str(value) for key, value in overrides.items()}
        # What else the file reads was read where it was run, but for what it includes.
        origin = Path(str(self.said["file"] or TASK))
        loaded = load_text(self.content.decode(), str(origin), sets, origin.parent)
        known = mapping(self.said.get("inputs")).values()
        for path, digest in loaded.included.items():
            if digest not in known:
                raise InputError(f"{path} is no longer what was swept")
        return loaded

    @property
    def count(self) -> int:
        """Worlds that the sweep has, all shares together."""
        return int(mapping(self.said["worlds"])["count"])


def read_written(path: Path) -> WrittenSweep:
    """Reads the folder of a sweep.

    Raises:
        InputError: it is none, or what it says of itself or its task was altered.
    """
    said = read_sweep(path)
    if not folders.is_sweep(path / SWEEP):
        raise InputError(f"{path} is no folder of a sweep")
    if said["format"] > FORMAT:
        raise InputError(
            f"cannot read {path}: a newer taskspec made it (format {said['format']}, this one "
            f"reads up to {FORMAT})"
        )
    if said.get(SEAL) != seal(said):
        raise InputError(f"cannot read {path / SWEEP}: it was altered, or an earlier taskspec "
                         "wrote it")  # fmt: skip
    try:
        with open_regular(path / TASK) as file:
            content = file.read(LARGEST)
        rows, good = _read(path / JOURNAL)
        whole = good == _size(path / JOURNAL)
        table = _digest_of_table(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    sums = mapping(said.get("sha256"))
    if sums.get(TASK) != hashlib.sha256(content).hexdigest():
        raise InputError(f"cannot read {path / TASK}: it was altered: it is not what was swept")
    damage = "" if whole else f"{JOURNAL} was altered or cut short after {len(rows)} worlds"
    if whole and table != sums.get(TABLE):
        what = "is missing" if table is None else "was altered: it is not what was written"
        damage = f"{TABLE} {what}"
    return WrittenSweep(said, content, rows, damage)


def _digest_of_table(path: Path) -> str | None:
    """SHA-256 of the table; empty where it has no end, which need not be read, None without one."""
    try:
        with open_regular(path / TABLE) as file:
            file.seek(-len(_END_OF_TABLE), os.SEEK_END)
            if file.read() != _END_OF_TABLE:
                return ""
    except FileNotFoundError:
        return None
    except OSError:
        # It is shorter than that, or no regular file.
        return ""
    return RunFolder(path).digest(TABLE)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


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
            while line := file.readline(LARGEST):
                digits, _, text = line.rstrip(b"\n").partition(b" ")
                if not line.endswith(b"\n") or _sum(text) != digits:
                    break
                try:
                    row = dict(folders.parse_json(text))
                    rows[int(row["world"])] = row
                except (ValueError, LookupError, TypeError, RecursionError):
                    # No row, though its checksum is right: somebody else has written it.
                    break
                good += len(line)
    except FileNotFoundError:
        pass
    return rows, good
