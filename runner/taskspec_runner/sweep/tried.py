"""Some random worlds of `vary`, run where no sweep is wanted: which end badly, and what decides."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.program import Program
from taskspec.program.worlds import random_world
from taskspec.rules.finding import Finding, warning
from taskspec.spec import FILE
from taskspec_runner.sweep.statistics import influences, regions
from taskspec_runner.sweep.summary import region_text
from taskspec_runner.sweep.world_run import Row, run_world

#: An influence that would come about by chance as often as this is none.
_BY_CHANCE = 0.05
#: Bad worlds that are described one by one.
_DESCRIBED = 3


def bad_worlds(program: Program, count: int, seed: int) -> Iterator[Finding]:
    """Runs random worlds, and reports how many end badly, which, and on what that depends.

    Args:
        program: the compiled task.
        count: of worlds, numbered from 0 under the seed.
        seed: of everything random.
    """
    context, task = program.context, program.context.loaded.task
    if not task.vary:
        return
    rows = [run_world(program, i, random_world(context, seed, i)) for i in range(count)]
    bad = [row for row in rows if not row["success"]]
    if not bad:
        return
    parts = [f"{len(bad)} of {count} worlds of `vary` end badly: {'; '.join(_ends(bad))}"]
    parts += [region_text(each, task) for each in regions(rows)]
    found = [each.parameter for each in influences(rows) if each.chance < _BY_CHANCE]
    if found and len(parts) == 1:
        parts.append(f"what decides is {found[0]}")
    path = next((p for p in task.vary if found and found[0].startswith(p)), next(iter(task.vary)))
    yield warning(
        "TS622",
        ". ".join(parts),
        FILE.vary[path],
        f"see one by `taskspec run --world {bad[0]['world']} --seed {seed}`, or narrow what varies",
    )


def _ends(bad: list[Row]) -> Iterator[str]:
    for row in bad[:_DESCRIBED]:
        yield f"world {row['world']} {row['verdict']} in {row['stage']!r} ({_why(row)})"
    if len(bad) > _DESCRIBED:
        yield f"and {len(bad) - _DESCRIBED} more"


def _why(row: Row) -> str:
    if row["status"] != "done":
        return str(row["text"])
    missed = [name.removeprefix("expect ") for name, met in row.items() if met is False]
    missed = [name for name in missed if name != "success"]
    return str(row["findings"]) if row["findings"] else f"misses expectation {', '.join(missed)}"
