"""`taskspec runs`: what lies under a folder, newest first, and since when a task misses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from short_tasks import TAP
from typer.testing import CliRunner, Result

from taskspec.compiler import compile_task
from taskspec.spec import load_text
from taskspec_runner.cli import app
from taskspec_runner.listing.kept import histories, kept_folders
from taskspec_runner.record.folder import RunFolder, read_json
from taskspec_runner.record.names import MANIFEST
from taskspec_runner.session import execute_program

MET, MISSED = "max(norm(force)) < 1 kN", "max(norm(force)) > 1 kN"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def keep(expected: str, folder: str, started: str, **overrides: str) -> Path:
    """A run in `runs/`, which says that it was started at a given time."""
    program = compile_task(load_text(f"{TAP}  - {expected}\n", "tap.yaml", overrides))
    run = execute_program(program, Path("runs") / folder)
    RunFolder(run.folder, dict(read_json(run.folder / MANIFEST))).note(started=started)
    return run.folder


def runs(*args: str) -> Result:
    return CliRunner().invoke(app, ["runs", *args])


def test_a_task_misses_since_the_first_of_its_last_misses() -> None:
    for number, expected in enumerate([MISSED, MET, MISSED, MISSED]):
        keep(expected, f"tap-{number}", f"2026-01-0{number + 1}T12:00:00+00:00")
    keep(MET, "other", "2026-01-09T12:00:00+00:00", **{"limits.force": "900 N"})
    found = kept_folders(Path("runs"))
    assert [each.path.name for each in found] == ["other", "tap-3", "tap-2", "tap-1", "tap-0"]
    assert [each.verdict for each in found] == ["passed", "missed", "missed", "passed", "missed"]
    changed, plain = histories(found)
    assert (changed.misses_since, changed.last_good) == (None, found[0])
    assert "limits.force=900 N" in changed.label
    assert plain.misses_since == found[2]
    assert plain.last_good == found[3]
    shown = runs()
    assert shown.exit_code == 0
    (line,) = re.findall(r"^tap misses since .*$", shown.stdout, re.M)
    assert "(runs/tap-2); last good: runs/tap-1" in line
    data = json.loads(runs("--format", "json").stdout)
    assert data["misses"][0]["since"]["folder"] == "runs/tap-2"
    assert len(data["folders"]) == 5
    assert "and 3 older ones" in runs("-n", "2").stdout


def test_folders_that_are_broken_or_go_on_decide_nothing() -> None:
    keep(MET, "whole", "2026-01-01T12:00:00+00:00")
    altered = keep(MET, "altered", "2026-01-02T12:00:00+00:00")
    (altered / "log.arrow").write_bytes(b"other")
    cut = Path("runs/cut")
    cut.mkdir()
    (cut / "manifest.json").write_text("{")
    Path("runs/notes").mkdir()
    found = {each.path.name: each for each in kept_folders(Path("runs"))}
    assert set(found) == {"whole", "altered", "cut"}
    assert found["altered"].verdict == "damaged"
    assert {name: each.good for name, each in found.items()} == {
        "whole": True, "altered": None, "cut": None
    }  # fmt: skip
    assert runs().exit_code == 0


def test_the_page_links_every_report_and_shows_text_as_text() -> None:
    keep(MET, "a", "2026-01-01T12:00:00+00:00")
    keep(MISSED, "b<i>", "2026-01-02T12:00:00+00:00")
    Path("pages").mkdir()
    assert runs("--html", "pages/all.html").exit_code == 0
    page = Path("pages/all.html").read_text(encoding="utf-8")
    assert "<i>/report" not in page
    links = re.findall(r'href="([^"]+)"', page)
    assert len(links) >= 4
    for link in links:
        target = link.replace("&lt;", "<").replace("&gt;", ">")
        assert (Path("pages") / target).is_file(), link
    assert page.count("<circle") == 2


@pytest.mark.parametrize(
    ("args", "said"),
    [(["nowhere"], "there is no such folder"), ([".", "--html", "x.txt"], "ends in .html")],
)
def test_what_cannot_be_listed(args: list[str], said: str) -> None:
    shown = runs(*args)
    assert shown.exit_code == 2
    assert said in shown.stderr


def test_an_empty_folder_holds_no_runs(here: Path) -> None:
    shown = runs(str(here))
    assert (shown.exit_code, shown.stdout) == (0, f"no runs in {here}\n")
