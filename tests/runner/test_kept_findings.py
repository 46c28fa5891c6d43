"""What was found about a file is told again for as long as all that it follows from is the same."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from taskspec import kept_findings
from taskspec.store import VARIABLE
from taskspec.text import confines
from taskspec_runner.cli.options import ValidateOptions
from taskspec_runner.cli.validate import examine
from taskspec_runner.trial import check

STORE_IN = kept_findings._store_in
#: Everything that a task may name, on an arm that is looked at in a moment.
CELL = "world: {wall: {shape: plane, xyz: [402 mm, 0, 0], rpy: [0, -90 deg, 0]}}\n"
ROBOT = Path(__file__).parents[2] / "tasks" / "robots" / "bench-arm.urdf"
TABLE = "t [s], x [mm]\n0, 0\n1, 5\n2, 10\n"
FILE = """\
taskspec: 1
include: cell.yaml
params: {idle: 3 N}
robot: {model: planar2, start: {xyz: [350 mm, 100 mm, 0]}}
stages:
  go: {path: {file: way.csv}}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with a task, and a cache of its own."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(kept_findings, "_store_in", STORE_IN)
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "pyproject.toml").touch()
    for name, text in {"task.yaml": FILE, "cell.yaml": CELL, "way.csv": TABLE}.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the files that have been examined since."""
    names: list[str] = []
    original = check.examine

    def noting(loaded, **options):
        names.append(loaded.source.name)
        return original(loaded, **options)

    monkeypatch.setattr(check, "examine", noting)
    return names


def test_what_has_not_changed_is_not_examined_again(folder: Path, looks: list[str]) -> None:
    task = folder / "task.yaml"
    first = examine([task])
    assert looks == [str(task)]
    assert first.diagnostics[str(task)]
    again = examine([task])
    assert looks == [str(task)]
    assert again == first
    assert [*again.sources[str(task)]] == [*first.sources[str(task)]]
    assert examine([task], keeps=False) == first
    assert looks == [str(task)] * 2


def _write(name: str, old: str, new: str) -> Callable[[Path, pytest.MonkeyPatch], None]:
    def change(folder: Path, _: pytest.MonkeyPatch) -> None:
        path = folder / name
        text = path.read_text()
        assert old in text
        facts = path.stat()
        path.write_text(text.replace(old, new))
        # It is the content that counts.
        os.utime(path, ns=(facts.st_atime_ns, facts.st_mtime_ns))

    return change


CHANGES: dict[str, Callable[[Path, pytest.MonkeyPatch], None]] = {
    "file": _write("task.yaml", "350", "351"),
    "included": _write("cell.yaml", "402", "403"),
    "table": _write("way.csv", "10", "11"),
    "a table that goes": lambda folder, _: (folder / "way.csv").unlink(),
    "confines": lambda folder, _: (folder.parent / ".git").mkdir(),
    "opened folders": lambda folder, patch: patch.setenv(confines.VARIABLE, str(folder.parent)),
    "package": lambda _, patch: patch.setattr(kept_findings, "_made_by", lambda: ("another",)),
    "damage": lambda folder, _: _damage(folder.parent / "cache" / "findings"),
}


def _damage(store: Path) -> None:
    [path] = store.iterdir()
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_findings_follow_from_counts(
    folder: Path, looks: list[str], change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = folder / "task.yaml"
    examine([task])
    CHANGES[change](folder, monkeypatch)
    changed = examine([task])
    assert looks == [str(task)] * 2
    assert changed == examine([task], keeps=False)


def test_options_count_and_findings_about_them_name_their_file(
    folder: Path, looks: list[str]
) -> None:
    task, other = folder / "task.yaml", folder / "other.yaml"
    other.write_text(FILE.replace("350", "351"))
    options = (
        ValidateOptions(),
        ValidateOptions(sets=("stages.go.time=-1 s",)),
        ValidateOptions(sets=("robot.start.xyz=[340 mm, 0, 0]",)),
        ValidateOptions(law="impedance"),
    )
    found = [examine([task, other], each) for each in options]
    assert len({repr(each) for each in found}) == len(options)
    del looks[:]
    assert [examine([task, other], each) for each in options] == found
    # What cannot be read as a task is read again each time, which is all that is done about it.
    assert looks == []


def test_a_mesh_that_comes_is_seen(folder: Path, looks: list[str]) -> None:
    text = ROBOT.read_text(encoding="utf-8")
    missing = "package://bench_arm/meshes/base.stl"
    assert missing in text
    (folder / "arm.urdf").write_text(text.replace(missing, "base.stl"), encoding="utf-8")
    task = folder / "task.yaml"
    start = "planar2, start: {xyz: [350 mm, 100 mm, 0]}"
    task.write_text(FILE.replace(start, "arm.urdf, flange: tool_plate"))
    examine([task])
    examine([task])
    assert looks == [str(task)]
    (folder / "base.stl").write_bytes(b"no mesh")
    examine([task])
    assert looks == [str(task)] * 2
