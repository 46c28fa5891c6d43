"""The world that a user names: by its number, or by a row of a sweep's table."""

from __future__ import annotations

from pathlib import Path

from taskspec.program.context import Context
from taskspec.program.worlds import World
from taskspec_runner.errors import InputError
from taskspec_runner.session import world_numbered


def chosen_world(context: Context, seed: int, named: str | None) -> World:
    """The world of a run.

    Args:
        context: the task.
        seed: of everything random.
        named: its number from 0 under the seed, or `TABLE:ROW`; None for the true one.

    Raises:
        InputError: there is no such world.
    """
    if named is None or named.isdecimal():
        return world_numbered(context, seed, None if named is None else int(named))
    table, _, row = named.rpartition(":")
    if not table or not row.isdecimal():
        raise InputError(f"--world takes a number from 0 or TABLE:ROW, not {named!r}")
    from taskspec_runner.sweep.table import world_in

    return world_in(Path(table), int(row), context)
