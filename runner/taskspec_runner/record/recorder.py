"""What the log takes of every tick, collected in batches."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from taskspec.program.stages.stage import CompiledStage
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.record.block import Block
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.log import Log

Vector = NDArray[np.float64]

#: Rows of one batch.
BATCH = 500
_WORD = (1 << 32) - 1


class Recorder:
    """Collects the bus tick by tick and writes it as named columns in SI units.

    The ticks of the batch that is being filled lie in a file that is mapped into memory: a
    process that is killed loses the tick under way, and no other.
    """

    def __init__(
        self,
        log: Log | None,
        bus: Bus,
        robot: RobotModel,
        stages: tuple[CompiledStage, ...],
        task: Task,
    ) -> None:
        """Begins a log.

        Args:
            log: to write; None for one that keeps nothing.
            bus: to record.
            robot, stages: of the program.
            task: with the true world.

        Raises:
            OutputError: there is no room for the batch that is being filled.
        """
        self._stages, self._array, self._log = stages, bus.array, log
        self._layout = LogLayout(bus.slices, robot, stages, task)
        self._bytes, fields = bus.array.data, len(bus.array)
        self._block = Block.memory(BATCH, fields) if log is None else log.block(BATCH, fields)
        self._rows, self._fields = self._block.rows, fields
        # A slice of memory is copied in a third of the time that a row of an array takes.
        self._flat, self._sums = self._block.rows.reshape(-1).data, self._block.sums.data
        self._filled = self._ticks = 0

    def add(self) -> None:
        """Records the bus as it is now."""
        filled, ticks, fields = self._filled, self._ticks, self._fields
        numbers, start = self._bytes, filled * fields
        self._flat[start : start + fields] = numbers
        # With its checksum the tick is there, whatever happens to this process.
        self._sums[filled] = zlib.crc32(numbers, ticks & _WORD)
        self._filled, self._ticks = filled + 1, ticks + 1
        if filled + 1 == BATCH:
            self.flush()

    def latest(self) -> dict[str, float | str]:
        """The bus as it is now, by column name."""
        columns = self._layout.columns(self._array[np.newaxis])
        return {
            name: float(values[0]) if unit != "stage" else self._stages[int(values[0])].name
            for name, (values, unit) in columns.items()
        }

    def flush(self) -> None:
        """Writes the rows collected so far as one batch.

        Raises:
            OutputError: they cannot be written; they stay in the block.
        """
        if self._filled and self._log is not None:
            self._log.write(self._layout.batch(self._rows[: self._filled]))
            self._block.advance(self._ticks, bytes.fromhex(self._log.sha256))
        self._filled = 0

    def close(self) -> None:
        """Writes what is left and ends the stream.

        Raises:
            OutputError: it cannot be written.
        """
        if self._log is None:
            return
        try:
            self.flush()
        finally:
            log, self._log = self._log, None
            log.close()
