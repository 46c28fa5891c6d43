"""Energy tanks of runs: the plain law beside, loops, hand-over, summary, what is refused."""

from __future__ import annotations

import re
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text
from taskspec.statics.tank_demand import first_contact, tank_demand
from taskspec_runner import run as execute
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.fixed_step import INTERPRETED, NATIVE, PYTHON
from taskspec_runner.loop.fixed_step import run as simulate
from taskspec_runner.record.log import Log
from taskspec_runner.verdict.tank import sentences

TASK = Path(__file__).resolve().parents[2] / "tasks" / "energy-tank.yaml"


def plain(text):
    """The task with the same laws and no tank, and without what it expects of one."""
    text = re.sub(r",? ?\btank: (\{[^}]*\}|[^,}\n]*)", "", text.split("expect:")[0])
    expected = TASK.read_text().split("expect:")[1].splitlines()
    return text + "expect:" + "\n".join(line for line in expected if "tank." not in line) + "\n"


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The shipped task, and the same without tanks."""
    folder, text = tmp_path_factory.mktemp("tank"), TASK.read_text()
    assert "tank:" not in plain(text)
    made = [
        execute(load_text(each, "task.yaml"), out=folder / name, report=False, force=True)
        for name, each in (("with", text), ("plain", plain(text)))
    ]
    return dict(zip(("with", "plain"), made, strict=True))


def test_the_plain_law_fails_what_the_tank_meets(both):
    assert both["with"].summary["status"] == "done"
    judged = both["with"].summary["expectations"]
    assert len(judged) == 7
    assert all(each["passed"] for each in judged)
    assert both["plain"].summary["status"] == "stopped"
    missed = [each for each in both["plain"].summary["expectations"] if each["passed"] is False]
    assert len(missed) >= 4


def test_it_gains_energy_without_the_tank_alone(both):
    by = {each["stage"]: each for each in both["plain"].summary["energy"]}
    assert by["shake"]["gained"]["by"] == "gains"
    assert by["shake"]["observed"] < 0
    visits = both["with"].summary["energy"]
    assert [each["stage"] for each in visits] == ["lower", "press", "lift", "shake"]
    for each in visits:
        assert "gained" not in each
        assert each["observed"] > 0


def test_the_summary_and_a_line_say_what_was_refused(both):
    visits = {each["stage"]: each["tank"] for each in both["with"].summary["energy"]}
    assert visits["shake"]["least"] == pytest.approx(0, abs=1e-9)
    assert visits["shake"]["refused"] == 1
    assert visits["lower"]["power"] == pytest.approx(0.4, rel=1e-3)
    assert "time" not in visits["lift"]
    lines = [*sentences(both["with"].summary)]
    assert len(lines) == 3
    assert lines[-1].startswith("the tank of stage shake refused up to 100 %")
    assert not [*sentences(both["plain"].summary)]


def test_a_stage_goes_on_with_what_is_left(both):
    made = both["with"]
    energy, spring = made.column("tank.energy"), made.column("tank.spring")
    assert np.all(spring <= 1)
    seen = 0
    for before, after in pairwise(made.history.visits()):
        seen += 1
        e = made.energies.column("energy.spring")
        left = energy[before.last] + e[before.last]
        now = energy[after.first] + e[after.first]
        # At most the capacity of the stage that follows; the last period's power is 0.4 W at most.
        capacity = 0.05 if after.stage == "shake" else 0.5
        assert now <= min(energy[before.last], capacity) + e[before.last] + 1e-3
        assert now >= min(left, capacity) - 5e-3
    assert seen == 3


def logged(program, folder, loop):
    folder.mkdir()
    path, parts = folder / "log.arrow", assemble(program)
    with closing(parts.recorder(Log(path))) as recorder:
        outcome = simulate(
            parts.machine, parts.plant, parts.bus, recorder, program.context.period, loop=loop
        )
    assert (outcome.status, outcome.loop) == ("done", NATIVE if loop != PYTHON else PYTHON)
    return path.read_bytes() + repr(parts.machine.transitions).encode()


def test_the_loops_write_the_same_bytes(tmp_path):
    program = compile_unchecked(load_text(TASK.read_text(), "task.yaml"))
    native = logged(program, tmp_path / "native", NATIVE)
    assert native == logged(program, tmp_path / "interpreted", INTERPRETED)
    assert native == logged(program, tmp_path / "python", PYTHON)


def test_tasks_without_a_tank_have_no_column_of_one(both):
    assert not any(name.startswith("tank.") for name in both["plain"].columns)
    assert {"tank.energy", "tank.refused"} <= {*both["with"].columns}


def test_the_first_contact_is_foretold_of_a_force_alone():
    program = compile_unchecked(load_text(TASK.read_text(), "task.yaml"))
    plans = {stage.name: stage.plan for stage in program.stages}
    found = first_contact(plans["lower"])
    assert found.speed == pytest.approx(np.sqrt(0.4 / 80))
    assert first_contact(plans["lift"]) is None
    assert first_contact(plans["shake"]) is None
    # 1/2 f^2 / k of the table.
    assert tank_demand(plans["lower"]).pressing == pytest.approx(0.5 * 15**2 / 10e3)
    assert tank_demand(plans["press"]).pressing == 0
    assert tank_demand(plans["press"]).continues


TEXT = """
taskspec: 1
name: guarded
robot: {model: panda}
law: {kind: pd, stiffness: 400 N/m, damping: 60 N*s/m, tank: {energy: 1 J, start: 20 mJ}}
stages:
  go:
    axes: {x: {move: 100 mm, speed: 100 mm/s}}
    until: tank.energy < 10 mJ and tank.refused < 2
    within: 2 s
    next: on
  on: {axes: {}, time: 50 ms}
"""


def test_a_guard_goes_by_what_is_left(tmp_path):
    made = execute(load_text(TEXT, "task.yaml"), out=tmp_path / "r", report=False, force=True)
    assert made.summary["status"] == "done"
    go = made.history.window("go")
    energy = made.column("tank.energy")[go]
    assert energy[0] == pytest.approx(20e-3)
    assert energy.min() >= 10e-3
    assert energy[-1] < 10.2e-3
