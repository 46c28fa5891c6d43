"""One world of a sweep: run without a log, and judged as a run is."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from taskspec.program.program import Program
from taskspec.program.worlds import World, deviations
from taskspec.spec import Task
from taskspec_runner.errors import InputError
from taskspec_runner.loop.fixed_step import DONE, Outcome
from taskspec_runner.trial.trial import trial
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.metrics import peaks

Row = dict[str, Any]
"""A row of the table, by column; what is not a finite number is None."""

BROKEN = "broken"


def run_world(program: Program, index: int, world: World, loop: str | None = None) -> Row:
    """Runs a world to its end and judges it.

    Args:
        program: of the task.
        index: of the world in its sweep.
        world: that the plant is.
        loop: `native` or `python`, None for what there is.

    Returns:
        Its row. What goes wrong within is the row's `reason`.
    """
    row: Row = {
        "world": index,
        "label": world.label,
        "seed": world.seed,
        "number": world.number,
        "draws": json.dumps(dict(world.draws)),
    }
    try:
        differ = deviations(program.context, world)
        row |= {each.name: _finite(each.true) for each in differ if each.true is not None}
        return row | _ran(program, world, loop)
    except InputError as error:
        return row | _broken(str(error))
    except Exception as error:
        return row | _broken(f"{type(error).__name__}: {error}")


def _ran(program: Program, world: World, loop: str | None) -> Row:
    made = trial(program, world, loop)
    outcome, judged, faults = made.outcome, made.judged, made.faults
    missed = any(each.missed for each in judged) or faults
    verdict = "passed" if made.good else "missed" if outcome.status == DONE and missed else ""
    keys = expectation_keys(program.context.loaded.task)
    largest = peaks(made.history, [stage.name for stage in program.stages])
    return {
        "success": made.good,
        "verdict": verdict or outcome.status,
        "status": outcome.status,
        "reason": outcome.reason,
        "stage": outcome.stage,
        "text": outcome.text,
        "duration": outcome.clock,
        "ticks": outcome.ticks,
        **_expectations(dict(zip(keys, judged, strict=True)), outcome),
        "margin": _least(judged),
        "findings": "; ".join(each.line for each in faults) or None,
        **{
            f"peak {name}": _finite(max((p[name] for p in largest.values()), default=math.nan))
            for name in ("force", "torque", "speed")
        },
    }


def _expectations(judged: Mapping[str, Judged], outcome: Outcome) -> Row:
    """Whether each was met: None if it held so far in a run that did not come to its end."""
    found: Row = {}
    for key, each in judged.items():
        known = each.missed or outcome.status == DONE
        found[f"expect {key}"] = each.passed if known else None
        found[f"margin {key}"] = margin_of(each)
    return found


def expectation_keys(task: Task) -> tuple[str, ...]:
    """What the table calls the expectations of a task: by name, or their number from 1."""
    return tuple(each.name or str(number) for number, each in enumerate(task.expect, 1))


def margin_of(judged: Judged) -> float | None:
    """The least share of what an expectation allows that was left; negative where it was missed."""
    left = [m.left for m in judged.margins if m.left is not None and math.isfinite(m.left)]
    return min(left, default=None)


def _least(judged: Sequence[Judged]) -> float | None:
    found = [margin for each in judged if (margin := margin_of(each)) is not None]
    return min(found, default=None)


def broken_row(index: int, reason: str) -> Row:
    """The row of a world that could not be run."""
    row: Row = {"world": index, "label": "", "seed": None, "number": None, "draws": "{}"}
    return row | _broken(reason)


def _broken(reason: str) -> Row:
    return {"success": False, "verdict": BROKEN, "status": BROKEN, "reason": BROKEN, "text": reason}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
