"""A run that was killed: what it left is read, and it is told that there is no more."""

from __future__ import annotations

import csv
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from sealed import seal_folder
from short_tasks import TAP
from typer.testing import CliRunner, Result

from taskspec_runner.cli import app
from taskspec_runner.record.log import read_log
from taskspec_runner.record.recorder import BATCH, ROOM
from taskspec_runner.runs import Run
from taskspec_runner.verdict.outcome import verdict

#: Presses for so long that it is not over when it is killed.
LONG = TAP.replace("time: 0.3 s", "time: 600 s")
COMMAND = [sys.executable, "-c", "from taskspec_runner.cli import main; main()"]


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run after SIGKILL in the middle."""
    here = tmp_path_factory.mktemp("killed")
    task, out = here / "tap.yaml", here / "run"
    task.write_text(LONG, encoding="utf-8")
    process = subprocess.Popen([*COMMAND, "run", task, "--out", out])
    try:
        began = time.monotonic()
        while not ((out / "log.arrow").is_file() and len(read_log(out / "log.arrow")) > 2000):
            assert process.poll() is None
            assert time.monotonic() - began < 60
            time.sleep(0.02)
    finally:
        process.kill()
        assert process.wait() == -signal.SIGKILL
    return out


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


def told(result: Run) -> tuple[int, float]:
    """Ticks and end that a message about a partial run states."""
    said = "the run is partial: it was killed; "
    match = re.fullmatch(
        re.escape(f"taskspec: {said}") + r"its log holds (\d+) ticks, until (\d+\.\d{3}) s\n",
        result.stderr,
    )
    assert match is not None, result.stderr
    return int(match[1]), float(match[2])


def test_report_shows_what_there_is_and_that_it_is_partial(killed: Path) -> None:
    result = call("report", killed)
    assert result.exit_code == 0
    ticks, until = told(result)
    written = len(read_log(killed / "log.arrow"))
    assert written % BATCH == 0
    # Those of the batches that were yet to be written are there, too.
    assert written <= ticks <= written + ROOM
    assert ticks > 2000
    assert until == pytest.approx(1e-3 * ticks, abs=5e-4)
    page = (killed / "report.html").read_text(encoding="utf-8")
    assert f"Its log holds {ticks} ticks, until {until:.3f} s." in page
    assert "The run did not finish: it was killed." in page
    assert "of 4 expectations met on the ticks that there are" in page
    run = Run(killed)
    assert np.array_equal(run.columns["clock"], 1e-3 * np.arange(ticks))
    assert verdict(run).kind == "unfinished"
    assert [visit.stage for visit in run.visits] == ["approach", "hold"]


def test_export_writes_what_there_is_and_says_that_it_is_partial(killed: Path) -> None:
    result = call("export", killed, "--csv", "--mcap")
    assert result.exit_code == 0
    ticks, _ = told(result)
    with (killed / "log.csv").open(encoding="utf-8", newline="") as file:
        assert sum(1 for _ in csv.reader(file)) == ticks + 1


@pytest.mark.parametrize("left", [0.999, 0.5, 0.0])
def test_log_that_ends_within_a_batch(killed: Path, tmp_path: Path, left: float) -> None:
    """The machine lost its power: what is on the disk ends anywhere."""
    copy = tmp_path / "run"
    copy.mkdir()
    for name in ("manifest.json", "task.yaml"):
        (copy / name).write_bytes((killed / name).read_bytes())
    log = (killed / "log.arrow").read_bytes()
    (copy / "log.arrow").write_bytes(log[: int(left * len(log))])
    whole = len(read_log(killed / "log.arrow"))
    result = call("report", copy)
    assert result.exit_code == 0
    if not left:
        assert result.stderr.endswith("its log holds no tick\n")
        result = call("export", copy, "--csv")
        assert result.exit_code == 2
        assert "holds no tick, so there is nothing to export" in result.stderr
        return
    ticks, _ = told(result)
    assert left * whole - BATCH <= ticks < whole
    assert told(call("export", copy, "--parquet"))[0] == ticks


def test_run_that_was_killed_after_it_was_judged_is_whole(tap: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    seal_folder(out, status="running", reason=None)
    result = call("report", out)
    assert (result.exit_code, result.stderr) == (0, "")
    assert verdict(Run(out)).kind == "passed"
