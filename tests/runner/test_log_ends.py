"""Where a log ends: with its task, before it does, or nobody knows.

The last stage of a log is over by what was recorded of it: its `time`, `until` and `within` over
the ticks. What no log shows, such as that moves are done, is undecided unless the log itself
says it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import call
from short_tasks import TAP

from taskspec.spec import load_task
from taskspec_runner.export import export_run
from taskspec_runner.runs import Run
from taskspec_runner.session import execute

#: Touches the wall at 0.114 s, then presses until the file says that it is over.
LAST = "    time: 0.3 s\n"
MOVES = "  back:\n    axes: {x: {move: -5 mm}}\n"
UNTIL = "    until: force.x > 4.9 N\n    within: {time: 1 s}\n"
NEVER = "    until: force.x > 50 N\n    within: {time: 1 s}\n"

Made = Callable[[str], tuple[Path, Run]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A task with its run."""
    runs: dict[str, tuple[Path, Run]] = {}

    def make(text: str) -> tuple[Path, Run]:
        if text not in runs:
            folder = tmp_path_factory.mktemp("ends")
            task = folder / "tap.yaml"
            task.write_text(text, encoding="utf-8")
            runs[text] = task, execute(load_task(task), folder / "run", report=False)
        return runs[text]

    return make


def ends(last: str) -> str:
    assert TAP.count(LAST) == 1
    return TAP.replace(LAST, last)


