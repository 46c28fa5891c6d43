"""A comparison read back from its folder, for the page and the picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.regular_file import open_regular
from taskspec_runner.compare.attempt import AS_WRITTEN
from taskspec_runner.record.folder import LARGEST, parse_json
from taskspec_runner.record.manifest import SEAL, seal
from taskspec_runner.record.names import COMPARISON
from taskspec_runner.runs import Run

Json = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Comparison:
    """A comparison in memory.

    Attributes:
        summary: the content of `compare.json`.
        runs: law to its run, for those that have one.
    """

    summary: Json
    runs: Mapping[str, Run]

    @property
    def laws(self) -> Sequence[Json]:
        """What each law came to: the task as written, then by rank, then those without one."""
        laws: Sequence[Json] = self.summary["laws"]
        last = len(laws)
        return sorted(laws, key=lambda law: (law["law"] != AS_WRITTEN, law.get("rank") or last))

    @property
    def stages(self) -> list[str]:
        """Every stage that some law visited: those with a force to reach, if there are any."""
        seen = list(dict.fromkeys(s for law in self.laws for s in law.get("stages", ())))
        return [s for s in seen if self.summary["force_axes"].get(s)] or seen

    def rows(self, stage: str) -> dict[str, Json | None]:
        """Law to what it came to in a stage, None where it was not there; runs only."""
        return {
            law["law"]: law["stages"].get(stage) for law in self.laws if "stages" in law
        }  # fmt: skip


def read_comparison(folder: Path) -> Comparison:
    """Reads the folder of a comparison.

    Raises:
        OSError: it has no `compare.json`.
        ValueError: what it has is none, or not as it was written.
        RecursionError: it is nested too deeply.
    """
    with open_regular(folder / COMPARISON) as file:
        summary = parse_json(file.read(LARGEST))
    if summary.get(SEAL) != seal(summary):
        raise ValueError("it was altered, or an earlier taskspec wrote it")
    if "about" not in summary:
        raise ValueError("the comparison did not come to its end")
    runs = {law["law"]: Run(folder / law["folder"]) for law in summary["laws"] if law["folder"]}
    return comparison(summary, runs)


def comparison(summary: Json, runs: Mapping[str, Run]) -> Comparison:
    """A comparison of those runs that have a tick, by law."""
    return Comparison(summary, {law: run for law, run in runs.items() if len(run)})
