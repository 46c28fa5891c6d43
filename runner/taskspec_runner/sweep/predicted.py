"""What `validate` predicts of single worlds, beside how their runs ended."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from typing import Any

from taskspec.examination import examine
from taskspec.program.program import Program
from taskspec.program.worlds import World, as_file
from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec_runner.sweep.bundle import Bundle, program_of
from taskspec_runner.sweep.engine import Work, results
from taskspec_runner.sweep.world_run import Row
from taskspec_runner.sweep.worlds import Worlds

#: Worlds of each kind, good and failed, that are looked at.
MOST = 10


def predicted(
    executor: Executor | None, bundle: Bundle, worlds: Worlds, rows: Sequence[Row], jobs: int
) -> dict[str, Any]:
    """Examines some worlds as if the file said that they are the true one.

    Args:
        executor: any of `concurrent.futures`' kind; None to examine them here.
        bundle: the task and what it reads.
        worlds: which worlds the sweep has.
        rows: of all of them.
        jobs: how many workers the executor has.

    Returns:
        How many failed and how many good worlds were looked at, in how many of them there was an
        error or a warning, by which codes, and the worlds in which that was wrong.
    """
    looked = {
        name: [int(row["world"]) for row in rows if row["success"] is success][:MOST]
        for name, success in (("failed", False), ("good", True))
    }
    pieces = [Work(bundle, worlds, (world,)) for some in looked.values() for world in some]
    said = dict(results(executor, examine_work, pieces, jobs))
    found: dict[str, Any] = {}
    for name, some in looked.items():
        told = [world for world in some if said[world]]
        found[name] = {
            "of": len(some),
            "announced": len(told),
            "codes": sorted({code for world in some for code in said[world]}),
            "wrong": sorted(set(some) - set(told)) if name == "failed" else sorted(told),
        }
    return found


def examine_work(work: Work) -> tuple[int, tuple[str, ...]]:
    """A world and the codes of errors and warnings about it."""
    program, (index,) = program_of(work.bundle), work.indices
    return index, codes(program, work.worlds.world(program.context, index))


def codes(program: Program, world: World) -> tuple[str, ...]:
    """The codes of errors and warnings about a world."""
    examined = examine(as_file(program.context.loaded, world))
    return tuple(_serious(examined.findings))


def _serious(found: Iterable[Diagnostic]) -> Iterable[str]:
    return dict.fromkeys(each.code for each in found if each.severity is not Severity.INFO)
