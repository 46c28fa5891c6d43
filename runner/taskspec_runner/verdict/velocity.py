"""Where a run's controller had the velocity of joints from, and how far that was off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taskspec.program.program import Program
from taskspec.text.units import show
from taskspec_runner.record.history import History

_NAMES = {"differences": "differences of positions", "filter": "filtered differences",
          "observer": "an observer"}  # fmt: skip


def velocity_block(program: Program, history: History) -> dict[str, Any]:
    """The entry of a summary, `velocity`; empty where velocities are measured.

    Where the log has what is true, too, `off` [rad/s, m/s] is the greatest error, `unit` one to
    show it in, and `joint` its number.
    """
    robot, source = program.context.robot, program.context.loaded.task.control.velocity
    if source.measured:
        return {}
    kind = "observer" if source.observer is not None else "filter"
    data: dict[str, Any] = {"source": kind if source.corner is not None else "differences"}
    if source.corner is not None:
        data["corner"] = source.corner
    names = [f"joint.{i + 1}.velocity" for i in range(robot.n)]
    beside = [f"{name}.measured" for name in names]
    if len(history) and all(name in history.columns for name in (*names, *beside)):
        columns = history.columns
        off = [
            float(np.nanmax(np.abs(columns[own] - columns[true]), initial=0.0))
            for own, true in zip(beside, names, strict=True)
        ]
        worst = int(np.argmax(off))
        unit = "mrad/s" if robot.hinges[worst] else "mm/s"
        data |= {"off": off[worst], "unit": unit, "joint": worst + 1}
    return {"velocity": data}


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """Which estimate was used, and how far it was off at most."""
    data = summary.get("velocity")
    if not data:
        return
    text = f"velocity of joints from {_NAMES[data['source']]}"
    if "corner" in data:
        text += f" of {show(data['corner'], 'Hz', 3)}"
    if "off" in data:
        off = show(data["off"], data["unit"], 3)
        text += f": off by at most {off} (joint {data['joint']})"
    yield text
