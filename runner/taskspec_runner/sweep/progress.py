"""How far a sweep is, in words."""

from __future__ import annotations

from taskspec_runner.sweep.session import SweepGlimpse


def describe(glimpse: SweepGlimpse) -> str:
    """A glimpse in one line."""
    share = 100 * glimpse.good / glimpse.done if glimpse.done else 0.0
    text = f"{glimpse.done} of {glimpse.of} worlds, {share:.1f} % well"
    if glimpse.done == glimpse.of:
        return f"{text}; the runs that are kept and the page are being made"
    if not glimpse.rate:
        return f"{glimpse.done} of {glimpse.of} worlds, more are running"
    return f"{text}, {glimpse.rate:.1f} a second, {_span(glimpse.left)} left"


def _span(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
