"""Runs that estimate the stiffness of contacts: both loops, the shipped task, what a run says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from controller_samples import ESTIMATE
from taskspec.laws.contact_stiffness import Schedule
from taskspec.planning import plan_task
from taskspec.spec import load_task, load_text
from taskspec_runner import run
from taskspec_runner.urscript.refusals import reasons

TASKS = Path(__file__).resolve().parents[2] / "tasks"


def test_both_loops_log_the_same_bytes(tmp_path):
    logs = []
    for loop in ("python", "native"):
        made = run(load_text(ESTIMATE, "touch.yaml"), tmp_path / loop, loop=loop, report=False)
        logs.append((tmp_path / loop / "log.arrow").read_bytes())
        hold, on = (made.summary["estimates"][stage]["x"] for stage in ("hold", "on"))
        assert hold["excited"]
        assert on["stiffness"] == pytest.approx(40e3, rel=0.2)
    assert logs[0] == logs[1]


def test_the_next_stage_goes_on_with_what_was_estimated_on_the_same_object(simulate):
    made = simulate(ESTIMATE)
    found = made.history.columns["estimate.stiffness.x"]
    hold, on = (np.flatnonzero(made.history.window(name)) for name in ("hold", "on"))
    assert np.isnan(found[: hold[0]]).all()
    assert found[hold[0]] == 10e3
    # The tick that ends a stage is measured by it, and not logged.
    assert found[on[0]] == pytest.approx(found[hold[-1]], rel=5e-3)
    assert found[on[0]] > 20e3


def test_two_pads_that_are_ten_times_off_either_way(tmp_path):
    """The plain law is slow on the soft one and unstable on the hard one; with the estimate all
    that the file expects is met."""
    text = (TASKS / "press-unknown-pads.yaml").read_text()
    followed = run(load_text(text, "pads.yaml"), tmp_path / "with", report=False)
    assert followed.passed
    for stage, k in (("on_soft", 2e3), ("on_hard", 200e3)):
        each = followed.summary["estimates"][stage]["z"]
        assert each["stiffness"] == pytest.approx(k, rel=0.05)
        assert each["followed"] == pytest.approx(k, rel=0.05)
    lines = [line for line in text.splitlines() if "estimate.stiffness" not in line]
    plain = "\n".join("law: admittance" if line.startswith("law:") else line for line in lines)
    made = run(load_text(plain, "pads.yaml"), tmp_path / "without", report=False, force=True)
    assert made.summary["status"] == "stopped"
    assert made.summary["ending"]["stage"] == "on_hard"
    assert "limit on force" in made.summary["ending"]["text"]
    missed = {each.name for each in made.expectations if each.missed}
    assert missed == {"soft_follows", "hard_follows", "gentle"}
    assert "estimates" not in made.summary


def test_a_force_that_never_changes_tells_nothing(tmp_path):
    """From the start pressed as it will be: the declared stiffness stays, and the run says so."""
    text = ESTIMATE.replace("dead_zone: 0.3 N", "dead_zone: 20 N")
    made = run(load_text(text, "touch.yaml"), tmp_path, report=False)
    each = made.summary["estimates"]["on"]["x"]
    assert (each["excited"], each["deviation"], each["stiffness"]) == (False, None, 10e3)
    assert "as declared" in each["text"]


def test_lines_of_a_schedule_go_through_its_knots_and_powers_need_two():
    root = Schedule.of({k: 3.0 * k**0.5 for k in (1e3, 2e3, 5e3, 1e4)})
    assert root is not None
    assert len(root.knots) == 2
    assert root.value(3e3) == pytest.approx(3.0 * 3e3**0.5, rel=1e-12)
    assert Schedule.of({1e3: 2.0, 2e3: 2.0}) is None
    assert Schedule.of({1e3: 0.0, 2e3: 2.0}) is None


def test_urscript_has_no_gains_that_follow():
    loaded = load_task(TASKS / "press-unknown-pads.yaml")
    texts = [each.text for each in reasons(plan_task(loaded))]
    assert any("follow an estimate" in text for text in texts)
