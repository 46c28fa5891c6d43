"""Run folders made by hand, or changed: sealed as if a run had written them so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from taskspec_runner.record.folder import RunFolder, read_json
from taskspec_runner.record.manifest import FORMAT
from taskspec_runner.record.names import LOG, MANIFEST, SUMMARY, TASK


def seal_folder(folder: Path, **entries: Any) -> None:
    """Puts entries into the manifest, with the checksums of the files that are there."""
    into = RunFolder(folder, dict(read_json(folder / MANIFEST)))
    sums = {name: into.digest(name) for name in (TASK, LOG, SUMMARY)}
    into.note(**{"format": FORMAT, "sha256": sums, "log": {}, **entries})
