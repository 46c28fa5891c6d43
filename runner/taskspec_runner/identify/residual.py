"""One channel of a log beside what a world makes of it, and the noise that the rest is held to."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.sensor import SensorModel
from taskspec.spec import Task
from taskspec.spec.robot import Noise
from taskspec_runner.identify.fit import WRENCH, Channels
from taskspec_runner.identify.model import LogModel
from taskspec_runner.identify.noise import ChannelNoise
from taskspec_runner.record.history import History

Vector = NDArray[np.float64]

#: Of a channel, what is left of it by arithmetic alone.
_ROUNDED = 1e-6
#: Residuals that are so many times as large as their noise are not noise alone.
_SURPRISING = 1.25


@dataclass(frozen=True, eq=False)
class ChannelResidual:
    """What the identified world does not explain of one channel of a log.

    Attributes:
        log: name of the log.
        history: its ticks.
        channel: such as `force.z`, `joint.3.torque`.
        unit: SI.
        ticks: (n,) rows of the log that count.
        measured, predicted: (n,) in these, signed as the log's column [SI].
        white: rms of what is new in the residual from tick to tick [SI].
        explained: rms that the noise of the sensor has there, as the file declares it, or else as
            `white` says, after the filter [SI].
        declared: whether the file declares it.
    """

    log: str
    history: History
    channel: str
    unit: str
    ticks: NDArray[np.int64]
    measured: Vector
    predicted: Vector
    white: float
    explained: float
    declared: bool

    @property
    def left(self) -> Vector:
        """(n,) what is not explained [SI]."""
        return self.measured - self.predicted

    @cached_property
    def rms(self) -> float:
        """Of what is left [SI]."""
        return float(np.sqrt(np.mean(self.left**2)))

    @cached_property
    def size(self) -> float:
        """Rms of the channel itself [SI]."""
        return float(np.sqrt(np.mean(self.measured**2)))

    @cached_property
    def _largest(self) -> int:
        return int(np.abs(self.measured).argmax())

    @property
    def peak(self) -> float:
        """What was measured where it was largest [SI]."""
        return float(self.measured[self._largest])

    @property
    def at_peak(self) -> float:
        """What is predicted there [SI]."""
        return float(self.predicted[self._largest])

    @property
    def share(self) -> float:
        """What is left, rms, as a share of the peak; infinite without one."""
        return self.rms / abs(self.peak) if self.peak else math.inf

    @property
    def excess(self) -> float:
        """How many times as large as explained it is."""
        return self.rms / self.explained if self.explained > 0 else 1.0

    @property
    def exact(self) -> bool:
        """Whether nothing but rounding is left."""
        return self.rms <= _ROUNDED * self.size

    @property
    def surprising(self) -> bool:
        """Whether noise does not explain it."""
        return self.excess > _SURPRISING and not self.exact

    def as_data(self) -> dict[str, Any]:
        """For `--format json`, in SI."""
        return {"log": self.log, "channel": self.channel, "rms": self.rms, "white": self.white,
                "explained": self.explained, "size": self.size, "peak": self.peak,
                "predicted": self.at_peak, "share": self.share, "unit": self.unit}  # fmt: skip


def residuals(
    task: Task, log: LogModel, block: Channels, noises: Sequence[ChannelNoise | None]
) -> Iterator[ChannelResidual]:
    """The channels of a log that have values.

    Args:
        task: the world that was identified.
        log: with its name and ticks.
        block: what it has, and what the world makes of it.
        noises: of its channels.
    """
    for i, noise in enumerate(noises):
        if noise is None:
            continue
        there, wrench = block.present[:, i], block.of == WRENCH
        # A block has what the environment exerts, from the second tick on; a log has the reaction.
        sign, first = (-1.0, 1) if wrench else (1.0, 0)
        declared = _declared(task, block.unit(i)) if wrench else 0.0
        yield ChannelResidual(
            log.name, log.history, block.name(i), block.unit(i), block.rows[there] + first,
            sign * block.measured[there, i], sign * block.predicted[there, i], noise.deviation,
            _explained(task, log.period, declared, noise) if wrench else noise.deviation,
            declared > 0,
        )  # fmt: skip


def _declared(task: Task, unit: str) -> float:
    """Standard deviation of the sensor's noise, as the file has it; 0 where it has none [SI]."""
    noise = task.robot.sensor.noise or Noise()
    return {"N": noise.force, "N*m": noise.torque}[unit]


def _explained(task: Task, period: float, declared: float, found: ChannelNoise) -> float:
    """Rms of the sensor's noise in a reading, after the filter [SI]."""
    pole = SensorModel.of(task.robot.sensor, period).pole
    # Noise passes the filter: x[k] = b x[k-1] + (1 - b) w[k].
    if declared > 0:
        return float(declared * ((1 - pole) / (1 + pole)) ** 0.5)
    return float(found.deviation / (1 - pole**2) ** 0.5)


def surprises(found: Sequence[ChannelResidual]) -> Iterator[str]:
    """A sentence of each log that has more in it than the identified world and noise."""
    for log in dict.fromkeys(each.log for each in found):
        own = [each for each in found if each.log == log and each.surprising]
        if not own:
            continue
        parts = [
            f"{each.channel} {each.rms:.3g} {each.unit}, {each.excess:.3g} times the noise"
            for each in sorted(own, key=lambda each: -each.excess)
        ]
        yield (
            f"{log} has more than the identified values and the sensor's noise explain, "
            f"so the intervals are too narrow: {'; '.join(parts)}. Something else acts (another "
            "surface, a cable, a tool that bends), or robot.sensor.noise is not the sensor's"
        )
