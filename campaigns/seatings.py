"""What became of pegs over a hole that is somewhere else: seated, when, and how gently."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taskspec.compiler import compile_task
from taskspec.program.worlds import World, random_world
from taskspec.spec import load_task
from taskspec_runner.record.history import History
from taskspec_runner.trial.trial import trial

#: The hole of the files that are held against each other; their frames are in it.
HOLE = "socket"
#: How far above the bottom a peg is seated: 4 % of the 25 mm of the hole, as in Factory [m].
SEATED = 0.001
#: The longest episode of Factory's PegInsert [s].
IN_TIME = 10.0


@dataclass(frozen=True, slots=True)
class Seating:
    """One peg.

    Attributes:
        time: of the first tick at which it was seated; infinite where it never was [s].
        force: the largest true contact force [N].
    """

    time: float
    force: float

    @property
    def in_time(self) -> bool:
        """Whether it was seated within an episode of the benchmark."""
        return self.time <= IN_TIME


def seating(history: History, world: World, nominal: float) -> Seating:
    """What a run in a world came to.

    Args:
        history: of the run, whose frames are parallel to that of the hole.
        world: that it ran in.
        nominal: height of the hole in the file [m].
    """
    columns, hole = history.columns, world.task.shapes[HOLE]
    above = columns["position.z"] + nominal - float(hole.xyz[2]) + float(hole.depth)
    seated = np.flatnonzero(np.abs(above) <= SEATED)
    force = np.sqrt(sum(np.square(columns[f"force.{axis}"]) for axis in "xyz"))
    time = float(columns["clock"][seated[0]]) if len(seated) else np.inf
    return Seating(time, float(force.max()))


def seatings(file: Path, overrides: dict[str, str], seed: int, worlds: int) -> list[Seating]:
    """The pegs of a file in the first worlds of a seed."""
    program = compile_task(load_task(file, overrides))
    nominal = float(program.context.loaded.task.shapes[HOLE].xyz[2])
    found = []
    for number in range(worlds):
        world = random_world(program.context, seed, number)
        found.append(seating(trial(program, world).history, world, nominal))
    return found


HEAD = ("seated", "within 10 s", "median time", "90 % by", "median force", "largest force")
"""What `cells` says."""


def cells(found: Sequence[Seating]) -> Iterable[str]:
    """A row of a table about some pegs; a quantile that not so many reached is a dash."""
    times = np.sort([each.time for each in found])
    forces = [each.force for each in found]
    late = times[int(np.ceil(0.9 * len(times))) - 1]
    middle = times[(len(times) - 1) // 2]
    yield f"{np.isfinite(times).sum()} of {len(found)}"
    yield str(sum(each.in_time for each in found))
    yield from (f"{time:.2f} s" if np.isfinite(time) else "—" for time in (middle, late))
    yield f"{np.median(forces):.1f} N"
    yield f"{max(forces):.1f} N"
