"""What made a run: versions, machine, inputs. Unlike the summary, it differs from run to run."""

from __future__ import annotations

import hashlib
import platform
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

from taskspec import __version__
from taskspec.spec import LoadedTask
from taskspec.text.characters import normal

FORMAT = 1
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


def opening(loaded: LoadedTask, content: bytes, seed: int) -> dict[str, Any]:
    """The manifest of a run that begins now."""
    return {
        "format": FORMAT,
        "status": RUNNING,
        "reason": None,
        "task": loaded.task.name,
        "file": None if loaded.path is None else str(loaded.path.absolute()),
        "overrides": dict(loaded.overrides),
        "seed": seed,
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
        "exit_code": None,
        "sha256": {"task.yaml": hashlib.sha256(content).hexdigest(), "log.arrow": None},
    }


def versions() -> dict[str, str]:
    """Versions of everything that a run's numbers depend on."""
    return {
        "python": platform.python_version(),
        "taskspec": __version__,
        **{name: metadata.version(name) for name in _DISTRIBUTIONS},
    }


def now() -> str:
    """The time on the wall, UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
