"""Two runs held against each other: what is equal, what is not, and where the logs part."""

from __future__ import annotations

import json
import re
import shutil
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from sealed import seal_folder
from short_tasks import TAP
from typer.testing import CliRunner, Result

from taskspec.spec import load_task, load_text
from taskspec_runner.cli import app
from taskspec_runner.diff import diff_runs
from taskspec_runner.diff.logs import diff_logs
from taskspec_runner.record.folder import plain
from taskspec_runner.record.history import History
from taskspec_runner.record.log import Log, read_log
from taskspec_runner.runs import Run
from taskspec_runner.session import execute


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs `a` and `same` of one file, and `harder` of one that presses with another force."""
    here = tmp_path_factory.mktemp("runs")
    for name in ("a", "same"):
        execute(load_text(TAP, "tap.yaml"), here / name, report=False)
    harder = TAP.replace("params: {press: 5 N}", "params: {press: 8 N}")
    execute(load_text(harder, "tap.yaml"), here / "harder", report=False)
    return here


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


def data(a: Path, b: Path) -> tuple[int, Any]:
    result = call("diff", a, b, "--format", "json")
    return result.exit_code, json.loads(result.stdout)


def changed(folder: Path, to: Path, **entries: Any) -> Path:
    """A copy of a run with other entries in its manifest."""
    shutil.copytree(folder, to)
    seal_folder(to, **entries)
    return to


def test_equal_runs(runs: Path) -> None:
    result = call("diff", runs / "a", runs / "same")
    assert result.exit_code == 0
    assert "The runs are equal" in result.stdout
    assert result.stderr == ""
    code, told = data(runs / "a", runs / "same")
    assert (code, told["equal"], told["task"], told["log"]["first"]) == (0, True, [], None)
    assert all(row["same"] for row in (*told["metrics"], *told["expectations"], *told["outcome"]))


def test_versions_are_told_and_are_no_difference(runs: Path, tmp_path: Path) -> None:
    other = changed(runs / "a", tmp_path / "b", versions={"python": "3.99.0"})
    code, told = data(runs / "a", other)
    assert (code, told["equal"]) == (0, True)
    assert {"name": "python", "a": told["versions"][0]["a"], "b": "3.99.0"} in told["versions"]
    assert "their versions differ" in call("diff", runs / "a", other).stdout


def test_logs_part_where_the_force_is_first_wanted_otherwise(runs: Path) -> None:
    code, told = data(runs / "a", runs / "harder")
    assert code == 1
    a, b = (read_log(runs / name / "log.arrow") for name in ("a", "harder"))
    rows = min(len(a), len(b))
    differs = np.zeros(rows, dtype=bool)
    for name, values in a.columns.items():
        x, y = values[:rows], b.columns[name][:rows]
        differs |= (x != y) & ~(np.isnan(x) & np.isnan(y))
    first = told["log"]["first"]
    assert first["tick"] == int(np.flatnonzero(differs)[0])
    assert first["clock"] == a.columns["clock"][first["tick"]]
    # The approach is the same: they part within the ramp of the force.
    assert first["stages"] == {"A": "hold", "B": "hold"}
    assert first["columns"][0]["name"] == "force.x.ref"
    assert {c["name"]: (c["a"], c["b"]) for c in first["columns"]} == {
        c["name"]: (a.columns[c["name"]][first["tick"]], b.columns[c["name"]][first["tick"]])
        for c in first["columns"]
    }
    force = next(c for c in told["log"]["apart"] if c["name"] == "force.x.ref")
    assert force["largest"] == pytest.approx(3)
    assert force["unit"] == "N"


def test_metrics_expectations_and_texts_of_different_runs(runs: Path) -> None:
    told = diff_runs(Run(runs / "a"), Run(runs / "harder")).data
    rows = {(m["stage"], m["signal"], m["statistic"]): m for m in told["metrics"]}
    most = rows["hold", "force.x", "max"]
    assert most["change"] == most["b"] - most["a"] == pytest.approx(3, abs=0.5)
    assert most["unit"] == "N"
    assert [e["same"] for e in told["expectations"]].count(False) >= 1
    assert told["task"][:2] == ["--- A/task.yaml", "+++ B/task.yaml"]
    assert "-params: {press: 5 N}" in told["task"]
    assert "+params: {press: 8 N}" in told["task"]
    assert len(told["task"]) == 7  # two names, a place, one line around, and the change
    result = call("diff", runs / "a", runs / "harder")
    assert result.exit_code == 1
    assert re.search(r"The logs part at tick \d+, 0\.\d{3} s, in stage hold: force\.x\.ref ",
                     result.stdout)  # fmt: skip
    assert re.search(r"hold +force +peak +[\d.]+ N +[\d.]+ N +[\d.]+ N +\+\d+ %", result.stdout)
    assert "These differ: task files, expectations, metrics, logs." in result.stdout
    assert not re.search("[−µ·–]", result.stdout)


def test_overrides_and_seed_are_inputs(runs: Path, tap: Path, tmp_path: Path) -> None:
    execute(load_task(tap, {"params.press": "6 N"}), tmp_path / "set", report=False, seed=4)
    code, told = data(runs / "a", tmp_path / "set")
    assert code == 1
    found = {row["name"]: (row["a"], row["b"]) for row in told["inputs"] if not row["same"]}
    assert found == {"seed": (0, 4), "--set params.press": (None, "6 N")}
    assert told["task"] == []


def test_page_has_both_runs_in_its_charts(runs: Path, tmp_path: Path) -> None:
    page = tmp_path / "diff.html"
    result = call("diff", runs / "a", runs / "harder", "--html", page)
    assert result.stdout.endswith(f"page: {page}\n")
    text = page.read_text(encoding="utf-8")
    assert 'src="http' not in text
    found = re.search(r'id="run-data">(.*?)</script>', text, re.S)
    assert found is not None
    drawn = json.loads(found[1])
    force = drawn["charts"]["force.x.ref"]
    looks = {t["label"]: (t["role"], t["style"]) for t in force["traces"]}
    assert looks["A"] == ("law0", "line")
    assert looks["B"] == ("law2", "loopless")
    assert "motion error" in drawn["charts"]
    assert '<span class="plus">+params: {press: 8 N}</span>' in text
    assert "The logs part at tick" in text
    # The main metrics are in view, the others unfold.
    shown, _, folded = text.partition('<details class="more">')
    assert '<td data-label="Metric">rms error</td>' in shown
    assert '<td data-label="Metric">final error</td>' not in shown
    assert '<td data-label="Metric">final error</td>' in folded
    assert call("diff", runs / "a", runs / "same", "--html", page).exit_code == 0
    assert "The runs are equal" in page.read_text(encoding="utf-8")


def test_page_escapes_what_comes_from_outside(runs: Path, tmp_path: Path) -> None:
    other = changed(runs / "a", tmp_path / "b", overrides={"<script>": "<b>"})
    task = (other / "task.yaml").read_text()
    (other / "task.yaml").write_text(task + "# <script>alert(1)</script>\n")
    assert call("diff", runs / "a", other, "--html", tmp_path / "d.html").exit_code == 1
    assert "<script>alert" not in (tmp_path / "d.html").read_text(encoding="utf-8")


def test_partial_run_is_taken_as_far_as_it_goes(runs: Path, tmp_path: Path) -> None:
    killed = changed(runs / "a", tmp_path / "killed", status="running")
    (killed / "summary.json").unlink()
    log = (killed / "log.arrow").read_bytes()
    (killed / "log.arrow").unlink()
    with closing(Log(killed / "log.arrow", keep=False)) as writer:
        writer.write(pa.ipc.open_stream(log).read_next_batch().slice(0, 150))
    seal_folder(killed)
    result = call("diff", runs / "a", killed, "--html", tmp_path / "d.html")
    assert result.exit_code == 1
    assert "taskspec: B: the run is partial" in result.stderr
    ticks = len(read_log(runs / "a" / "log.arrow"))
    assert (
        f"The logs are the same for 150 ticks; then A goes on for {ticks - 150}." in result.stdout
    )
    # Judged on the ticks that there are.
    assert "B  " in result.stdout
    assert "So far: " in result.stdout


def test_run_without_a_tick(runs: Path, tmp_path: Path) -> None:
    none = changed(runs / "a", tmp_path / "none", status="running")
    (none / "log.arrow").write_bytes(b"")
    result = call("diff", runs / "a", none, "--html", tmp_path / "d.html")
    assert result.exit_code == 1
    assert "There is no tick to compare in B." in result.stdout


def test_logs_are_compared_tick_by_tick() -> None:
    clock, nan = 0.001 * np.arange(50.0), float("nan")
    one, two = np.zeros(50), np.zeros(50)
    one[40:], two[40:] = nan, nan
    two[23], two[31], two[42] = 1.0, -3.0, 5.0
    stages = np.array(["press"] * 50)
    a = History({"clock": clock, "x": one, "mine": one}, stages)
    b = History({"clock": clock[:45], "x": two[:45], "other": one[:45]}, stages[:45])
    found = diff_logs(a, b)
    assert found.ticks == (50, 45)
    assert found.only == (["mine"], ["other"])
    (apart,) = found.apart
    assert (apart.tick, apart.clock, apart.values) == (23, 0.023, (0.0, 1.0))
    # At tick 42 only one of them has a value, which is a difference without a size.
    assert (apart.largest, apart.at) == (3.0, 0.031)
    assert plain({"x": float("nan")}) == {"x": None}


def test_what_is_no_run_is_wrong_usage(runs: Path, tmp_path: Path) -> None:
    result = call("diff", runs / "a", tmp_path)
    assert result.exit_code == 2
    assert "it is not the folder of a run" in result.stderr
    result = call("diff", runs / "a", runs / "a", "--html", tmp_path / "page.txt")
    assert result.exit_code == 2
    assert "--html needs a file that ends in .html" in result.stderr
