"""The summary of a run as data: the same file and seed give the same bytes."""

from __future__ import annotations

import re
import signal
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program import events
from taskspec.program.execution.stage_solver import SolverCounts
from taskspec.program.execution.transition import FAIL, Transition
from taskspec.program.program import Program
from taskspec.program.stages.protected import PROTECTION, dimension_watched
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.worlds import World, deviations
from taskspec.robot import RobotModel
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.spec import Limits
from taskspec.text.units import LENGTH, VELOCITY, show
from taskspec_runner import exit_codes
from taskspec_runner.loop.fixed_step import DONE, UNDECIDED, Outcome
from taskspec_runner.loop.interrupt import BY_SIGNAL
from taskspec_runner.record.fault_time import FaultTime
from taskspec_runner.record.history import History
from taskspec_runner.verdict.diagnosed import diagnosed
from taskspec_runner.verdict.drift import drift
from taskspec_runner.verdict.energy import energy_block
from taskspec_runner.verdict.estimated import estimated
from taskspec_runner.verdict.findings import findings
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.law_bounds import law_bounds
from taskspec_runner.verdict.payload import payload_block
from taskspec_runner.verdict.performance import performance
from taskspec_runner.verdict.protected import protected
from taskspec_runner.verdict.run_finding import RunFinding
from taskspec_runner.verdict.slips import slip_block
from taskspec_runner.verdict.torque_steps import largest_change, largest_step
from taskspec_runner.verdict.velocity import velocity_block

_JOINT = re.compile(r"\bjoint (\d+) ")
_OF_TRAVEL, _ATTEMPTS = " of travel", "; stage "


def reason_of(number: int) -> str:
    """Why a run ended that a signal has broken off."""
    return "interrupted" if number == signal.SIGINT else "terminated"


def exit_code(
    outcome: Outcome,
    judged: Sequence[Judged],
    by_signal: int = 0,
    found: Sequence[RunFinding] = (),
) -> int:
    """The exit code of a run; 128 + n where signal n has broken it off."""
    if by_signal:
        return BY_SIGNAL + by_signal
    if outcome.status == "stopped":
        return exit_codes.STOPPED
    if outcome.status not in (DONE, UNDECIDED):
        return exit_codes.FAILED
    if any(j.missed for j in judged) or not all(each.allowed for each in found):
        return exit_codes.MISSED
    undecided = outcome.status == UNDECIDED or any(j.passed is None for j in judged)
    return exit_codes.UNDECIDED if undecided else exit_codes.WELL


@dataclass(frozen=True, slots=True)
class Simulated:
    """The result of a simulation.

    Attributes:
        outcome: how it ended.
        transitions: what ended each stage.
        solver_counts: what the solver did, by stage.
        by_signal: number of the signal that has broken it off, or 0.
        faults: when each fault of `truth` was.
    """

    outcome: Outcome
    transitions: Sequence[Transition]
    solver_counts: Mapping[str, SolverCounts]
    by_signal: int = 0
    faults: Sequence[FaultTime] = ()

    def as_logged(self, history: History, period: float) -> Simulated:
        """The same of a run that was broken off, which came as far as its log has it."""
        ticks, was = len(history), self.outcome
        stage = str(history.stages[-1]) if ticks else was.stage
        logged = Outcome(was.status, was.reason, was.text, stage, ticks * period, ticks)
        return replace(self, outcome=logged)


def summarise(
    program: Program,
    simulated: Simulated,
    history: History,
    judged: Sequence[Judged],
    world: World,
) -> dict[str, Any]:
    """The content of `summary.json`, in SI units.

    It holds nothing of the clock on the wall, so that it can be compared byte by byte.
    """
    context = program.context
    task, robot, drives = context.loaded.task, context.robot, context.drives
    outcome, found = simulated.outcome, findings(program, history, world.task)
    visits = _visits(program, simulated)
    # The last visit is the one in which the run ended, and says more about it.
    text = visits[-1]["ended_by"]["text"] if visits else outcome.text
    return {
        "task": task.name,
        "about": task.about,
        "status": outcome.status,
        "exit_code": exit_code(outcome, judged, simulated.by_signal, found),
        "seed": world.seed,
        "world": world.as_data()
        | {
            "differs": [
                {"path": d.name, "nominal": d.nominal, "true": d.true, "written": list(d.written)}
                for d in deviations(context, world)
            ]
        }
        # What has no faults says nothing of them.
        | ({"faults": [each.as_data() for each in simulated.faults]} if simulated.faults else {}),
        "ending": {
            "reason": outcome.reason,
            "text": text,
            "stage": outcome.stage,
            "clock": outcome.clock,
        },
        "duration": outcome.clock,
        "ticks": outcome.ticks,
        "period": context.period,
        "law": task.law.kind,
        "stages": visits,
        **_steps(program, simulated, history),
        "expectations": [j.as_data() for j in judged],
        "findings": [each.as_data() for each in found],
        **protected(program, history, context.period),
        **drift(program, history),
        **payload_block(program, history),
        **slip_block(task, history),
        **estimated(program, history),
        **law_bounds(program),
        **velocity_block(program, history),
        **energy_block(program, history, world.task),
        **performance(program, history, judged, simulated.solver_counts),
        "limits": {k: v for k, v in task.limits.model_dump().items() if v is not None},
        "stage_limits": {
            s.name: {k: v for k, v in s.plan.limits.model_dump().items() if v is not None}
            for s in program.stages
        },
        "joint_limits": robot.torque_limit.tolist(),
        **({"command_limits": drives.most.tolist()} if drives.commands == "velocity" else {}),
        "joint_ranges": np.transpose([robot.lower, robot.upper]).tolist(),
        "robot": {"name": robot.name, "joints": list(robot.joint_names), "source": robot.source},
        "objects": list(task.world),
        "diagnostics": diagnosed(program.findings, context.loaded),
        "forced": list(program.forced),
    }


