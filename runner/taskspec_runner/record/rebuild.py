"""The program of a run, compiled anew from the run's folder."""

from __future__ import annotations

import json
from pathlib import Path

from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner.record.folder import MANIFEST, TASK


class RebuildError(Exception):
    """The task of a run cannot be compiled again; the message says why."""


def rebuild(folder: Path) -> Program:
    """Compiles the task of a run as it was run, with the overrides of the run.

    Files that the task names, such as a robot's, are looked for beside the original task file.

    Args:
        folder: of the run, with manifest and task file.

    Raises:
        RebuildError: something is missing, or no longer as it was.
    """
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        text = (folder / TASK).read_text(encoding="utf-8")
        file = Path(manifest["file"] or folder / TASK)
        return compile_unchecked(load_text(text, str(file), manifest["overrides"], file.parent))
    except SpecError as error:
        first = error.diagnostics[0]
        raise RebuildError(f"{first.code}: {first.message}") from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RebuildError(f"{type(error).__name__}: {error}") from error
