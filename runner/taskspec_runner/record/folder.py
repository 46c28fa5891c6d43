"""The folder of a run: what is in it, and how it is written so that no state is half a state."""

from __future__ import annotations

import hashlib
import json
import math
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taskspec_runner.errors import OutputError

Json = Mapping[str, Any]

TASK, MANIFEST, LOG = "task.yaml", "manifest.json", "log.arrow"
SUMMARY, REPORT, CRASH = "summary.json", "report.html", "crash.txt"
_OWN = (TASK, MANIFEST, LOG, SUMMARY, REPORT, CRASH)
#: What `export` puts beside them.
EXPORTS = ("log.csv", "log.parquet", "log.mcap", "log.rrd")

#: Where runs go that are not told where to go.
RUNS = Path("runs")


@dataclass(slots=True)
class RunFolder:
    """A folder that holds one run.

    Attributes:
        path: the folder.
        manifest: what `manifest.json` says.
    """

    path: Path
    manifest: dict[str, Any] = field(default_factory=dict)

    @property
    def log(self) -> Path:
        """The log."""
        return self.path / LOG

    def write_text(self, name: str, text: str) -> Path:
        """Writes a file whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        return self.write_bytes(name, text.encode())

    def write_bytes(self, name: str, content: bytes) -> Path:
        """Writes a file whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        path, partial = self.path / name, self.path / f".{name}.partial"
        try:
            partial.write_bytes(content)
            partial.replace(path)
        except OSError as error:
            raise OutputError.of(path, error) from error
        return path

    def write_json(self, name: str, content: Mapping[str, Any]) -> Path:
        """Writes a mapping as JSON; numbers that are not finite become null.

        Raises:
            OutputError: it cannot be written.
        """
        text = json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False)
        return self.write_text(name, text + "\n")

    def note(self, **entries: Any) -> None:
        """Puts entries into the manifest and writes it.

        Raises:
            OutputError: it cannot be written.
        """
        self.manifest |= entries
        self.write_json(MANIFEST, self.manifest)

    def crash(self, error: BaseException) -> Path:
        """Keeps the traceback of an internal error; returns where.

        Raises:
            OutputError: it cannot be written.
        """
        text = "".join(traceback.format_exception(error))
        return self.write_text(CRASH, text)

    @property
    def is_run(self) -> bool:
        """Whether it holds a run, or what is left of one."""
        return any((self.path / name).is_file() for name in (LOG, MANIFEST))

    def digest(self, name: str) -> str | None:
        """SHA-256 of a file of the folder, None if there is none."""
        path = self.path / name
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


def open_folder(out: Path | None, name: str) -> RunFolder:
    """Makes the folder of a new run.

    Args:
        out: where; an earlier run in it is replaced. None for `runs/NAME`, or with -2, -3, ...
            where that exists.
        name: of the task.

    Raises:
        OutputError: it cannot be made, or holds something else than a run.
    """
    try:
        if out is None:
            return RunFolder(new(RUNS / name))
        out.mkdir(parents=True, exist_ok=True)
        clear(out)
    except OSError as error:
        raise OutputError.of(out or RUNS / name, error) from error
    return RunFolder(out)


def new(path: Path) -> Path:
    """Makes a folder that was not there, with -2, -3, ... behind its name where it was.

    Raises:
        OSError: it cannot be made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    number = 1
    while True:
        candidate = path if number == 1 else path.with_name(f"{path.name}-{number}")
        try:
            candidate.mkdir()
        except FileExistsError:
            number += 1
        else:
            return candidate


def clear(path: Path) -> None:
    """Takes an earlier run out of a folder.

    Raises:
        OutputError: the folder holds something else than a run.
        OSError: a file cannot be removed.
    """
    held = {entry.name for entry in path.iterdir()}
    if held and MANIFEST not in held:
        raise OutputError(path, "the folder is not empty and holds no run")
    for name in (*_OWN, *EXPORTS):
        (path / name).unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """A value as it is read back from JSON: what is not finite is None, what is a tuple a list."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return str.__str__(value) if isinstance(value, str) else value


def read_json(path: Path) -> Json:
    """The mapping of a JSON file; empty where there is none, or something else."""
    try:
        return mapping(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


def number(value: object) -> float | None:
    """A finite number of a JSON file that may hold anything, else None."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def mapping(value: object) -> Json:
    """A mapping of such a file, an empty one in place of anything else."""
    return value if isinstance(value, Mapping) else {}


def mappings(value: object) -> list[Json]:
    """The mappings of a list of such a file, none in place of anything else."""
    return [v for v in value if isinstance(v, Mapping)] if isinstance(value, list) else []