def _steps(program: Program, simulated: Simulated, history: History) -> dict[str, Any]:
    """The largest step of a torque, or of a velocity at a change of stage."""
    drives = program.context.drives
    if drives.torques:
        return {"torque_step": largest_step(simulated.transitions, history)}
    # A position goes on by a velocity in each period.
    unit = program.context.period if drives.positions else 1.0
    step = largest_change(simulated.transitions)
    step = step and step | {"value": step["value"] / unit}
    return {"torque_step": None, "velocity_step": step}


def _visits(program: Program, simulated: Simulated) -> list[dict[str, Any]]:
    """Every visit of a stage, and what ended it."""
    stages, outcome = {stage.name: stage for stage in program.stages}, simulated.outcome
    torques = program.context.drives.torques
    ends = list(simulated.transitions)
    if simulated.by_signal:
        ends.append(
            Transition(outcome.clock, outcome.stage, "stop", outcome.reason, outcome.text, 0.0, "")
        )
    visits, start = [], 0.0
    for end in ends:
        stage = stages[end.stage]
        visits.append(
            {
                "name": end.stage,
                "start": start,
                "end": end.clock,
                "law": stage.plan.law.kind,
                "frame": stage.plan.frame.name,
                "ended_by": {
                    "kind": end.kind,
                    "name": end.name,
                    "text": transition_text(end, stage, program.context.robot),
                    "value": end.value,
                    "to": end.to,
                    **({"torque_step": end.torque_step} if torques else {}),
                },
            }
        )
        start = end.clock
    return visits


def transition_text(end: Transition, stage: CompiledStage, robot: RobotModel) -> str:
    """The end of a stage, as a sentence with the numbers of the event."""
    if end.kind == events.LIMIT:
        return _limit(end, robot)
    if end.kind == events.FAIL_IF:
        first, *others = end.text.split(_ATTEMPTS)
        return _ATTEMPTS.join([f"`{first}` held, which fails the stage", *others])
    if end.kind == events.WITHIN:
        bound, *others = end.text.removeprefix("within ").split(_ATTEMPTS)
        until = stage.plan.spec.until
        missing = "reaching the end of its moves" if until is None else f"`{until.text}`"
        distance = bound.removesuffix(_OF_TRAVEL)
        began = f"travelled {distance}" if distance != bound else f"{bound} passed"
        return _ATTEMPTS.join([f"{began} without {missing}", *others])
    if end.to == FAIL and end.kind == events.UNTIL:
        return f"`{end.text}` held, which leads to fail"
    return end.text


def _limit(end: Transition, robot: RobotModel) -> str:
    if end.name in Limits.model_fields:
        return f"{end.text}, measured {show(end.value, Limits.dimension_of(end.name), 5)}"
    number = _JOINT.search(end.text)
    if end.name == PROTECTION:
        turns = number is None or turns_at(robot, int(number[1]) - 1)
        return (
            f"{end.text}, measured {show(end.value, dimension_watched(end.text, turns=turns), 5)}"
        )
    if number is None or end.name not in ("joint_position", "joint_velocity"):
        return end.text
    joint = int(number[1]) - 1
    turns = turns_at(robot, joint)
    unit = LENGTH.on(rotation=turns)
    if end.name == "joint_velocity":
        unit = VELOCITY.on(rotation=turns)
        bound = show(float(robot.velocity_limit[joint]), unit, 5)
    else:
        low, high = (float(side[joint]) for side in (robot.lower, robot.upper))
        bound = f"{show(low, unit, 5)} to {show(high, unit, 5)}"
    return f"{end.text}: {bound}, measured {show(end.value, unit, 5)}"
