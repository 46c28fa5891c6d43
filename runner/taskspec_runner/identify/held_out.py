"""What an identified world predicts of logs that it was not identified from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec_runner.identify.fit import Fit, LogProblem
from taskspec_runner.identify.model import LogModel


@dataclass(frozen=True, slots=True)
class Prediction:
    """One channel of a log, beside what the identified world predicts for the log's motion.

    Attributes:
        log: name of the log.
        channel: such as `force.z`, `joint.3.torque`.
        rms: of the difference [SI].
        peak: what was measured where it was largest, signed as the log's reading [SI].
        predicted: what is predicted there [SI].
        unit: SI.
    """

    log: str
    channel: str
    rms: float
    peak: float
    predicted: float
    unit: str

    @property
    def share(self) -> float:
        """The rms difference, as a share of the peak."""
        return self.rms / abs(self.peak)

    def as_data(self) -> dict[str, Any]:
        """For `--format json`, in SI."""
        return {"log": self.log, "channel": self.channel, "rms": self.rms, "peak": self.peak,
                "predicted": self.predicted, "share": self.share, "unit": self.unit}  # fmt: skip


def predictions(found: Fit, log: LogModel) -> Iterator[Prediction]:
    """What the world of a fit predicts of a log: its readings, for the motion that it has.

    Zeros of the log's own tares, which no other log tells, are those that leave least.
    """
    of = found.problem
    problem = LogProblem(of.program, [log], of.parameters)
    count = len(of.continuous)
    values = np.concatenate([found.values[:count], np.zeros(len(problem.zeros))])
    delay = None if found.delay is None else found.delay * of.period
    own = np.arange(len(values)) >= count
    for block in problem.blocks(values, delay, by=own):
        predicted, left = block.predicted, block.left
        if len(problem.zeros) and len(block.slopes):
            zero = np.linalg.lstsq(
                np.where(block.present, block.slopes, 0.0).reshape(len(problem.zeros), -1).T,
                left.ravel(), rcond=None,
            )[0]  # fmt: skip
            moved = np.tensordot(zero, block.slopes, 1)
            predicted, left = predicted + moved, np.where(block.present, left - moved, 0.0)
        for i in range(block.measured.shape[1]):
            rows = np.flatnonzero(block.present[:, i])
            if not len(rows) or not block.measured[rows, i].any():
                continue
            at = rows[np.abs(block.measured[rows, i]).argmax()]
            yield Prediction(
                log.name, block.name(i), float(np.sqrt(np.mean(left[rows, i] ** 2))),
                float(block.measured[at, i]), float(predicted[at, i]), block.unit(i),
            )  # fmt: skip
