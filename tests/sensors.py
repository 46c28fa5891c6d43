"""The force sensor's equations once more, on arrays and a ring: a second implementation."""

from __future__ import annotations

import numpy as np


class RunningSensor:
    """A sensor tick by tick."""

    def __init__(self, model, rest):
        """A sensor that has seen the wrench `rest` (m,) for long."""
        self._model = model
        self._low, self._held = rest.copy(), rest.copy()
        self._line = np.tile(rest, (model.delay_ticks, 1))
        self._tick = 0

    def step(self, wrench):
        """y[k] (m,) for w[k] (m,), k = 0, 1, ..."""
        model, k = self._model, self._tick
        self._tick = k + 1
        value = wrench
        if model.pole:
            self._low = value = model.pole * self._low + (1 - model.pole) * wrench
        if model.hold_ticks > 1:
            if k % model.hold_ticks == 0:
                self._held = value
            value = self._held
        if model.delay_ticks:
            oldest = k % model.delay_ticks
            late = self._line[oldest].copy()
            self._line[oldest] = value
            return late
        return value
