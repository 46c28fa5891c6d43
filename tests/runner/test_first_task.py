"""`taskspec new --model`: a first task for an arm that nobody has placed yet."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from taskspec_runner.cli import app

ERR = Path(__file__).parents[1] / "corpus" / "err"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("bent.urdf", "gripping.urdf", "massless.urdf"):
        shutil.copy(ERR / name, tmp_path / name)
    return tmp_path


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def test_what_was_made_of_the_file_is_told() -> None:
    made = call("new", "--model", "gripping.urdf", "--out", "jaw.yaml")
    assert made.exit_code == 0, made.stderr
    assert made.stdout == "jaw.yaml\n"
    assert "the task has flange: {body: hand, rpy: [0, 90 deg, 0]}" in made.stderr
    assert "'jaw' behind it is taken for a gripper's" in made.stderr


def test_the_file_says_what_the_arm_needs(here: Path) -> None:
    made = call("new", "--model", "bent.urdf")
    assert made.stdout == "bent-first.yaml\n", made.stderr
    text = (here / "bent-first.yaml").read_text()
    assert "model: bent.urdf" in text
    assert "flange: {body: hand, rpy: [0, 90 deg, 0]}" in text
    assert call("validate", "bent-first.yaml").exit_code == 0
    assert call("run", "bent-first.yaml").exit_code == 0
    again = call("new", "--model", "bent.urdf")
    assert (again.exit_code, "exists already" in again.stderr) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--model", "gone.urdf"), "TS401: there is no file 'gone.urdf'"),
        (("--model", "pandas"), "did you mean 'panda'?"),
        (("--model", "planar2"), "moves its tool along x, y alone"),
        (("--model", "bent.urdf", "--flange", "hnad"), "did you mean 'hand'?"),
        (("wipe-table", "--model", "panda"), "from a template or from --model"),
        (("--flange", "hand"), "--flange goes with --model"),
    ],
)
def test_what_cannot_be_is_told(arguments: tuple[str, ...], message: str) -> None:
    result = call("new", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_an_arm_too_weak_for_itself_is_told(here: Path) -> None:
    text = (here / "bent.urdf").read_text().replace('effort="50"', 'effort="1"')
    (here / "weak.urdf").write_text(text)
    result = call("new", "--model", "weak.urdf")
    assert result.exit_code == 2
    assert "able to bear itself" in result.stderr
    assert not (here / "weak-first.yaml").exists()
