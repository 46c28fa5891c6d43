"""Ticks of a run that no log keeps: raw, in memory, and as columns where one is used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.program.stages.stage import CompiledStage
from taskspec_runner.record.block import Block
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.file_array import blocks, empty
from taskspec_runner.record.history import STAGE, History
from taskspec_runner.record.layout import LogLayout

Vector = NDArray[np.float64]

#: Ticks that are collected before they are put aside.
ROOM = 4096
#: Bytes that are kept in memory; what is more goes to a file.
IN_MEMORY = 1 << 26


class RowKeeper:
    """Keeps every tick of a run as the bus has it; many of them in a file without a name.

    Attributes:
        block: where the loop writes ticks.
    """

    def __init__(self, bus: Bus, room: int = ROOM) -> None:
        """Keeps the ticks of a bus; `room` is how many are collected before they are put aside."""
        fields = len(bus.array)
        self.block: Block | None = Block.memory(room, fields)
        self._room = room
        self._rows, self._array = self.block.rows, bus.array
        self._kept: list[Vector] = []
        self._used, self._by_code = 0, False

    def add(self) -> None:
        """Takes the bus as it is now."""
        self._rows[self._used] = self._array
        self.advance(1)

    def advance(self, ticks: int) -> None:
        """Takes note of ticks that are in the block."""
        self._used += ticks
        if self._used == self._room:
            self._put_aside()

    def by_machine_code(self) -> None:
        """Takes note that machine code runs the ticks: it may work out their signals, too."""
        self._by_code = True

    @property
    def left(self) -> int:
        """Ticks for which the block has room."""
        return self._room - self._used

    def latest(self, count: int) -> Vector:
        """(count, fields) the newest ticks, the oldest first; no more than there is room for.

        They are not to be written, and stay until the next ones come.
        """
        first = self._used - count
        if first >= 0:
            return self._rows[first : self._used]
        return self._rows[np.arange(first, self._used) % self._room]

    def _put_aside(self) -> None:
        self._kept.append(self._copied())
        self._used = 0

    def _copied(self) -> Vector:
        """The ticks that are in the block, as they are kept."""
        used = self._rows[: self._used]
        in_memory = sum(part.nbytes for part in self._kept) + used.nbytes <= IN_MEMORY
        kept = np.empty(used.shape) if in_memory else empty(used.shape, np.float64)
        kept[...] = used
        return kept

    def history(self, layout: LogLayout, stages: tuple[CompiledStage, ...]) -> History:
        """All ticks so far, as the log would have them."""
        if self._by_code:
            layout.by_machine_code()
        columns = RowColumns(layout, [*self._kept, self._copied()] if self._used else [*self._kept])
        return History(columns, columns.stages(stages), columns.units)


class RowColumns(Mapping[str, Vector]):
    """The columns of a log, made of raw ticks at their first use."""

    def __init__(self, layout: LogLayout, parts: list[Vector]) -> None:
        """The columns of `layout`; `parts` are rows of the bus, (ticks, fields) each."""
        self._layout, self._parts = layout, parts
        self._made: dict[str, Vector] = {}
        self.units = {name: unit for name, unit in layout.units.items() if name != STAGE}

    def __getitem__(self, name: str) -> Vector:
        if name not in self._made:
            if name not in self.units:
                raise KeyError(name)
            where = self._layout.place(name)
            self._made[name] = self._derived(name) if where is None else self._field(where)
            if where is not None and self._layout.is_true(name):
                # As in a log, a zero of a true signal has no sign.
                self._made[name] += 0.0
        return self._made[name]

    def __contains__(self, name: object) -> bool:
        return name in self.units

    def __iter__(self) -> Iterator[str]:
        return iter(self.units)

    def __len__(self) -> int:
        return len(self.units)

    @cached_property
    def _ticks(self) -> int:
        return sum(map(len, self._parts))

    def _field(self, number: int) -> Vector:
        values, at = empty(self._ticks, np.float64), 0
        for part in self._parts:
            values[at : at + len(part)] = part[:, number]
            at += len(part)
        return values

    def _derived(self, name: str) -> Vector:
        """A signal that follows from several fields: all of its components at once."""
        names = self._layout.beside(name)
        made, at = [empty(self._ticks, np.float64) for _ in names], 0
        for part in self._parts:
            for rows in blocks(len(part)):
                values = self._layout.derive(np.asarray(part[rows]), names)
                for column, kept in zip(values.T, made, strict=True):
                    kept[at : at + len(values)] = column
                at += len(values)
        self._made |= dict(zip(names, made, strict=True))
        return self._made[name]

    def stages(self, stages: tuple[CompiledStage, ...]) -> NDArray[np.str_]:
        """(n,) the stage of each tick."""
        names = np.array([stage.name for stage in stages])
        where = self._layout.place(STAGE)
        assert where is not None
        found, at = empty(self._ticks, names.dtype), 0
        for part in self._parts:
            found[at : at + len(part)] = names[part[:, where].astype(int)]
            at += len(part)
        return found
