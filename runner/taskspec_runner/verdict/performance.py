"""Metrics of a run, stage by stage, that `summary.json` has beside its verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from taskspec.explain import RestValue, rest_values
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.stage_solver import SolverCounts
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec_runner.record.history import History
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.limit_effects import limit_effects
from taskspec_runner.verdict.metrics import metrics, peaks, set_points
from taskspec_runner.verdict.response import contact_losses, responses


def solver_counts(machine: Machine) -> dict[str, SolverCounts]:
    """Counts of the solver for each stage that keeps its limits by a program."""
    return {r.stage.name: r.solver.counts for r in machine.runners if r.solver is not None}


def performance(
    program: Program,
    history: History,
    judged: Sequence[Judged],
    solver: Mapping[str, SolverCounts],
) -> dict[str, Any]:
    """Tracking, responses, contact, limits and solver of each visited stage.

    Args:
        program: that ran.
        history: what it recorded.
        judged: its expectations.
        solver: what it did, by stage.

    Returns:
        `metrics`, `responses`, `contact`, `given_up`, `solver`, `rest_values` and `peaks`, each by
        stage [SI].
    """
    period = program.context.period
    closed = {stage.name: rest_values(program, stage) for stage in program.stages}
    efforts = {stage.name: _efforts(stage, history) for stage in program.stages}
    rests = {name: _targets(closed[name]) | dict.fromkeys(efforts[name]) for name in efforts}
    allowed = {(j.stage, j.signal): j.band for j in judged if j.stage and j.signal and j.band}
    return {
        "metrics": metrics(history, {s.name: s.plan.axes for s in program.stages}),
        "responses": responses(history, rests, period, allowed),
        "contact": contact_losses(history, [name for name in efforts if efforts[name]], period),
        "given_up": limit_effects(history, program.stages),
        "solver": {
            name: {"ticks": int(history.window(name).sum()), **asdict(counts)}
            for name, counts in solver.items()
            if history.window(name).any()
        },
        "rest_values": {
            name: {signal: asdict(at) for signal, at in of_stage.items()}
            for name, of_stage in closed.items()
        },
        "peaks": peaks(history, [s.name for s in program.stages]),
    }


def _targets(closed: Mapping[str, RestValue]) -> dict[str, float | None]:
    """The values at rest of signals that do not come to rest at zero [SI]."""
    return {name: at.value for name, at in closed.items() if at.value}


def _efforts(stage: CompiledStage, history: History) -> list[str]:
    """Signals of a stage with a set point of force or moment."""
    axes = [axis for axis, plan in stage.plan.plans.items() if plan.set_point]
    names = [f"{'torque' if axis.startswith('r') else 'force'}.{axis}" for axis in axes]
    active = set(stage.plan.active)
    return names + [n for n in set_points(history.columns) if n.rpartition(".")[0] in active]
