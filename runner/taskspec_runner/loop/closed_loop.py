"""The parts of a tick, for the loops in Python and in machine code."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.execution.machine import Machine
from taskspec_runner.loop.driven import Driven, Senses, TickSink
from taskspec_runner.loop.faults import Faults
from taskspec_runner.record.bus import Bus

Vector = NDArray[np.float64]

#: Ticks between checks of the simulator's warning counters, which are slow to read.
LOOK_EVERY = 20


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """The parts of a tick.

    Attributes:
        machine, plant, bus: of the run.
        sensing: what the machine measures by.
        recorder: takes every tick; without a block, Python runs them all.
        faults: of the run, between plant and machine; None for none.
    """

    machine: Machine
    plant: Driven
    bus: Bus
    sensing: Senses
    recorder: TickSink
    faults: Faults | None = None

    @property
    def read(self) -> Callable[[], None]:
        """Measures the arm for this tick."""
        read = self.sensing.read
        return read if self.faults is None else partial(self.faults.read, self.sensing)

    @property
    def step(self) -> Callable[[Vector], None]:
        """Holds joint torques (n,) for one control period [N m]."""
        return self.plant.step if self.faults is None else self.faults.step
