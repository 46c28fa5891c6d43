"""A task's expectations over a log that was recorded elsewhere, kept as the folder of a run."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from taskspec.compiler import compile_unchecked
from taskspec.program.execution.transition import END, FAIL, Transition
from taskspec.program.program import Program
from taskspec.program.worlds import true_world
from taskspec.spec import LoadedTask
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.loop.fixed_step import DONE, FAILED, UNDECIDED, Outcome
from taskspec_runner.record import manifest
from taskspec_runner.record.folder import open_folder
from taskspec_runner.record.history import Visit
from taskspec_runner.record.log import Log
from taskspec_runner.record.names import TASK
from taskspec_runner.recorded.assignment import is_wrench
from taskspec_runner.recorded.column_map import Columns, read_columns
from taskspec_runner.recorded.guards import UNKNOWN
from taskspec_runner.recorded.recording import ForeignLog, read_recording
from taskspec_runner.result import RunResult
from taskspec_runner.runs import ROWS
from taskspec_runner.verdict.judge import judge_run
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.summary import Simulated, summarise

#: What ended a stage of a log, of which no event is known.
RECORDED = "recorded"
#: Why a log that ends before its task, or perhaps does, ends.
LOG_ENDS = "log_ends"


def judge_recording(
    loaded: LoadedTask, log: Path, columns: Path | None = None, out: Path | None = None
) -> RunResult:
    """Judges a log by a task, and leaves the folder of a run.

    Args:
        loaded: the task.
        log: a CSV, Parquet or MCAP file.
        columns: file of a column map, or the name of a ready one; None where the log has the
            columns of a run.
        out: the folder; None for `runs/NAME-measured`, with -2, -3, ... where that exists.

    Raises:
        SpecError: the task does not compile.
        InputError: log or map cannot be used.
        OutputError: the folder cannot be written.
    """
    program = compile_unchecked(loaded)
    said = read_columns(columns)
    recording = read_recording(program, log, said)
    if out is not None and log.resolve().is_relative_to(out.resolve()):
        raise OutputError(out, f"{log} lies in it and would be removed; choose another folder")
    content = manifest.task_bytes(loaded)
    facts = {**recording.facts, "sha256": _digest(log)}
    with (
        open_folder(out, f"{loaded.task.name}-measured") as folder,
        folder.failures_noted(),
    ):
        opening = manifest.opening(program, content, true_world(program.context))
        folder.note(**opening | {"seed": None, "recorded": facts})
        folder.write(TASK, content)
        history = recording.history
        with closing(Log(folder.log, keep=False, run=manifest.run_mark(folder.manifest))) as kept:
            for batch in history.batches(ROWS):
                kept.write(batch)
        judged = judge_run(program, history)
        mirrored = _mirrored(program, log, said, recording, judged)
        summary = folder.keep_summary(_summary(program, recording, judged, mirrored), kept)
        reason, code = summary["ending"]["reason"], summary["exit_code"]
        folder.end(summary["status"], reason, exit_code=code)
        run = RunResult.written(folder, program, content, summary, history)
        from taskspec_runner.report import write_report

        write_report(run)
        return run


def _digest(log: Path) -> str:
    with log.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _mirrored(
    program: Program,
    log: Path,
    columns: Columns,
    recording: ForeignLog,
    judged: Sequence[Judged],
) -> list[str]:
    """Expectations that would be met if forces and moments had the opposite sign.

    None where some are met that would not be then: the sign is not what is wrong.
    """
    missed = [each.passed is False for each in judged]
    wrench = any(map(is_wrench, recording.facts["columns"]))
    if not any(missed) or not wrench:
        return []
    try:
        turned = judge_run(program, read_recording(program, log, columns, mirrored=True).history)
    except InputError:
        # With that sign the guards of the file do not even find its stages.
        return []
    if any(not bad and each.passed is False for bad, each in zip(missed, turned, strict=True)):
        return []
    return [each.text for bad, each in zip(missed, turned, strict=True) if bad and each.passed]


def _summary(
    program: Program, recording: ForeignLog, judged: Sequence[Judged], mirrored: Sequence[str]
) -> dict[str, Any]:
    """The summary of a run, less what only a run knows, and with where the log is from."""
    history = recording.history
    visits = list(history.visits())
    outcome = _outcome(program, recording, visits)
    simulated = Simulated(outcome, _transitions(program, visits, outcome), {})
    summary = summarise(program, simulated, history, judged, true_world(program.context))
    names = ("log", "form", "clocks", "as_measured", "not_recorded", "stages", "gap", "base_turned")
    said = {name: recording.facts[name] for name in names} | {"mirrored": [*mirrored]}
    return summary | {"seed": None, "torque_step": None, "recorded": said}


def _outcome(program: Program, recording: ForeignLog, visits: Sequence[Visit]) -> Outcome:
    """How the log ends: with the task, in `fail`, before the task does, or nobody knows."""
    ticks, last, stage = len(recording.history), recording.last, visits[-1].stage
    clock = ticks * program.context.period
    status, reason = {
        END: (DONE, END),
        FAIL: (FAILED, "guard"),
        UNKNOWN: (UNDECIDED, LOG_ENDS),
    }.get(last.to, (FAILED, LOG_ENDS))
    return Outcome(status, reason, last.text, stage, clock, ticks)


def _transitions(program: Program, visits: Sequence[Visit], outcome: Outcome) -> list[Transition]:
    period = program.context.period
    ends = []
    for visit, after in zip(visits, [*visits[1:], None], strict=True):
        to = {DONE: END, UNDECIDED: ""}.get(outcome.status, FAIL)
        text, name = outcome.text, outcome.reason
        if after is not None:
            to, name = after.stage, RECORDED
            text = f"the log goes on with stage '{to}'"
        clock = (visit.last + 1) * period
        ends.append(Transition(clock, visit.stage, RECORDED, name, text, 0.0, to))
    return ends
