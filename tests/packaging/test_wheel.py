"""The wheel holds the two packages, the tasks and the schema, and no other top-level module."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder with what the wheel holds."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
        wheel.extractall(folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def names(installed) -> list[str]:
    return [p.relative_to(installed).as_posix() for p in installed.rglob("*") if p.is_file()]


def test_the_wheel_needs_no_repository(installed, tmp_path):
    """Templates, robots and pages of the codes come along."""

    environment = {**os.environ, "PYTHONPATH": str(installed), "TASKSPEC_CACHE": ""}

    def said(*arguments: str) -> str:
        command = [sys.executable, *arguments]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        return done.stdout

    files = "import taskspec, taskspec_runner as r; print(taskspec.__file__, r.__file__)"
    assert [Path(each).parents[1] for each in said("-c", files).split()] == [installed] * 2
    command = "-m", "taskspec_runner"
    assert "my-own-robot.yaml" in said(*command, "new", "own-robot")
    assert (tmp_path / "robots" / "bench-arm.urdf").is_file()
    assert said(*command, "explain", "TS501").startswith("# TS501")
    said(*command, "validate", "my-own-robot.yaml")


def test_what_others_look_for_is_declared(installed):
    """The command, the plugin of pytest, and that both packages have types."""
    (points,) = installed.glob("*.dist-info/entry_points.txt")
    text = points.read_text("utf-8")
    assert "[console_scripts]\ntaskspec = taskspec_runner.cli:main" in text
    assert "[pytest11]\ntaskspec = taskspec_runner.pytest_plugin" in text
    for package in ("taskspec", "taskspec_runner"):
        assert (installed / package / "py.typed").is_file()


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
        "taskspec_runner/scene/bundle.js",
    ):
        assert name in names


@pytest.fixture(scope="module")
def description(tmp_path_factory) -> str:
    """What an index shows of the project, and the names in the source distribution."""
    folder = tmp_path_factory.mktemp("sdist")
    command = [sys.executable, "-m", "build", "--sdist", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    with tarfile.open(next(folder.glob("*.tar.gz"))) as archive:
        names = [name.partition("/")[2] for name in archive.getnames()]
        info = next(member for member in archive.getmembers() if member.name.endswith("PKG-INFO"))
        file = archive.extractfile(info)
        assert file is not None
        text = file.read().decode("utf-8")
    # What the wheel is made of is there; what needs a clone is not.
    assert {"taskspec/__init__.py", "tasks/wipe-table.yaml", "schemas/taskspec-1.schema.json",
            "docs/diagnostics/TS203.md", "README.md", "LICENSE"} <= set(names)  # fmt: skip
    assert not [name for name in names if name.startswith(("tests/", "campaigns/", ".github/"))]
    return text


def test_links_of_the_description_lead_somewhere_from_an_index(description):
    """In the repository they are relative; an index has nothing beside the text."""
    links = re.findall(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"", description)
    targets = [a or b for a, b in links]
    assert len(targets) > 25
    assert [each for each in targets if not each.startswith(("https://", "#"))] == []
    written = re.findall(r"\]\((?!https?:|#)([^)\s]+)\)", (ROOT / "README.md").read_text("utf-8"))
    assert len(written) > 20
    for link in written:
        assert (ROOT / link.partition("#")[0]).exists(), link
        assert any(each.endswith(f"/{link}") for each in targets), link


def test_what_decides_whether_a_change_passes_has_one_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    tools = {each.partition("==")[0]: each for each in project["optional-dependencies"]["dev"]}
    for name in ("mypy", "pytest", "pytest-xdist", "ruff", "types-PyYAML"):
        assert "==" in tools[name], name


@pytest.mark.xdist_group("one process")
def test_processes_take_tests_by_their_groups(request):
    """Else all that tests share is made in each process; which versions do so is silent."""
    by_groups = getattr(request.config.option, "loadgroup", False)
    assert request.node.nodeid.endswith("@one process") == by_groups


def test_actions_of_others_are_named_by_their_commits():
    """A tag may be moved to other code."""
    used = [
        line.split("uses:")[1].strip()
        for path in (ROOT / ".github/workflows/ci.yml", ROOT / "action.yml")
        for line in path.read_text("utf-8").splitlines()
        if "uses:" in line
    ]
    others = [each for each in used if each != "./"]
    assert len(others) == 4
    for each in others:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", each), each
