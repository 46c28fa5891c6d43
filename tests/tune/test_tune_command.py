"""`taskspec tune` on the command line: what it prints and writes, and slips of the pen."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taskspec.spec import load_task
from taskspec_runner.cli import app
from tune.tasks import PRESS

SLOW = PRESS.replace("law: hybrid ", "law: {kind: hybrid, force: {integral: 3 /s}} ")
BRIEF = [
    "--only",
    "force.integral,force.damping",
    "--worlds",
    "1",
    "--verify",
    "4",
    "--budget",
    "12",
    "-j",
    "1",
]


def invoked(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [*arguments])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "press.yaml"
    path.write_text(SLOW, encoding="utf-8")
    return path


def test_a_patched_file_has_the_gains_that_were_found(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "tuned.yaml"
    code, text, _ = invoked("tune", str(file), *BRIEF, "--patch", str(out), "--format", "json")
    data = json.loads(text)
    assert code == 0
    assert data["found"]
    assert data["verified"]["after"]["good"] == 4
    assert data["good_before"] < data["good_after"] == data["worlds"]
    written = out.read_text(encoding="utf-8")
    assert "# the usual one" in written
    by_file = load_task(out).task
    by_options = load_task(file, data["set"]).task
    assert data["set"]
    assert by_file == by_options
    again, shown, _ = invoked("tune", str(out), *BRIEF)
    assert again == 0
    assert shown.startswith("FOUND")


def test_a_loop_that_rang_before_is_named(tmp_path: Path) -> None:
    """All its worlds succeed, so nothing else says why its gains are moved."""
    path = tmp_path / "press.yaml"
    rings = "law: {kind: hybrid, force: {integral: 12 /s, damping: 60 N*s/m}} "
    path.write_text(PRESS.replace("law: hybrid ", rings), encoding="utf-8")
    code, text, _ = invoked("tune", str(path), *BRIEF)
    assert code == 0
    assert "\nbefore: " not in text
    assert "margin before: stage 'press' at world.table.stiffness = 75 kN/m: axis 'z'" in text


def test_intervals_of_the_command_line_vary_as_those_of_the_file(file: Path) -> None:
    """A table that is known is none that gains have to be found for."""
    known = [
        *("--vary", "world.table.stiffness=20..20.1 kN/m"),
        *("--set", "vary.world.table.xyz=[0, 0, 0]", "--set", "expect.0=max(force.z) < 5 N"),
    ]
    code, text, _ = invoked("tune", str(file), *BRIEF, *known)
    assert code == 0, text
    assert "--set" not in text
    assert "no better gains than those of the file" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vary", "world.table.stiffness"], "--vary needs PATH=INTERVAL"),
        (["--vary", "world.table.stifness=1..2 kN/m"], "did you mean"),
        (["--vary", "world.table.stiffness=9..2 kN/m"], "ends before it begins"),
        (["--only", "integral"], "has a gain named integral; it has"),
    ],
)
def test_slips_are_named(file: Path, arguments: list[str], message: str) -> None:
    code, _, error = invoked("tune", str(file), *arguments)
    assert code == 2
    assert message in " ".join(error.split())
