"""What made a run: versions, machine, inputs. Unlike the summary, it differs from run to run."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taskspec import __version__
from taskspec.program import inputs as inputs_of
from taskspec.spec import LoadedTask
from taskspec.text.characters import normal
from taskspec_runner.record.names import LOG, SUMMARY, TASK

if TYPE_CHECKING:
    from taskspec.program.worlds import World
from taskspec.program.program import Program

#: 2 has checksums of the summary, of the files that a task draws on, and of itself.
FORMAT = 2
SEAL = "seal"
#: Status of a run that has not come to its end.
RUNNING = "running"
_DISTRIBUTIONS = ("mujoco", "pin", "casadi", "numpy", "pyarrow")


def task_bytes(loaded: LoadedTask) -> bytes:
    """The task file byte by byte, as it was read.

    A file that has changed since is given as its text was.
    """
    text = loaded.source.text
    if loaded.path is not None:
        try:
            content = loaded.path.read_bytes()
            if normal(content.decode("utf-8")) == text:
                return content
        except (OSError, UnicodeDecodeError):
            pass
    return text.encode()


def opening(program: Program, content: bytes, world: World) -> dict[str, Any]:
    """The manifest of a run that begins now.

    Args:
        program: that is run.
        content: of the task file.
        world: that its plant is.
    """
    loaded = program.context.loaded
    return {
        "format": FORMAT,
        "status": RUNNING,
        "reason": None,
        "task": loaded.task.name,
        "file": None if loaded.path is None else str(loaded.path.absolute()),
        "overrides": dict(loaded.overrides),
        "seed": world.seed,
        "world": world.as_data(),
        "inputs": inputs(program),
        "versions": versions(),
        "platform": {
            "system": platform.platform(),
            "machine": platform.machine(),
            "python": platform.python_implementation(),
        },
        "started": now(),
        "finished": None,
        "wall_seconds": None,
        "real_time_factor": None,
        "loop": None,
        "why_python": None,
        "exit_code": None,
        "sha256": {
            TASK: hashlib.sha256(content).hexdigest(),
            LOG: None,
            SUMMARY: None,
        },
    }


def inputs(program: Program) -> dict[str, str]:
    """SHA-256 of every file that a task draws on: of its robot, tables, and what it includes.

    Names are relative to the task file where they lie below its folder.
    """
    base = (program.context.loaded.base or Path()).absolute()
    files = input_files(program)
    return {
        path.relative_to(base).as_posix() if path.is_relative_to(base) else str(path): digest
        for path, digest in sorted(files.items())
    }


def input_files(program: Program) -> dict[Path, str]:
    """The same by their absolute paths."""
    files = inputs_of.input_files(program.context)
    return {path: digest for path, digest in files.items() if digest is not None}


def seal(content: Mapping[str, Any]) -> str:
    """SHA-256 of a JSON mapping but for its seal, whatever the order of its keys."""
    rest = {key: value for key, value in content.items() if key != SEAL}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def run_mark(manifest: Mapping[str, Any]) -> str:
    """What batches of a log say of their run: the same for the same task, overrides and world."""
    sums = manifest.get("sha256")
    task = sums.get(TASK) if isinstance(sums, Mapping) else None
    parts = [task, *(manifest.get(key) for key in ("overrides", "seed", "world"))]
    said = json.dumps(parts, sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions of everything that a run's numbers depend on."""
    return {
        "python": platform.python_version(),
        "taskspec": __version__,
        **{name: _version(name) for name in _DISTRIBUTIONS},
    }


@cache
def _version(name: str) -> str:
    """The version of a distribution, for whose sake its whole description is read."""
    return metadata.version(name)


def now() -> str:
    """The time on the wall, UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def override_words(overrides: Mapping[str, Any]) -> list[str]:
    """The words of a command line that give overrides."""
    return [word for key, value in overrides.items() for word in ("--set", f"{key}={value}")]
