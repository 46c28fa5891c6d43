"""Protocols of what the loop steps, senses and records, for local and remote plants."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.block import Block

Vector = NDArray[np.float64]


class TickSink(Protocol):
    """A sink of every tick."""

    def add(self) -> None:
        """Takes the bus as it is now."""


@runtime_checkable
class BlockSink(TickSink, Protocol):
    """A sink that also takes ticks in blocks, from a loop that writes them itself.

    Attributes:
        block: where they are to be; None where they need not be kept.
    """

    block: Block | None

    @property
    def left(self) -> int:
        """Number of ticks until it has to read one, the last of them."""

    def advance(self, ticks: int) -> None:
        """Takes ticks that are in the block."""

    def by_machine_code(self) -> None:
        """Takes note that machine code runs the ticks."""


class DrivenArm(Protocol):
    """The part of an arm that the loop uses.

    Attributes:
        diverged: whether alarms are to be checked now.
    """

    diverged: bool


class Driven(Protocol):
    """The plant that the loop steps, local or remote."""

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
    """The sensing of the controller's inputs."""

    def read(self) -> None:
        """Writes the measurement into the controller's inputs.

        Raises:
            LinkError: there is none any more.
        """
