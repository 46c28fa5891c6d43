"""Energies of a run in its summary, its report and on the terminal."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from taskspec.signals import ENERGY
from taskspec.spec import load_task, load_text
from taskspec_runner import Run
from taskspec_runner import run as execute
from taskspec_runner.verdict.energy import INNER, PORTS, sentences

TASKS = Path(__file__).resolve().parents[2] / "tasks"


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """A run of the shipped task whose stiffness swings, from its folder."""
    folder = tmp_path_factory.mktemp("energy") / "swing"
    execute(load_task(TASKS / "energy-swing.yaml"), out=folder)
    return Run.load(folder)


def test_the_summary_has_the_balance_of_each_visit(swing):
    settle, stiffened = swing.summary["energy"]
    assert (settle["stage"], stiffened["stage"]) == ("settle", "swing")
    for each in (settle, stiffened):
        work = each["work"]
        total = sum(work[name] for name in (*PORTS, *INNER)) - work["dissipated"]
        change = each["stored"]["last"] - each["stored"]["first"]
        assert total == pytest.approx(change, abs=1e-12)
        assert "(4.22)" in each["storage"]
    assert "gained" not in settle
    gained = stiffened["gained"]
    assert gained["by"] == "gains"
    assert 2 < gained["start"] < gained["end"] < 5
    assert gained["work"] > gained["energy"] > 0.1


def test_a_line_says_what_gained(swing):
    (line,) = sentences(swing.summary)
    assert line.startswith("stage swing gained 0.17 J by itself from ")
    assert line.endswith("by gains that vary")


def test_the_report_draws_energies_and_what_changes_them(swing):
    page = (swing.folder / "report.html").read_text(encoding="utf-8")
    assert "Energy of the laws" in page
    assert "What changes the stored energy" in page
    assert "swing gained" in page


def test_the_signals_are_beside_the_log_and_not_in_it(swing):
    assert not any(name in swing.columns for name in ENERGY)
    beside = swing.energies.beside()
    assert {*ENERGY} <= {*beside.columns}
    assert len(beside.columns) == len(swing.columns) + len(ENERGY)
    lyapunov = beside.columns["energy.lyapunov"]
    # Of the stage whose gains vary there is none.
    first = next(v.first for v in swing.history.visits() if v.stage == "swing")
    assert np.isfinite(lyapunov[:first]).all()
    assert np.isnan(lyapunov[first:]).all()
    assert beside.units["energy.stored"] == "J"
    assert beside.units["power.gains"] == "W"


def test_a_law_without_a_storage_function_has_no_energy(tmp_path):
    text = """
taskspec: 1
name: free
robot: {model: panda}
law: hybrid
stages:
  go: {axes: {x: {move: 5 mm}}, time: 0.2 s}
"""
    made = execute(load_text(text, "task.yaml"), out=tmp_path / "free", report=False)
    assert "energy" not in made.summary
    assert made.energies.visits == ()


def test_json_of_a_run_has_it(swing):
    summary = json.loads((swing.folder / "summary.json").read_text(encoding="utf-8"))
    assert [each["stage"] for each in summary["energy"]] == ["settle", "swing"]
