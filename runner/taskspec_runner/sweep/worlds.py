"""Which worlds a sweep has: random ones, the corners, or a grid."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.worlds import (
    World,
    corner_count,
    corner_world,
    draws_of,
    grid_count,
    grid_world,
    random_world,
)
from taskspec_runner.errors import InputError

RANDOM, CORNERS, GRID = "random", "corners", "grid"
#: More worlds than this are a slip.
MOST = 1_000_000


@dataclass(frozen=True, slots=True)
class Worlds:
    """The worlds of a sweep, by number.

    Attributes:
        kind: random, corners or grid.
        seed: of everything random.
        count: how many.
        points: of each random number, on a grid.
    """

    kind: str
    seed: int
    count: int
    points: int = 0

    @staticmethod
    def of(
        context: Context, seed: int, count: int, *, corners: bool = False, points: int = 0
    ) -> Worlds:
        """The worlds of a task.

        Args:
            context: the task.
            seed: of everything random.
            count: of random worlds.
            corners: the corners instead.
            points: of each random number on a grid instead; 0 for none.

        Raises:
            InputError: nothing varies, or there are too many.
        """
        if not draws_of(context):
            raise InputError(
                "nothing varies in this task: give it a 'vary', such as "
                "vary: {world.table.stiffness: 5..80 kN/m}"
            )
        kind = CORNERS if corners else GRID if points else RANDOM
        if corners:
            count = corner_count(context)
        elif points:
            count = grid_count(context, points)
        if count > MOST:
            raise InputError(
                f"{count} worlds are more than the {MOST} that a sweep may have"
                + ("; take fewer points, or --worlds" if points else "")
            )
        return Worlds(kind, seed, count, points)

    def world(self, context: Context, index: int) -> World:
        """One of them."""
        if self.kind == RANDOM:
            return random_world(context, self.seed, index)
        if self.kind == CORNERS:
            return corner_world(context, index, self.seed)
        return grid_world(context, self.points, index, self.seed)

    def as_data(self) -> dict[str, Any]:
        """What a sweep says of them."""
        return asdict(self)

    def shard(self, number: int, of: int) -> Sequence[int]:
        """The indices of one share of them, `number` from 1."""
        return range(number - 1, self.count, of)


def identity(bundle_key: str, worlds: Worlds) -> str:
    """What tells sweeps apart: another file, another version, or other worlds."""
    return hashlib.sha256(f"{bundle_key} {sorted(worlds.as_data().items())}".encode()).hexdigest()