def logged(run: Run, path: Path, ticks: int, *names: str, after: str = "") -> Path:
    """The first ticks of a run as another recorder has them: time, mode, and some columns."""
    columns = {name: run.columns[name][:ticks] for name in names or ("force.x", "error.y")}
    units = {"force.x": " [N]", "error.y": " [m]"}
    lines = [",".join(["clock [s]", "mode", *(f"{n}{units.get(n, '')}" for n in columns)])]
    rows = zip(run.columns["clock"][:ticks], run.history.stages[:ticks], *columns.values(),
               strict=True)  # fmt: skip
    lines += [",".join(str(each) for each in row) for row in rows]
    if after:
        lines.append(",".join([f"{ticks * run.period:.6f}", after, *[""] * len(columns)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def judge(task: Path, log: Path, way: str, out: Path, *others: str) -> tuple[int, str]:
    """Exit code and output; the folder that was made says the same again."""
    said = {
        "column": "stage: mode\n",
        "times": "stages: [{stage: approach, at: 0 s}, {stage: hold, at: 0.114 s}"
        + "".join(f", {each}" for each in others) + "]\n",
        "guards": "gap: 10 ms\n",
    }  # fmt: skip
    columns = log.with_name("map.yaml")
    columns.write_text(said[way], encoding="utf-8")
    result = call("judge", task, log, "--columns", columns, "--out", out)
    again = call("judge", out)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["exit_code"] == result.exit_code == again.exit_code, again.output
    return result.exit_code, " ".join(result.stdout.split())


WAYS = ("column", "times", "guards")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("ticks", "code"), [(200, 6), (410, 6), (414, 0)])
def test_a_time_that_is_not_over_is_no_success(
    made: Made, tmp_path: Path, way: str, ticks: int, code: int
) -> None:
    """0.3 s from tick 114 on: tick 413 is the last, and the tick that ends it is not recorded."""
    task, run = made(TAP)
    assert len(run) == 414
    found, text = judge(task, logged(run, tmp_path / "log.csv", ticks), way, tmp_path / "out")
    assert found == code, text
    if code:
        assert "into the stage, which takes 0.3 s" in text
        assert Run.load(tmp_path / "out").verdict == "failed"


def test_a_slow_log_is_over_if_its_next_sample_would_come_after_the_end(
    made: Made, tmp_path: Path
) -> None:
    """Each tenth tick: 410 is the last one recorded, and 420 would be after 414; 400 is not."""
    task, run = made(TAP)
    whole = logged(run, tmp_path / "whole.csv", len(run)).read_text().splitlines()
    for last, code in ((411, 0), (401, 6)):
        slow = tmp_path / "slow.csv"
        slow.write_text("\n".join([whole[0], *whole[1 : last + 1 : 10]]) + "\n")
        found, text = judge(task, slow, "column", tmp_path / f"out{last}")
        assert found == code, text


@pytest.mark.parametrize("way", WAYS)
def test_a_guard_that_never_held_is_no_success(made: Made, tmp_path: Path, way: str) -> None:
    task, run = made(TAP)
    task = tmp_path / "never.yaml"
    task.write_text(ends(NEVER), encoding="utf-8")
    found, text = judge(task, logged(run, tmp_path / "log.csv", 300), way, tmp_path / "out")
    assert found == 6, text
    assert "the log ends before `force.x > 50 N` held" in text


@pytest.mark.parametrize("way", WAYS)
def test_a_guard_that_held_ends_the_task(made: Made, tmp_path: Path, way: str) -> None:
    """The same log, of which the force is more than 4.9 N some ticks before its end."""
    _, run = made(TAP)
    task = tmp_path / "until.yaml"
    task.write_text(ends(UNTIL), encoding="utf-8")
    above = np.flatnonzero(run.columns["force.x"] > 4.9)
    first = int(above[above > 114][0])
    log = logged(run, tmp_path / "log.csv", first + 1)
    found, text = judge(task, log, way, tmp_path / "out")
    assert found == 0, text
    found, text = judge(task, logged(run, log, first), way, tmp_path / "before")
    assert found == 6, text


def test_what_was_not_recorded_leaves_it_open_until_within_is_over(
    made: Made, tmp_path: Path
) -> None:
    """Without the force nobody knows whether `until` held; beyond `within` it had not."""
    _, run = made(TAP)
    task = tmp_path / "until.yaml"
    text = ends(UNTIL.replace("1 s", "0.2 s"))
    task.write_text(text[: text.index("expect:")] + "expect:\n  - max(abs(error.y)) < 1 mm\n")
    for ticks, code in ((300, 5), (400, 6)):
        log = logged(run, tmp_path / "log.csv", ticks, "error.y")
        found, said = judge(task, log, "column", tmp_path / f"out{ticks}")
        assert found == code, said
        verdict = {5: "undecided", 6: "failed"}[code]
        assert Run.load(tmp_path / f"out{ticks}").verdict == verdict
    assert "`within` was over at 0.314 s, which leads to fail" in said


def test_moves_that_are_done_show_in_no_log_but_may_be_stated(made: Made, tmp_path: Path) -> None:
    task, run = made(TAP.replace("expect:", f"{MOVES}expect:"))
    back = int(np.flatnonzero(run.history.stages == "back")[0])
    for ticks in (back + 5, len(run)):
        log = logged(run, tmp_path / "log.csv", ticks)
        found, text = judge(task, log, "column", tmp_path / f"out{ticks}")
        assert found == 5, text
        assert "that its moves are done shows in no log" in text
        assert "so far: 4 of 4 expectations met until the log ends" in text
    page = (tmp_path / f"out{ticks}" / "report.html").read_text(encoding="utf-8")
    assert "that its moves are done shows in no log" in page
    for after, code in (("end", 0), ("fail", 6)):
        log = logged(run, tmp_path / "log.csv", len(run), after=after)
        found, text = judge(task, log, "column", tmp_path / after)
        assert found == code, text
        assert len(Run.load(tmp_path / after)) == len(run)
        at = f"{{stage: {after}, at: {run.end:.6f} s}}"
        rest = (f"{{stage: back, at: {back * run.period:.6f} s}}", at)
        found, text = judge(task, log, "times", tmp_path / f"times-{after}", *rest)
        assert found == code, text
        assert len(Run.load(tmp_path / f"times-{after}")) == len(run)


def test_what_a_log_states_does_not_overrule_its_times(made: Made, tmp_path: Path) -> None:
    task, run = made(TAP)
    log = logged(run, tmp_path / "log.csv", 200, after="end")
    assert judge(task, log, "column", tmp_path / "out")[0] == 6


@pytest.mark.parametrize("form", ["csv", "parquet", "mcap"])
def test_an_export_says_that_its_run_ended_and_a_cut_one_does_not(
    made: Made, tmp_path: Path, form: str
) -> None:
    """Of moves, and of a guard that holds at a tick which is no tick of the stage any more."""
    for number, text in enumerate((TAP.replace("expect:", f"{MOVES}expect:"), ends(UNTIL))):
        task, run = made(text)
        log = export_run(run, form, tmp_path / f"{number}.{form}").path
        whole = call("judge", task, log, "--out", tmp_path / f"whole{number}")
        assert whole.exit_code == run.exit_code == 0, whole.output
        if form == "mcap":
            continue
        if form == "csv":
            lines = log.read_text().splitlines()
            assert lines[-1].endswith(",end") or ",end," in lines[-1]
            log.write_text("\n".join(lines[:-1]) + "\n")
        else:
            table = pq.read_table(log)
            pq.write_table(table.slice(0, len(table) - 1), log)
        cut = call("judge", task, log, "--out", tmp_path / f"cut{number}")
        assert cut.exit_code == (5, 6)[number], cut.output


def test_a_window_of_an_export_does_not_say_that_the_run_ended(made: Made, tmp_path: Path) -> None:
    task, run = made(TAP.replace("expect:", f"{MOVES}expect:"))
    for form in ("csv", "parquet"):
        log = export_run(run, form, tmp_path / f"log.{form}", end=run.end - 0.01).path
        assert call("judge", task, log, "--out", tmp_path / form).exit_code == 5


def test_an_export_of_a_run_that_was_stopped_is_no_success(made: Made, tmp_path: Path) -> None:
    """A limit ends the last stage, of which no time says that it was not over."""
    text = TAP.replace("expect:", f"{MOVES}    limits: {{speed: 1 mm/s}}\nexpect:")
    task, run = made(text)
    assert (run.exit_code, run.stages[-1]) == (4, "back")
    for form in ("csv", "parquet", "mcap"):
        log = export_run(run, form, tmp_path / f"log.{form}").path
        found = call("judge", task, log, "--out", tmp_path / form)
        assert found.exit_code == 6, found.output
