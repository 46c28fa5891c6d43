"""What a run costs by each of the loop's tiers: Python, the interpreter, machine code of its own.

Whole runs of shipped tasks without a log, from the compiled task to the last tick: the plant is
built, functions are prepared or their code is linked, ticks are run. Each round compiles the task
anew, so that no function is known to the process, and runs it by each tier in turn; `again` is the
interpreter once more, with the functions that it knows. The code of `native` is kept, and that of
the loop itself, by a run that is not measured. Medians over the rounds, processor time.

    python benchmarks/bench_tiers.py [--rounds N] [TASK ...]
"""

from __future__ import annotations

import argparse
import gc
import statistics
import time
from pathlib import Path

from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.fixed_step import INTERPRETED, NATIVE, PYTHON
from taskspec_runner.loop.fixed_step import run as simulate
from taskspec_runner.record.rows import RowKeeper

TASKS = Path(__file__).resolve().parent.parent / "tasks"
CHOSEN = (
    *("corner-seating", "door-handle", "face-alignment", "groove-following", "linkage"),
    *("peg-in-hole", "press-impedance", "press-parallel", "press-qp", "press-saturated"),
    *("raster-polish", "snap-fit", "wipe-table", "wrist-sensor"),
)
AGAIN = "again"
#: In the order in which a round runs them.
TIERS = {PYTHON: PYTHON, INTERPRETED: INTERPRETED, AGAIN: INTERPRETED, NATIVE: NATIVE}


def ran(program: Program, loop: str) -> tuple[float, int]:
    """Processor time of a run [s], and its ticks."""
    gc.collect()
    began = time.process_time()
    parts = assemble(program)
    keeper = RowKeeper(parts.bus)
    period = program.context.period
    outcome = simulate(parts.machine, parts.plant, parts.bus, keeper, period, loop=loop)
    return time.process_time() - began, outcome.ticks


def measured(task: str, rounds: int) -> tuple[dict[str, list[float]], int]:
    """Seconds of runs by tier, and the ticks of one."""
    found: dict[str, list[float]] = {tier: [] for tier in TIERS}
    counts = set()
    for number in range(rounds + 1):
        program = compile_unchecked(load_task(TASKS / f"{task}.yaml"))
        for tier, loop in TIERS.items():
            seconds, ticks = ran(program, loop)
            counts.add(ticks)
            # The first round leaves the code that the others find.
            if number:
                found[tier].append(seconds)
    assert len(counts) == 1, f"{task}: the tiers make {counts} ticks"
    return found, counts.pop()


def main() -> None:
    """Measures the tasks, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="*", default=CHOSEN)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    others = [tier for tier in TIERS if tier != PYTHON]
    heads = [f"{tier:>12}" for tier in TIERS] + [f"{f'{tier}/python':>20}" for tier in others]
    print(f"{'us a tick, start included':26}{'ticks':>8}{''.join(heads)}{'prepared, ms':>14}")
    whole: dict[str, float] = dict.fromkeys(TIERS, 0.0)
    total = 0
    for task in given.tasks:
        found, ticks = measured(task, given.rounds)
        medians = {tier: statistics.median(found[tier]) for tier in TIERS}
        ratios = {
            tier: statistics.median(
                own / python for own, python in zip(found[tier], found[PYTHON], strict=True)
            )
            for tier in others
        }
        line(task, ticks, medians, ratios)
        total += ticks
        for tier in TIERS:
            whole[tier] += medians[tier]
    line("all", total, whole, {tier: whole[tier] / whole[PYTHON] for tier in others})


def line(name: str, ticks: int, seconds: dict[str, float], ratios: dict[str, float]) -> None:
    """A row of the table."""
    cells = [f"{1e6 * seconds[tier] / ticks:12.1f}" for tier in TIERS]
    cells += [f"{ratio:20.2f}" for ratio in ratios.values()]
    prepared = 1e3 * (seconds[INTERPRETED] - seconds[AGAIN])
    print(f"{name:26}{ticks:8}{''.join(cells)}{prepared:14.1f}", flush=True)


if __name__ == "__main__":
    main()
