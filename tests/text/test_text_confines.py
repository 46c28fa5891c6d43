"""Which files a task may name."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_task
from taskspec.text.confines import VARIABLE, confines, project
from taskspec.text.diagnostic import SpecError

TASK = "taskspec: 1\nrobot: {{model: {}}}\nstages: {{go: {{path: {{file: {}, time: 2 s}}}}}}\n"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder of tasks two levels deep, a table above it and one beside its project."""
    tasks = tmp_path / "work" / "tasks"
    tasks.mkdir(parents=True)
    for folder in (tmp_path / "work", tmp_path):
        (folder / "way.csv").write_text("x [mm], y [mm]\n320, 10\n330, 20\n", encoding="utf-8")
    return tasks


def codes(folder: Path, table: str, model: str = "planar2") -> set[str]:
    path = folder / "t.yaml"
    path.write_text(TASK.format(model, table), encoding="utf-8")
    try:
        return {d.code for d in check_task(load_task(path))}
    except SpecError as error:
        return {d.code for d in error.diagnostics}


def test_without_a_mark_only_the_folder_of_the_task_is_read(place: Path) -> None:
    assert project(place) == place.resolve()
    assert "TS409" in codes(place, "../way.csv")


@pytest.mark.parametrize("mark", [".git", ".hg", "pyproject.toml", "package.xml"])
def test_the_project_is_the_folder_with_a_mark(place: Path, mark: str) -> None:
    (place.parent / mark).mkdir()
    assert project(place) == place.parent.resolve()
    assert "TS409" not in codes(place, "../way.csv")
    assert "TS409" in codes(place, "../../way.csv")


def test_a_repository_is_more_than_the_package_inside(place: Path) -> None:
    (place / "package.xml").touch()
    (place.parent / ".git").mkdir()
    assert project(place) == place.parent.resolve()


def test_further_folders_are_opened_by_the_environment(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = str(place.parent.parent / "way.csv")
    assert "TS409" in codes(place, table)
    monkeypatch.setenv(VARIABLE, os.pathsep.join(["", "/opt", str(place.parent.parent)]))
    assert "TS409" not in codes(place, table)


def test_what_counts_is_where_links_lead(place: Path) -> None:
    (place / "link.csv").symlink_to(place.parent / "way.csv")
    assert "TS409" in codes(place, "link.csv")
    assert not confines(place).hold(place / "link.csv")


def test_a_file_outside_is_not_even_looked_for(place: Path) -> None:
    """Whether there is one is nothing that a task may find out."""
    assert codes(place, "x.csv", "../there-is-none.urdf") == {"TS409"}
