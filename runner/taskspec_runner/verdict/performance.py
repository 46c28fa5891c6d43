"""Metrics of a run, stage by stage, that `summary.json` has beside its verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from taskspec.explain import RestValue, rest_values
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.stage_solver import SolverCounts
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.spec.params import slots_of
from taskspec_runner.record.history import History
from taskspec_runner.record.named import param_column
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
    # Closed forms are those of the params as the file declares them.
    settled = {} if _was_set(program, history) else {n: _targets(at) for n, at in closed.items()}
    rests = {name: settled.get(name, {}) | dict.fromkeys(efforts[name]) for name in efforts}
    uses = dict(_uses(program))
    allowed = {(j.stage, j.signal): j.band for j in judged if j.stage and j.signal and j.band}
    return {
        "metrics": metrics(history, {s.name: s.plan.axes for s in program.stages}),
        "responses": responses(history, rests, period, allowed, uses),
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


def _was_set(program: Program, history: History) -> bool:
    """Whether a param was ever something else than what the file declares."""
    live = program.context.loaded.task.live.items()
    columns = [(history.columns.get(param_column(name)), param.value) for name, param in live]
    return any(bool((column != value).any()) for column, value in columns if column is not None)


def _uses(program: Program) -> Iterator[tuple[tuple[str, str], list[str]]]:
    """The columns of live params that a set point follows from, by stage and signal."""
    params = program.context.loaded.task.params
    for stage in program.stages:
        for on, entry in stage.plan.spec.axes.items():
            wanted = None if entry.set_point is None else entry.set_point.wanted
            if wanted is None:
                continue
            columns = [param_column(name) for name in slots_of(params, wanted.tree)]
            for signal in (f"force.{on}", f"torque.{on}", f"{on}.force", f"{on}.torque"):
                yield (stage.name, signal), columns


def _targets(closed: Mapping[str, RestValue]) -> dict[str, float | None]:
    """The values at rest of signals that do not come to rest at zero [SI]."""
    return {name: at.value for name, at in closed.items() if at.value}


def _efforts(stage: CompiledStage, history: History) -> list[str]:
    """Signals of a stage with a set point of force or moment."""
    axes = [axis for axis, plan in stage.plan.plans.items() if plan.set_point]
    names = [f"{'torque' if axis.startswith('r') else 'force'}.{axis}" for axis in axes]
    active = set(stage.plan.active)
    return names + [n for n in set_points(history.columns) if n.rpartition(".")[0] in active]
