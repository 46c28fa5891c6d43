"""Holds both tiers of the native loop against Python's: shipped and random tasks, every byte.

The tiers are machine code of a task's own and the interpreter.

python campaigns/native.py [--tasks 200] [SHIPPED ...]
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from random_tasks import write_tasks

from taskspec.compiler import compile_task
from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec.spec import load_task
from taskspec.text.diagnostic import SpecError
from taskspec_runner.link.library import InLibrary
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.fixed_step import INTERPRETED, NATIVE, PYTHON
from taskspec_runner.record.log import Log

ROOT = Path(__file__).resolve().parents[1]


def ran(
    program: Program,
    path: Path,
    loop: str,
    world: World | None = None,
    link: InLibrary | None = None,
) -> tuple[str, str, int, str]:
    """How a run in a world ended, and why, its ticks, and the SHA-256 of its log.

    Args:
        program: of the task. path: of the log. loop: which. world: None for the true one.
        link: to a library that commands in the program's place.
    """
    for old in (path, path.with_name("log.block")):
        old.unlink(missing_ok=True)
    parts = assemble(program, world) if link is None else link.assemble(program, world)
    with closing(parts.recorder(Log(path))) as recorder:
        outcome = fixed_step.run(
            parts.machine,
            parts.plant,
            parts.bus,
            recorder,
            program.context.period,
            seed=0 if world is None else world.noise_seed,
            loop=loop,
            sensing=parts.sensing,
        )
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return outcome.status, outcome.reason, outcome.ticks, digest


def main() -> int:
    """Runs every task by all loops; the exit code is 1 if any differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=200, help="random ones")
    parser.add_argument("shipped", nargs="*", help="names of shipped ones; all if left out")
    given = parser.parse_args()
    different = refused = ticks = 0
    with TemporaryDirectory() as folder:
        files = [
            *(ROOT / "tasks" / f"{name}.yaml" for name in given.shipped),
            *([] if given.shipped else sorted((ROOT / "tasks").glob("*.yaml"))),
            *write_tasks(Path(folder), range(given.tasks)),
        ]
        for file in files:
            try:
                program = compile_task(load_task(file), force=True)
            except SpecError:
                refused += 1
                continue
            log = Path(folder) / "log.arrow"
            by = {loop: ran(program, log, loop) for loop in (INTERPRETED, NATIVE, PYTHON)}
            ticks += by[PYTHON][2]
            if len(set(by.values())) > 1:
                different += 1
                sys.stdout.write(f"{file.stem}: {by}\n")
    sys.stdout.write(
        f"{len(files) - refused} tasks, {ticks} ticks, {refused} refused, {different} differ\n"
    )
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
