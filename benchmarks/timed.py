"""How long a function takes, for the benchmarks."""

from __future__ import annotations

import time
from collections.abc import Callable


def seconds(function: Callable[[], object], steps: int) -> float:
    """Mean time of a call over `steps` of them [s]."""
    begin = time.perf_counter()
    for _ in range(steps):
        function()
    return (time.perf_counter() - begin) / steps
