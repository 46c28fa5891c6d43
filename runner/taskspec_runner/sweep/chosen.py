"""The world that a user names: by its number, or by a row of a sweep's table."""

from __future__ import annotations

from pathlib import Path

from taskspec.analysis.worlds import World, draws_of, random_world, true_world
from taskspec.program.program import Program
from taskspec_runner.errors import InputError


def chosen_world(program: Program, seed: int, named: str | None) -> World:
    """The world of a run.

    Args:
        program: of the task.
        seed: of everything random.
        named: its number from 0 under the seed, or `TABLE:ROW`; None for the true one.

    Raises:
        InputError: there is no such world.
    """
    context = program.context
    if named is None:
        return true_world(context, seed)
    if named.isdecimal():
        if not draws_of(context) and int(named):
            raise InputError("nothing varies in this task, so that all its worlds are alike; "
                             "give it a 'vary', or leave out --world")  # fmt: skip
        return random_world(context, seed, int(named))
    table, _, row = named.rpartition(":")
    if not table or not row.isdecimal():
        raise InputError(f"--world takes a number from 0 or TABLE:ROW, not {named!r}")
    from taskspec_runner.sweep.table import world_in

    return world_in(Path(table), int(row), context)
