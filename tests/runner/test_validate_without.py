"""Validation without a numerical library: the rest is checked, and what is not is named."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from taskspec.missing import EXTRAS

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


# Libraries that only some tasks or commands need.

MESH = """
taskspec: 1
name: mesh
robot: {{model: panda, start: {{xyz: [500 mm, 0, 320 mm]}}}}
world: {{part: {{shape: mesh, file: {part}, unit: mm, xyz: [450 mm, 0, 100 mm]}}}}
stages: {{rest: {{axes: {{z: hold}}, time: 10 ms}}}}
"""


def command(missing: str, folder: Path, *arguments: str, **environment: str) -> str:
    """What a command without a library says, which ends before it has done anything."""
    code = BLOCKED.format(missing=missing)
    result = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, **environment},
    )
    assert result.returncode == 2
    assert "internal error" not in result.stderr
    assert not [path for path in folder.iterdir() if path.is_dir()]
    return result.stderr + result.stdout


def test_run_without_what_writes_its_log_ends_before_it(tmp_path: Path) -> None:
    assert command("pyarrow", tmp_path, "run", str(TASK), "--out", "run") == (
        "taskspec: the log of a run needs the library pyarrow, which is not installed: "
        "pip install taskspec-robotics\n"
    )


@pytest.mark.parametrize("missing", ["osqp", "scipy"])
def test_solver_that_is_not_there_is_named_before_the_run(missing: str, tmp_path: Path) -> None:
    text = (ROOT / "tasks" / "press-qp.yaml").read_text("utf-8")
    task = tmp_path / "task.yaml"
    changed = text.replace("solve: qp", "solve: qp, solver: osqp", 1)
    assert changed != text
    task.write_text(changed, encoding="utf-8")
    assert command(missing, tmp_path, "run", "task.yaml", "--out", "run") == (
        "taskspec: solver: osqp needs the library osqp, which is not installed: "
        "pip install 'taskspec-robotics[osqp]'\n"
    )


@pytest.mark.parametrize("missing", ["trimesh", "scipy"])
def test_mesh_that_nothing_reads_is_a_finding_at_its_file(missing: str, tmp_path: Path) -> None:
    part = ROOT / "tasks" / "parts" / "rounded-block.stl"
    (tmp_path / "part.stl").write_bytes(part.read_bytes())
    (tmp_path / "task.yaml").write_text(MESH.format(part="part.stl"), encoding="utf-8")
    said = command(missing, tmp_path, "run", "task.yaml", "--out", "run")
    assert "TS333" in said
    assert "a mesh needs the library trimesh, which is not installed" in said
    assert "pip install 'taskspec-robotics[mesh]'" in said


def test_video_without_a_coder_is_not_begun(tap: Path, tmp_path: Path) -> None:
    said = command(
        "imageio_ffmpeg", tmp_path, "run", str(tap), "--video", "x.mp4", "--out", "run", PATH=""
    )
    assert said == (
        "taskspec: a video needs the library imageio_ffmpeg, which is not installed: "
        "pip install 'taskspec-robotics[video]'\n"
    )


def test_extras_bring_what_the_messages_say() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]

    def names(requirements: list[str]) -> set[str]:
        return {re.split(r"[<>=;\[ ]", each)[0].replace("-", "_") for each in requirements}

    brought = {extra: names(each) for extra, each in project["optional-dependencies"].items()}
    distributions = {"rerun": "rerun_sdk"}
    assert len(EXTRAS) > 8
    for library, extra in EXTRAS.items():
        # What mcap itself needs is not named again.
        if library != "zstandard":
            assert distributions.get(library, library) in brought[extra], library
        assert library not in names(project["dependencies"])
