"""Sweeps that nobody has run: rows as they would be, in a moment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from short_tasks import TAP

from taskspec.spec import load_text
from taskspec_runner.sweep.result import SweepResult
from taskspec_runner.sweep.summary import summarise
from taskspec_runner.sweep.worlds import RANDOM

#: Worlds fail above this stiffness [N/m].
BOUND = 20e3
#: Worlds that are stopped, and that broke.
STOPPED, BROKE = 5, 7
STIFFNESS, ROLL = "world.wall.stiffness", "world.wall.rpy.roll"
VARY = """\
vary:
  world.wall.stiffness: 5..30 kN/m
  world.wall.rpy: [+- 3 deg, 0, 0]
"""
NAMED = f"{TAP}{VARY}"


def rows_of(count: int) -> list[dict[str, Any]]:
    """Rows of worlds that fail above a stiffness, whatever their roll is."""
    values = np.random.default_rng(3)
    found = []
    for i in range(count):
        stiffness, roll = 5e3 + 25e3 * values.random(), 0.05 * (2 * values.random() - 1)
        good = stiffness < BOUND
        margin = (BOUND - stiffness) / BOUND
        row: dict[str, Any] = {
            "world": i,
            "label": f"world {i}",
            "seed": 4,
            "number": i,
            "draws": "{}",
            STIFFNESS: stiffness,
            ROLL: roll,
        }
        if i == BROKE:
            row |= {"success": False, "verdict": "broken", "status": "broken", "reason": "broken",
                    "text": "ValueError: <script>"}  # fmt: skip
            found.append(row)
            continue
        verdict = "stopped" if i == STOPPED else "passed" if good else "missed"
        row |= {
            "success": verdict == "passed",
            "verdict": verdict,
            "status": "stopped" if i == STOPPED else "done",
            "reason": "force" if i == STOPPED else "end",
            "stage": "hold",
            "text": "limit on force: 4 N, measured 7 N" if i == STOPPED else "time is over",
            "duration": 0.5,
            "margin": margin,
            "findings": None,
            "peak force": 4 + stiffness / 1e4,
            "peak torque": 0.0,
            "peak speed": 0.02,
        }
        for key in "1234":
            row |= {f"expect {key}": good or key != "2", f"margin {key}": margin}
        found.append(row)
    return found


def sweep_of(folder: Path, count: int = 60, *, text: str = NAMED) -> SweepResult:
    """A sweep that is over, as its folder has it."""
    (folder / "task.yaml").write_text(text, encoding="utf-8")
    task = load_text(text, "task.yaml").task
    rows = tuple(rows_of(count))
    return SweepResult(task, folder, rows, summarise(task, rows))


def said(kind: str = RANDOM, **changed: Any) -> dict[str, Any]:
    """What `sweep.json` says of such a sweep from its start."""
    return {
        "file": "my tap.yaml",
        "overrides": {},
        "force": False,
        "worlds": {"kind": kind, "seed": 4, "count": 60},
        "versions": {"taskspec": "0.1.0"},
        **changed,
    }
