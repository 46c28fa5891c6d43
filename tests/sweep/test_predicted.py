"""What `validate` says of a world that is named."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taskspec.program.prepare import prepare
from taskspec.program.worlds import random_world
from taskspec.spec import load_task
from taskspec_runner.cli import app
from taskspec_runner.sweep.summary import predicted_text, predicted_wrong

CLI = CliRunner()
ROOT = Path(__file__).parents[2]
TASKS = ROOT / "tasks"
PRESS = ROOT / "docs" / "how-to" / "sweep.yaml"
#: Worlds that fail, as `docs/how-to/sweep.md` has them, by what was otherwise in the task.
FAILING = {
    ("wipe-table", "law=hybrid", 3): "TS726",
    ("corner", "stages.across.until=wall.gap < 0 mm and force.x > 2 N", 3): "TS616",
}


def codes(*arguments: object) -> set[str]:
    result = CLI.invoke(app, ["validate", *map(str, arguments), "--format", "json"])
    assert result.exit_code == 0, result.output
    return {each["code"] for each in json.loads(result.stdout)["diagnostics"]}


@pytest.mark.parametrize(("task", "before", "number"), FAILING)
def test_a_world_that_fails_is_announced(task, before, number):
    """And not with the task as it is."""
    file = TASKS / f"{task}.yaml"
    assert codes(file, "--world", number, "--set", before) == {FAILING[task, before, number]}
    assert codes(file, "--world", number) == set()


def test_what_is_otherwise_is_told(tmp_path):
    """The world that `run` has under the same number and seed."""
    file = tmp_path / "press.yaml"
    shutil.copy(PRESS, file)
    context = prepare(load_task(file))
    for seed in (0, 1):
        named = ["--world", "29", "--seed", str(seed)]
        result = CLI.invoke(app, ["validate", str(file), *named])
        drawn = random_world(context, seed, 29).values["world.table.stiffness", None]
        assert f"world.table.stiffness {drawn / 1e3:.5g} kN/m (nominal 20 kN/m)" in result.stdout


@pytest.mark.parametrize(
    ("task", "world", "said"),
    [
        ("crank", "3", "crank.yaml: nothing varies in this task"),
        ("corner", "third", "corner.yaml: --world takes a number from 0 or TABLE:ROW, not 'third'"),
        ("corner", "none.parquet:3", "corner.yaml: cannot read none.parquet"),
    ],
)
def test_a_world_that_there_is_not(task, world, said):
    result = CLI.invoke(app, ["validate", str(TASKS / f"{task}.yaml"), "--world", world])
    assert result.exit_code == 2
    assert said in result.stderr


def test_worlds_that_were_predicted_wrongly_are_listed():
    told = {
        "failed": {"of": 2, "announced": 1, "codes": ["TS726"], "wrong": [7]},
        "good": {"of": 3, "announced": 1, "codes": ["TS616"], "wrong": [2]},
    }
    assert predicted_wrong(told) == [2, 7]
    assert predicted_text(told) == (
        "validate warns of trouble in 1 of 2 failed ones (TS726) and "
        "1 of 3 good ones (TS616) that were looked at"
    )
