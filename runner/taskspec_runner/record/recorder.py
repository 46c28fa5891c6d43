"""What the log takes of every tick, collected in batches, which another thread writes."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from taskspec.program.stages.stage import CompiledStage
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.record.block import Block
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.layout import LogLayout, stage_names
from taskspec_runner.record.log import Log

Vector = NDArray[np.float64]

#: Rows of one batch.
BATCH = 500
#: Batches for which there is room: one that is being filled, the others until they are written.
_BATCHES = 4
#: Rows for which there is room.
ROOM = _BATCHES * BATCH


class Recorder:
    """Collects the bus tick by tick and writes it as named columns in SI units.

    The newest ticks lie in a file that is mapped into memory: a process that is killed loses the
    tick under way, and no other. Complete batches are formatted and written by a thread of their
    own, so that the loop waits for it only where a disk does not keep up.

    Attributes:
        block: the newest ticks; None where nothing is kept.
        ticks: so far.
    """

    def __init__(
        self,
        log: Log | None,
        bus: Bus,
        robot: RobotModel,
        stages: tuple[CompiledStage, ...],
        task: Task,
        *,
        measured: bool = False,
    ) -> None:
        """Begins a log.

        Args:
            log: to write; None for one that keeps nothing.
            bus: to record.
            robot, stages: of the program.
            task: with the true world.
            measured: whether it is of a robot, of which nobody knows the truth.

        Raises:
            OutputError: there is no room for the newest ticks.
        """
        self._stages, self._array, self._log = stages, bus.array, log
        self._layout = LogLayout(bus.slices, robot, stages, task, measured=measured)
        self.block = None if log is None else log.block(ROOM, len(bus.array))
        self._take = None if self.block is None else self.block.taking(bus.array)
        self.ticks = 0
        self._handed = self._written = 0
        self._writer: ThreadPoolExecutor | None = None
        self._under_way: deque[Future[None]] = deque()

    def add(self) -> None:
        """Records the bus as it is now.

        Raises:
            OutputError: a batch before could not be written.
        """
        if self._take is not None:
            self._take(self.ticks)
        self.advance(1)

    def advance(self, ticks: int) -> None:
        """Takes note of ticks that are in the block, no more than `left` of them.

        Raises:
            OutputError: a batch before could not be written.
        """
        self.ticks += ticks
        if self.ticks % BATCH == 0:
            self._hand_over()

    def by_machine_code(self) -> None:
        """Takes note that machine code runs the ticks: it may work out the log's signals, too."""
        self._layout.by_machine_code()

    @property
    def left(self) -> int:
        """Ticks up to the end of the batch, for which there is room."""
        return BATCH - self.ticks % BATCH

    def latest(self) -> dict[str, float | str]:
        """The bus as it is now, by column name."""
        # The thread that writes evaluates other row counts, in memory of their own.
        columns = self._layout.columns(self._array[np.newaxis])
        return {
            name: float(values[0]) if unit != "stage" else self._named(values[0])
            for name, (values, unit) in columns.items()
        }

    def _named(self, stage: float) -> str:
        names = stage_names(self._stages)
        return names[min(int(stage), len(self._stages))]

    def settle(self) -> None:
        """Waits until all complete batches are written.

        Raises:
            OutputError: one cannot be written.
        """
        self._wait(0)

    def close(self) -> None:
        """Writes what is left and ends the stream.

        Raises:
            OutputError: it cannot be written.
        """
        if self._log is None:
            return
        try:
            self._hand_over()
            self.settle()
        finally:
            if self._writer is not None:
                self._writer.shutdown(cancel_futures=True)
            log, self._log = self._log, None
            log.close()

    def _hand_over(self) -> None:
        """Has the ticks since the last batch written; waits until there is room for another."""
        first, n = self._handed, self.ticks - self._handed
        if not n or self._log is None or self.block is None:
            return
        if self._writer is None:
            self._writer = ThreadPoolExecutor(1, "log")
        self._handed = self.ticks
        self._under_way.append(self._writer.submit(self._write, self._log, self.block, first, n))
        self._wait(_BATCHES - 1)

    def _wait(self, most: int) -> None:
        """Waits until no more than `most` batches are under way."""
        while len(self._under_way) > most:
            self._under_way.popleft().result()

    def _write(self, log: Log, block: Block, first: int, n: int) -> None:
        """Writes `n` ticks from `first` on as one batch; none of them is across the ring's end."""
        if first != self._written:
            # The batch before could not be written, which `_wait` raises.
            return
        row = first % ROOM
        log.write(self._layout.batch(block.rows[row : row + n]))
        self._written = first + n
        block.advance(self._written, bytes.fromhex(log.sha256))
