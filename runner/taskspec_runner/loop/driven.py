"""What the loop steps, measures by and records with: protocols, for plants here and elsewhere."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.block import Block

Vector = NDArray[np.float64]


class TickSink(Protocol):
    """What takes every tick."""

    def add(self) -> None:
        """Takes the bus as it is now."""


@runtime_checkable
class BlockSink(TickSink, Protocol):
    """What takes ticks also by the dozen, from a loop that writes them into its block.

    Attributes:
        block: where they are to be; None where they need not be kept.
    """

    block: Block | None

    @property
    def left(self) -> int:
        """How many ticks it takes before it has to look at one, the last of them."""

    def advance(self, ticks: int) -> None:
        """Takes ticks that are in the block."""

    def by_machine_code(self) -> None:
        """Takes note that machine code runs the ticks."""


class DrivenArm(Protocol):
    """What the loop uses of an arm.

    Attributes:
        diverged: whether alarms are to be checked now.
    """

    diverged: bool


class Driven(Protocol):
    """What the loop steps: a plant, or what stands for one that is elsewhere."""

    @property
    def arm(self) -> DrivenArm:
        """The arm."""

    def step(self, torque: Vector) -> None:
        """Holds joint torques (n,) [N m] for one control period.

        Raises:
            LinkError: it is no longer there.
        """

    def alarm(self) -> tuple[str, str] | None:
        """Its own alarm as (name, text), if any."""

    def release(self) -> Plant | None:
        """Takes it from whoever drove it: the plant whose arm is to be brought to rest from here.

        None where there is none in this process.
        """


class Senses(Protocol):
    """What gives the controller what is measured."""

    def read(self) -> None:
        """Writes the measurement into the controller's inputs.

        Raises:
            LinkError: there is none any more.
        """
