"""What editors are given to start the server with."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.main import get_command

from taskspec_runner.cli import app

ROOT = Path(__file__).resolve().parents[2]
EXTENSION = ROOT / "editors" / "vscode"


def test_the_extension_starts_a_command_that_there_is():
    package = json.loads((EXTENSION / "package.json").read_text(encoding="utf-8"))
    properties = package["contributes"]["configuration"]["properties"]
    program, command = properties["taskspec.command"]["default"]
    assert program == "taskspec"
    assert command in get_command(app).commands
    script = (EXTENSION / package["main"]).read_text(encoding="utf-8")
    registered = re.findall(r'registerCommand\("([^"]+)"', script)
    assert registered == [each["command"] for each in package["contributes"]["commands"]]
    assert set(re.findall(r'require\("([^"/]+)', script)) == {"vscode", *package["dependencies"]}


@pytest.mark.skipif(shutil.which("node") is None, reason="the extension's tests need node")
def test_the_extension_starts_restarts_and_stops_its_server():
    command = ["node", "--test", "test/"]
    ran = subprocess.run(command, cwd=EXTENSION, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout
    assert "pass 4" in ran.stdout


def test_the_page_names_the_same_command():
    page = (ROOT / "docs" / "how-to" / "editor.md").read_text(encoding="utf-8")
    assert page.count('"lsp"') >= 3
