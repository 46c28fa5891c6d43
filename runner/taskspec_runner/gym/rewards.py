"""Rewards: said by the file, or by a function, or by the margins of the file's expectations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.spec.reward import Reward
from taskspec_runner.errors import InputError
from taskspec_runner.verdict.judged import Judged

#: A user's own: of what is observed, by its names [SI], and of what a step says beside.
RewardFunction = Callable[[Mapping[str, float], Mapping[str, Any]], float]

PASSED, MISSED, FAILED, STOPPED = "passed", "missed", "failed", "stopped"


@dataclass(frozen=True, slots=True)
class StepEnd:
    """What a reward follows from.

    Attributes:
        rates: (ticks,) what the file rewards in a second, NaN where it has no value.
        period: of a tick [s].
        verdict: of an episode that is over: passed, missed, failed or stopped; else empty.
        judged: the expectations, once it is over.
        observed: what is observed, by its names.
        info: of the step.
    """

    rates: NDArray[np.float64]
    period: float
    verdict: str
    judged: tuple[Judged, ...]
    observed: Callable[[], Mapping[str, float]]
    info: Mapping[str, Any]


class Rewarding(Protocol):
    """Whatever gives rewards."""

    def __call__(self, step: StepEnd) -> float:
        """The reward of a step."""


class OfFile:
    """What `reward` of the file says: its rate over the ticks, and the term of the end."""

    def __init__(self, reward: Reward) -> None:
        self._reward = reward

    def __call__(self, step: StepEnd) -> float:
        """The sum of rate times period; a tick at which it has no value earns nothing."""
        earned = float(np.nansum(step.rates)) * step.period
        return earned + (self._reward.at_end(step.verdict) if step.verdict else 0.0)


class OfMargins:
    """At the end alone: how far inside its bounds the run stayed, from -1 to 1.

    That is the least margin of its expectations, each a share of what it allows; 1 where nothing
    is expected. A run that did not come to its end has -1.
    """

    def __call__(self, step: StepEnd) -> float:
        """0 but for the last step."""
        if not step.verdict:
            return 0.0
        if step.verdict in (FAILED, STOPPED):
            return -1.0
        margins = [m.left for each in step.judged for m in each.margins if m.left is not None]
        least = min(margins, default=1.0 if step.verdict == PASSED else -1.0)
        return float(np.clip(least, -1.0, 1.0 if step.verdict == PASSED else 0.0))


class OfFunction:
    """What a function says of what is observed."""

    def __init__(self, function: RewardFunction) -> None:
        self._function = function

    def __call__(self, step: StepEnd) -> float:
        """Its value."""
        found = self._function(step.observed(), step.info)
        try:
            return float(found)
        except (TypeError, ValueError) as error:
            raise InputError(f"reward: the function returned {found!r}, not a number") from error
