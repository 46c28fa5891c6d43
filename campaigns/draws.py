"""Draws of a random task."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


class Draws:
    """Draws of the task that a key stands for: the same key gives the same ones.

    Attributes:
        rng: the generator behind them.
    """

    def __init__(self, *key: int) -> None:
        self.rng = np.random.default_rng(key)

    def between(self, low: float, high: float) -> float:
        """Uniform from one number to another."""
        return float(self.rng.uniform(low, high))

    def spread(self, low: float, high: float) -> float:
        """Uniform in the logarithm."""
        return math.exp(self.between(math.log(low), math.log(high)))

    def chance(self, p: float) -> bool:
        """Whether something of the probability p comes about."""
        return bool(self.rng.random() < p)

    def one_of(self, values: Sequence[str], shares: Sequence[float] | None = None) -> str:
        """One of several words, each as often as the others or with its share."""
        p = None if shares is None else np.array(shares) / sum(shares)
        return str(values[int(self.rng.choice(len(values), p=p))])
