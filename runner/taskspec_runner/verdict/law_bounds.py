"""What laws promise of signals: tanks of what is in them and leaves them, layers of errors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from taskspec.laws.sliding import error_bound, sliding_axes
from taskspec.program.plan import StagePlan
from taskspec.program.program import Program


def law_bounds(program: Program) -> dict[str, Any]:
    """The entry of a summary, `law_bounds`: by stage and signal [SI]; empty without any."""
    stages = {stage.name: dict(_bounds(stage.plan)) for stage in program.stages}
    found = {name: bounds for name, bounds in stages.items() if bounds}
    return {"law_bounds": found} if found else {}


def _bounds(stage: StagePlan) -> Iterator[tuple[str, float]]:
    tank = stage.law.tank
    if tank is not None:
        yield "tank.energy", tank.energy
        if tank.power is not None:
            yield "tank.power", tank.power
    if stage.law.sliding is not None and stage.joint_path is None:
        for axis in sliding_axes(stage.gains):
            yield f"error.{axis}", error_bound(stage.gains, axis)
