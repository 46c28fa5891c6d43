"""The wheel holds the two packages, the tasks and the schema, and no other top-level module."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def names(tmp_path_factory) -> list[str]:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
        return wheel.namelist()


def test_only_our_packages_are_top_level(names):
    tops = {name.split("/")[0] for name in names}
    assert {t for t in tops if not t.endswith(".dist-info")} == {"taskspec", "taskspec_runner"}


def test_tasks_and_schema_are_inside(names):
    inside = {n.removeprefix("taskspec/data/") for n in names if n.startswith("taskspec/data/")}
    here = {
        f"tasks/{p.relative_to(ROOT / 'tasks').as_posix()}"
        for p in (ROOT / "tasks").rglob("*")
        if p.is_file() and not p.name.startswith(".")
    }
    assert here <= inside
    assert "schemas/taskspec-1.schema.json" in inside


def test_pages_of_the_codes_are_inside(names):
    pages = {
        f"taskspec/data/diagnostics/{p.name}" for p in (ROOT / "docs/diagnostics").glob("*.md")
    }
    assert "taskspec/data/diagnostics/TS203.md" in pages
    assert pages <= set(names)


def test_data_of_the_packages_is_inside(names):
    for name in (
        "taskspec/py.typed",
        "taskspec/expression/grammar.lark",
        "taskspec/robot/models/panda.xml",
        "taskspec_runner/pages/page.css",
        "taskspec_runner/pages/picture.css",
        "taskspec_runner/pages/script/chart.js",
        "taskspec_runner/pages/script/time.js",
        "taskspec_runner/pages/script/worlds_charts.js",
    ):
        assert name in names
