"""What `validate` says of single worlds, beside what became of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from taskspec.analysis.worlds import World
from taskspec.examination import examine
from taskspec.program.program import Program
from taskspec.spec.truth import DeclaredTruth
from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec_runner.sweep.world_run import Row
from taskspec_runner.sweep.worlds import Worlds

#: Worlds of each kind, good and failed, that are looked at.
MOST = 10


def foretold(program: Program, worlds: Worlds, rows: Sequence[Row]) -> dict[str, Any]:
    """Examines some worlds as if the file said that they are the true one.

    Args:
        program: of the task.
        worlds: which worlds the sweep has.
        rows: of all of them.

    Returns:
        How many failed and how many good worlds were looked at, in how many of them there was an
        error or a warning, by which codes, and the worlds in which that was wrong.
    """
    found: dict[str, Any] = {}
    for name, success in (("failed", False), ("good", True)):
        some = [row for row in rows if row["success"] is success][:MOST]
        said = {
            int(row["world"]): codes(program, worlds.world(program.context, int(row["world"])))
            for row in some
        }
        told = [world for world, found_codes in said.items() if found_codes]
        found[name] = {
            "of": len(said),
            "announced": len(told),
            "codes": sorted({code for each in said.values() for code in each}),
            "wrong": sorted(set(said) - set(told)) if not success else sorted(told),
        }
    return found


def codes(program: Program, world: World) -> tuple[str, ...]:
    """The codes of errors and warnings about a world."""
    loaded = program.context.loaded
    paths = dict.fromkeys((*loaded.task.truth.paths, *(path for path, _ in world.values)))
    truth = {"truth": DeclaredTruth(tuple(paths)), "vary": {}}
    task = loaded.task.model_copy(update=truth)
    examined = examine(
        replace(loaded, task=task, true_task=world.task.model_copy(update={"vary": {}}))
    )
    return tuple(_serious(examined.findings))


def _serious(found: Iterable[Diagnostic]) -> Iterable[str]:
    return dict.fromkeys(each.code for each in found if each.severity is not Severity.INFO)
