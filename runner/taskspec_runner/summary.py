"""What a run came to, as data: the same file and seed give the same bytes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from taskspec.compiler import Program
from taskspec.program.machine import Transition
from taskspec_runner.history import History
from taskspec_runner.loop import DONE, Outcome
from taskspec_runner.metrics import metrics, peaks
from taskspec_runner.verdict import Judged

EXIT_GOOD, EXIT_MISSED, EXIT_STOPPED, EXIT_INTERRUPTED = 0, 1, 4, 130

#: Reason of a run that the user has broken off.
INTERRUPTED = "interrupted"


def exit_code(outcome: Outcome, judged: Sequence[Judged]) -> int:
    """0 well; 1 expectations missed or ended in `fail`; 4 safety stop; 130 interrupted."""
    if outcome.reason == INTERRUPTED:
        return EXIT_INTERRUPTED
    if outcome.status == "stopped":
        return EXIT_STOPPED
    good = outcome.status == DONE and all(j.passed for j in judged)
    return EXIT_GOOD if good else EXIT_MISSED


def summarise(
    program: Program,
    transitions: Sequence[Transition],
    outcome: Outcome,
    history: History,
    judged: Sequence[Judged],
    seed: int,
) -> dict[str, Any]:
    """The content of `summary.json`, in SI units.

    It holds nothing of the clock on the wall, so that it can be compared byte by byte.
    """
    context = program.context
    task, robot = context.loaded.task, context.robot
    return {
        "task": task.name,
        "about": task.about,
        "status": outcome.status,
        "exit_code": exit_code(outcome, judged),
        "seed": seed,
        "ending": {
            "reason": outcome.reason,
            "text": outcome.text,
            "stage": outcome.stage,
            "clock": outcome.clock,
        },
        "duration": outcome.clock,
        "ticks": outcome.ticks,
        "period": context.period,
        "law": task.law.kind,
        "stages": _visits(program, transitions, outcome),
        "expectations": [_expectation(j) for j in judged],
        "metrics": metrics(history, {s.name: s.axes for s in program.stages}),
        "peaks": peaks(history, [s.name for s in program.stages]),
        "limits": {k: v for k, v in task.limits.model_dump().items() if v is not None},
        "stage_limits": {
            s.name: {k: v for k, v in s.limits.model_dump().items() if v is not None}
            for s in program.stages
        },
        "joint_limits": robot.torque_limit.tolist(),
        "robot": {"name": robot.name, "joints": list(robot.joint_names), "source": robot.source},
        "objects": list(task.world),
    }


def _visits(
    program: Program, transitions: Sequence[Transition], outcome: Outcome
) -> list[dict[str, Any]]:
    """Every visit of a stage, and what ended it."""
    stages = {stage.name: stage for stage in program.stages}
    ends = list(transitions)
    if outcome.reason == INTERRUPTED:
        ends.append(
            Transition(outcome.clock, outcome.stage, "stop", INTERRUPTED, outcome.text, 0.0, "")
        )
    visits, start = [], 0.0
    for end in ends:
        stage = stages[end.stage]
        visits.append(
            {
                "name": end.stage,
                "start": start,
                "end": end.clock,
                "law": stage.law.kind,
                "frame": stage.frame.name,
                "ended_by": {
                    "kind": end.kind,
                    "name": end.name,
                    "text": end.text,
                    "value": end.value,
                    "to": end.to,
                },
            }
        )
        start = end.clock
    return visits


def _expectation(judged: Judged) -> dict[str, Any]:
    return {
        "text": judged.text,
        "passed": judged.passed,
        "explanation": judged.explanation,
        "measured": [{"name": m.name, "value": m.value, "unit": m.unit} for m in judged.measured],
        "signals": list(judged.signals),
        "stage": judged.stage,
        "signal": judged.signal,
        "band": list(judged.band) if judged.band else None,
    }
