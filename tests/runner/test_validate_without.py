"""Validation without a numerical library: the rest is checked, and what is not is named."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TASK = ROOT / "tasks" / "wipe-table.yaml"
BLOCKED = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == {missing!r}:
            raise ImportError("no such library here", name=name)
sys.meta_path.insert(0, Blocker())
from taskspec_runner.cli import main
main()
"""


def validate(missing: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    code = BLOCKED.format(missing=missing)
    command = [sys.executable, "-c", code, "validate", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("missing", ["mujoco", "pinocchio", "casadi"])
def test_what_cannot_be_checked_is_said(missing: str) -> None:
    result = validate(missing, str(TASK))
    assert result.returncode == 0
    assert result.stdout == "no errors in 1 file; not all was checked\n"
    assert result.stderr.startswith(
        f"taskspec: {missing} cannot be imported (no such library here)"
    )
    assert "only text, names, units and modes were checked" in result.stderr


def test_the_language_is_checked(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(TASK.read_text().replace("frame: ", "frmae: ", 1), encoding="utf-8")
    result = validate("mujoco", str(wrong), "--format", "concise")
    assert result.returncode == 2
    assert "error[TS" in result.stdout
    assert "did you mean" in validate("mujoco", str(wrong)).stdout


def test_strict_does_not_pass_what_was_not_checked() -> None:
    result = validate("pinocchio", str(TASK), "--strict", "--format", "json")
    data = json.loads(result.stdout)
    assert result.returncode == data["exit_code"] == 2
    assert data["unchecked"].startswith("pinocchio cannot be imported")


def test_programs_are_told_too() -> None:
    result = validate("mujoco", str(TASK), "--format", "sarif")
    (run,) = json.loads(result.stdout)["runs"]
    (note,) = run["invocations"][0]["toolExecutionNotifications"]
    assert note["level"] == "warning"
    assert "mujoco cannot be imported" in note["message"]["text"]
    assert 'skipped="1"' in validate("mujoco", str(TASK), "--format", "junit").stdout
