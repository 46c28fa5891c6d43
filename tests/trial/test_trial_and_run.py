"""Shipped tasks are valid, and a trial comes to what `run` comes to.

That is: the same outcome, ticks, verdicts and findings.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.spec import load_task
from taskspec.text.diagnostic import Severity
from taskspec_runner.loop.fixed_step import NATIVE
from taskspec_runner.session import execute_program
from taskspec_runner.trial.trial import trial

TASKS = sorted((Path(__file__).resolve().parents[2] / "tasks").glob("*.yaml"))


def test_there_are_tasks_to_compare():
    assert len(TASKS) > 40


@pytest.mark.parametrize("path", TASKS, ids=lambda path: path.stem)
def test_a_shipped_task_is_stable_and_its_trial_agrees_with_its_run(path, tmp_path):
    """All of them pass: an error is a false one, and their gains settle."""
    examined = examine(load_task(path))
    found = [d for d in examined.findings if d.severity is Severity.ERROR or d.code[:3] == "TS5"]
    assert found == []
    program = admit(examined)
    # Faults of the truth are Python's.
    loop = None if program.context.loaded.task.truth.faults else NATIVE
    tried = trial(program, loop=loop)
    assert tried.good
    run = execute_program(program, tmp_path / "run", report=False, loop=loop)
    summary = run.summary
    assert tried.outcome.status == summary["status"]
    assert tried.outcome.ticks == summary["ticks"]
    ending = summary["ending"]
    assert (tried.outcome.reason, tried.outcome.stage) == (ending["reason"], ending["stage"])
    assert tried.outcome.clock == ending["clock"]
    assert [each.as_data() for each in tried.judged] == summary["expectations"]
    assert [each.as_data() for each in tried.findings] == summary["findings"]
    assert tried.exit_code == summary["exit_code"]
