"""What an identified world predicts of logs that it was not identified from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from taskspec_runner.identify.fit import Fit, LogProblem, noises_of
from taskspec_runner.identify.model import LogModel
from taskspec_runner.identify.residual import ChannelResidual, residuals


def predictions(found: Fit, log: LogModel) -> Iterator[ChannelResidual]:
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
        if len(problem.zeros) and len(block.slopes):
            zero = np.linalg.lstsq(
                np.where(block.present, block.slopes, 0.0).reshape(len(problem.zeros), -1).T,
                block.left.ravel(), rcond=None,
            )[0]  # fmt: skip
            moved = block.predicted + np.tensordot(zero, block.slopes, 1)
            block = replace(block, predicted=moved)
        noises = noises_of((block,))[0]
        for each in residuals(found.task, log, block, noises):
            if each.peak:
                yield each
