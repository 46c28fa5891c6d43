"""The table of a sweep: a row a world."""

from __future__ import annotations

from pathlib import Path

from taskspec.analysis.worlds import World
from taskspec.program.context import Context


def world_in(path: Path, row: int, context: Context) -> World:
    """The world of a row."""
    raise NotImplementedError
