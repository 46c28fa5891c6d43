"""How far a run has come off the equations that hold exactly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taskspec.program.program import Program
from taskspec.text.units import LENGTH, scaled
from taskspec_runner.record.history import History


def drift(program: Program, history: History) -> dict[str, Any]:
    """The entry of a summary, `drift`; empty for a task without exact equations.

    By the equation's name the greatest distance from it [m, rad], when that was [s], and a text.

    Args:
        program: that ran.
        history: what it recorded.
    """
    columns, found = history.columns, {}
    for name, declared in program.context.loaded.task.equations.items():
        column = f"{name}.gap"
        if not (declared.exact and len(history) and column in columns):
            continue
        sizes = np.where(np.isfinite(columns[column]), np.abs(columns[column]), 0.0)
        i = int(np.argmax(sizes))
        text = scaled(float(sizes[i]), LENGTH.on(rotation=declared.equation.angular), 2)
        found[name] = {"most": float(sizes[i]), "text": text, "clock": float(columns["clock"][i])}
    return {"drift": found} if found else {}


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """What was the most of each exact equation."""
    for name, most in summary.get("drift", {}).items():
        yield f"drift from {name}: {most['text']} at most, at {most['clock']:.3f} s"
