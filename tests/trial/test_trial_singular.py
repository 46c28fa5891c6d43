"""Motions that lead the arm into a singularity."""

from __future__ import annotations

import pytest
from trials import checked, found, place_of, serious

from taskspec.compiler import admit
from taskspec_runner.trial.trial import trial

TASK = """
taskspec: 1
name: reaches
robot: {model: MODEL, start: {START}}
stages: {go: {path: {to: [TO], time: 2 s}}, stay: {time: 0.1 s}}
"""
BENT = "xyz: [400 mm, 200 mm, 0]"


def text(model, start, to):
    return TASK.replace("MODEL", model).replace("START", start).replace("TO", to)


@pytest.mark.parametrize(
    ("model", "start", "to"),
    [
        ("planar2", BENT, "300 mm, 300 mm"),
        # Close to it an axis has 540 kg, of 10 000 that stop the run.
        ("planar2", BENT, "599.9 mm, 0"),
        ("planar2", "joints: [0, 1 deg]", "300 mm, 300 mm"),
        ("panda", "xyz: [500 mm, 0, 340 mm]", "450 mm, 0, 300 mm"),
    ],
)
def test_near_is_not_there(model, start, to):
    assert "TS422" not in serious(text(model, start, to))


def test_an_arm_that_is_stretched_stops():
    task = text("planar2", BENT, "599.999 mm, 0")
    finding = found(task, "TS422")
    assert place_of(finding, task) == (5, "path")
    assert "the arm is singular" in finding.message
    once = trial(admit(checked(task)))
    assert (once.outcome.status, once.outcome.reason) == ("stopped", "singularity")
