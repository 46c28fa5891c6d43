"""Measures of a signal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def rms(values: NDArray[np.float64]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
