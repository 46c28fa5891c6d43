"""The commands of docs/c.md, as they stand there, on a task that takes a second."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from controller_samples import GRIP, TOUCH
from taskspec_runner.runs import Run

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(not (shutil.which("cc") and shutil.which("bash")), reason="needs a C compiler")
@pytest.mark.parametrize(
    ("task", "last"), [(TOUCH.replace("touch", "wipe-table", 1), "hold"), (GRIP, "let_go")]
)
def test_the_commands_of_the_page(task: str, last: str, tmp_path: Path) -> None:
    """By library, by UDP and by the file itself: the log has the same bytes."""
    page = (ROOT / "docs" / "c.md").read_text(encoding="utf-8")
    commands = re.findall(r"^```sh\n(.*?)^```", page, re.M | re.S)
    assert len(commands) == 2
    assert page.count("taskspec run tasks/wipe-table.yaml`") == 1
    for name in ("tasks", "bin", "examples"):
        (tmp_path / name).mkdir()
    (tmp_path / "tasks" / "wipe-table.yaml").write_text(
        task.replace("name: pick", "name: wipe-table")
    )
    (tmp_path / "examples" / "plant").symlink_to(ROOT / "examples" / "plant")
    shim = tmp_path / "bin" / "taskspec"
    shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m taskspec_runner "$@"\n')
    shim.chmod(0o755)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    script = "set -e\n" + "".join(commands).replace("39017", port)
    assert port in script
    script += "taskspec run tasks/wipe-table.yaml\n"
    path = f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"the controller says: state 1 in stage {last!r}" in done.stdout
    runs = [Run.load(tmp_path / "runs" / name) for name in ("wipe-table", "wipe-table-2")]
    assert [run.verdict for run in runs] == ["passed", "passed"]
    assert [run.summary["link"]["name"] for run in runs] == ["wipe_table.so", "exported.c"]
    folders = [tmp_path / "runs" / f"wipe-table{end}" for end in ("", "-2", "-3")]
    logs = [(folder / "log.arrow").read_bytes() for folder in folders]
    assert logs[0] == logs[1] == logs[2]
