"""A rule that is defined here and nowhere else: no stage may be named after a colour."""

from __future__ import annotations

import json
from collections.abc import Iterator

from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import FILE, key_of

LAWS = ("hybrid", "impedance")
TASK = """\
taskspec: 1
name: colours
robot: {model: planar2, start: {xyz: [400 mm, 100 mm, 0]}}
stages:
  pale: {axes: {x: {move: 5 mm, speed: 100 mm/s}}}
expect: [max(speed) < 1 m/s]
"""
WRONG = TASK.replace("pale", "red")


def coloured(stage: StagePlan) -> Iterator[Finding]:
    """A name that tells nothing of what a stage does."""
    place = key_of(FILE.stages[stage.name])
    if stage.name in ("red", "green", "blue"):
        yield error("TS698", f"{stage.name!r} is a colour", place, "name what it does")
    elif stage.name == "pale":
        yield warning("TS698", f"{stage.name!r} is nearly a colour", place)


def define() -> None:
    rule("TS698", "a stage that is named after a colour", phase=Phase.FRAME)(coloured)


def test_a_file_is_validated_with_it(said):
    assert said["validate"].exit_code == 0
    assert "task.yaml:5:3: warning[TS698]: 'pale' is nearly a colour" in said["validate"].text
    assert said["mistake"].exit_code == 2
    assert "wrong.yaml:5:3: error[TS698]: 'red' is a colour" in said["mistake"].text
    assert "name what it does" in said["mistake"].text


def test_it_is_explained(said):
    assert said["explain"].exit_code == 0
    assert "warning[TS698]" in said["explain"].text


def test_a_run_says_what_it_found(said):
    assert said["run"].exit_code == 0
    assert "warning[TS698]" in said["run"].text
    (finding,) = json.loads(said["run"].file("run/summary.json"))["diagnostics"]
    assert (finding["code"], finding["severity"]) == ("TS698", "warning")


def test_it_refuses_a_run(said):
    assert said["refused"].exit_code == 2
    assert "error[TS698]" in said["refused"].text


def test_it_is_compared(said):
    assert said["compare"].exit_code == 0
    assert "TS698" in said["compare"].text


def test_the_report_has_it(said):
    assert said["report"].exit_code == 0
    assert "nearly a colour" in said["report"].file("run/report.html")


def test_the_schema_is_written(said):
    assert said["schema"].exit_code == 0
    assert "stages" in said["schema"].json["properties"]
