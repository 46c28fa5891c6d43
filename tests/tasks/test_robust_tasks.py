"""The wipes with a payload that nobody has said: the plain law fails, robust ones do not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.report.figures import sections

TASKS = Path(__file__).resolve().parents[2] / "tasks"


def made(name, folder, law=None, loop=None):
    """A run of a task, perhaps under another law; expectations of its observer go with it."""
    path = TASKS / f"{name}.yaml"
    text = path.read_text(encoding="utf-8")
    if law is not None:
        text = re.sub(r"^law: .*$", f"law: {law}", text, flags=re.M)
        text = re.sub(r"^  - .*disturbance.*\n", "", text, flags=re.M)
    return run(load_text(text, str(path)), folder, force=True, report=False, loop=loop)


@pytest.mark.parametrize(("name", "failing"), [("wipe-sliding", 4), ("wipe-observer", 3)])
def test_the_plain_law_fails_what_the_robust_one_meets(tmp_path, name, failing):
    robust, plain = made(name, tmp_path / "robust"), made(name, tmp_path / "plain", "hybrid")
    assert [e.passed for e in robust.expectations].count(False) == 0
    assert len(robust.expectations) >= failing
    assert [e.passed for e in plain.expectations].count(False) == failing
    assert all(np.nanmax(np.abs(r.column("error.x"))) > 0 for r in (robust, plain))


def test_the_report_draws_the_estimate_and_logs_without_an_observer_have_none(tmp_path):
    observed, sliding = made("wipe-observer", tmp_path / "a"), made("wipe-sliding", tmp_path / "b")
    keys = [{c.key for s in sections(each) for c in s.charts} for each in (observed, sliding)]
    assert "joint disturbances" in keys[0] - keys[1]
    assert not [name for name in sliding.columns if "disturbance" in name]


def test_python_and_machine_code_make_the_same_log(tmp_path):
    both = "{kind: hybrid, sliding: {layer: 40 mm/s, payload: 300 g}, disturbance_observer: 20 Hz}"
    logs = []
    for loop in ("native", "python"):
        made("wipe-sliding", tmp_path / loop, both, loop)
        logs.append((tmp_path / loop / "log.arrow").read_bytes())
    assert len(logs[0]) > 1000
    assert logs[0] == logs[1]
