"""One task under several laws: run side by side, measured alike, drawn over each other."""

from __future__ import annotations

from taskspec_runner.compare.attempt import Attempt, attempt
from taskspec_runner.compare.comparison import Comparison, read_comparison
from taskspec_runner.compare.folder import PAGE, PICTURE, open_comparison
from taskspec_runner.compare.session import run_attempts
from taskspec_runner.compare.summary import summarise
from taskspec_runner.record.names import COMPARISON

__all__ = [
    "COMPARISON",
    "PAGE",
    "PICTURE",
    "Attempt",
    "Comparison",
    "attempt",
    "open_comparison",
    "read_comparison",
    "run_attempts",
    "summarise",
]
