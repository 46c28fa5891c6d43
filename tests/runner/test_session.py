from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from taskspec.spec import load_task, load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner.errors import OutputError, RunCrashedError
from taskspec_runner.record.log import Log, read_log
from taskspec_runner.runs import Run
from taskspec_runner.session import Glimpse, execute


def run(task: Path, out: Path, **overrides: str) -> Run:
    sets = {key.replace("__", "."): value for key, value in overrides.items()}
    return execute(load_task(task, sets), out, report=False)


def manifest(folder: Path) -> dict[str, object]:
    found = json.loads((folder / "manifest.json").read_text())
    assert isinstance(found, dict)
    return found


def test_leaves_the_whole_folder(tap: Path, tmp_path: Path) -> None:
    result = execute(load_task(tap), tmp_path / "run", seed=3)
    assert {path.name for path in result.folder.iterdir()} == {
        "task.yaml", "manifest.json", "log.arrow", "summary.json", "report.html"
    }  # fmt: skip
    assert result.exit_code == 0
    assert all(j.passed for j in result.expectations)
    assert result.report == tmp_path / "run" / "report.html"
    assert (result.folder / "task.yaml").read_bytes() == tap.read_bytes()
    said = manifest(result.folder)
    assert (said["status"], said["seed"], said["exit_code"]) == ("done", 3, 0)
    versions = said["versions"]
    assert isinstance(versions, dict)
    assert versions["python"] == platform.python_version()
    assert set(versions) >= {"taskspec", "mujoco", "pin", "casadi", "numpy"}


def test_summary_tells_the_run(tap: Path, tmp_path: Path) -> None:
    result = run(tap, tmp_path / "run")
    summary = json.loads((result.folder / "summary.json").read_text())
    assert summary == result.summary
    assert [s["name"] for s in summary["stages"]] == ["approach", "hold"]
    first, second = summary["stages"]
    assert first["start"] == 0
    assert first["end"] == second["start"]
    assert (first["ended_by"]["kind"], first["ended_by"]["to"]) == ("until", "hold")
    assert second["ended_by"]["to"] == "end"
    assert second["end"] == summary["duration"] == summary["ticks"] * summary["period"]
    history = read_log(result.folder / "log.arrow")
    assert len(history) == summary["ticks"]
    rows = history.window("hold")
    error = history.columns["force.x.ref"][rows] - history.columns["force.x"][rows]
    metrics = summary["metrics"]["hold"]
    assert metrics["force.x"]["rms_error"] == pytest.approx(np.sqrt(np.mean(error**2)))
    # The force axis has no motion reference, so nothing is said about its position.
    assert set(metrics) == {"force.x", "position.y"}
    assert summary["peaks"]["hold"]["force"] == pytest.approx(
        np.hypot(history.columns["force.x"][rows], history.columns["force.y"][rows]).max()
    )


def test_same_file_and_seed_give_the_same_bytes(tap: Path, tmp_path: Path) -> None:
    first, second = (run(tap, tmp_path / name) for name in "ab")
    for name in ("log.arrow", "summary.json", "task.yaml"):
        assert (first.folder / name).read_bytes() == (second.folder / name).read_bytes(), name


def test_task_is_kept_byte_by_byte(tap: Path, tmp_path: Path) -> None:
    tap.write_bytes(b"\xef\xbb\xbf" + tap.read_bytes().replace(b"\n", b"\r\n"))
    result = run(tap, tmp_path / "run")
    assert (result.folder / "task.yaml").read_bytes() == tap.read_bytes()


def test_task_from_a_text_is_kept(tap: Path, tmp_path: Path) -> None:
    loaded = load_text(tap.read_text(), "tap")
    result = execute(loaded, tmp_path / "run", report=False)
    assert (result.folder / "task.yaml").read_text() == tap.read_text()


def test_missed_expectation(tap: Path, tmp_path: Path) -> None:
    tap.write_text(tap.read_text() + "  - max(force.x) < 1 N\n")
    result = run(tap, tmp_path / "run")
    assert result.exit_code == 1
    assert result.summary["status"] == "done"
    assert [j.passed for j in result.expectations] == [True, True, True, True, False]


def test_limit_stops_the_run(tap: Path, tmp_path: Path) -> None:
    result = run(tap, tmp_path / "run", limits="{force: 3 N}")
    assert result.exit_code == 4
    ending = result.summary["ending"]
    assert (result.summary["status"], ending["reason"]) == ("stopped", "force")
    assert manifest(result.folder)["status"] == "stopped"
    last = result.summary["stages"][-1]["ended_by"]
    assert last["kind"] == "limit"
    assert last["value"] > 3
    # The tick that broke the limit is in the log.
    assert len(read_log(result.folder / "log.arrow")) == result.summary["ticks"]


def test_bound_reached_fails_the_run(tap: Path, tmp_path: Path) -> None:
    result = run(tap, tmp_path / "run", stages__approach__within__time="50 ms")
    assert result.exit_code == 6
    assert (result.summary["status"], result.summary["ending"]["reason"]) == ("failed", "time")
    assert result.expectations[0].explanation == "stage 'hold' was never visited"


def test_wrong_task_leaves_no_folder(tap: Path, tmp_path: Path) -> None:
    with pytest.raises(SpecError):
        run(tap, tmp_path / "run", robot__start="{xyz: [5 m, 0, 0]}")
    assert not (tmp_path / "run").exists()


def test_default_folder_is_numbered(
    tap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    loaded = load_task(tap)
    folders = [execute(loaded, report=False).folder for _ in range(3)]
    assert folders == [Path("runs/tap"), Path("runs/tap-2"), Path("runs/tap-3")]


def test_earlier_run_is_replaced_and_nothing_else(tap: Path, tmp_path: Path) -> None:
    run(tap, tmp_path / "run")
    (tmp_path / "run" / "notes.txt").write_text("mine")
    (tmp_path / "run" / "crash.txt").write_text("old")
    run(tap, tmp_path / "run")
    assert (tmp_path / "run" / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "run" / "crash.txt").exists()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError, match="not empty and holds no run"):
        run(tap, tmp_path / "other")


def test_folder_that_cannot_be_made(tap: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"cannot write .*Not a directory"):
        run(tap, tmp_path / "file" / "run")


def test_disk_that_is_full(tap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Log, "write", full)
    with pytest.raises(OutputError, match="No space left on device"):
        run(tap, tmp_path / "run", stages__hold__time="0.6 s")
    assert manifest(tmp_path / "run")["status"] == "crashed"


@pytest.fixture
def by_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python's loop, which looks up every few ticks; the native one runs a short task whole."""
    monkeypatch.setenv("TASKSPEC_LOOP", "python")


@pytest.mark.usefixtures("by_python")
def test_crash_keeps_the_log_and_its_trace(tap: Path, tmp_path: Path) -> None:
    loaded = load_task(tap)

    def broken(look: Callable[[], Glimpse]) -> None:
        if look().clock > 0.2:
            raise ZeroDivisionError("as a test")

    with pytest.raises(RunCrashedError, match="ZeroDivisionError: as a test") as caught:
        execute(loaded, tmp_path / "run", progress=broken)
    assert caught.value.trace == tmp_path / "run" / "crash.txt"
    assert "Traceback" in caught.value.trace.read_text()
    said = manifest(tmp_path / "run")
    assert (said["status"], said["reason"]) == ("crashed", "ZeroDivisionError: as a test")
    assert len(read_log(tmp_path / "run" / "log.arrow")) == pytest.approx(220, abs=21)


@pytest.mark.usefixtures("by_python")
def test_interrupt_ends_between_two_ticks(tap: Path, tmp_path: Path) -> None:
    seen: list[Glimpse] = []

    def progress(look: Callable[[], Glimpse]) -> None:
        seen.append(look())
        if len(seen) == 8:
            os.kill(os.getpid(), signal.SIGINT)

    usual = signal.getsignal(signal.SIGINT)
    result = execute(load_task(tap), tmp_path / "run", progress=progress, report=False)
    assert signal.getsignal(signal.SIGINT) is usual
    assert result.exit_code == 130
    said = manifest(result.folder)
    assert (said["status"], said["reason"]) == ("stopped", "interrupted")
    ticks = result.summary["ticks"]
    assert ticks == len(read_log(result.folder / "log.arrow")) == 180
    last = result.summary["stages"][-1]
    assert (last["name"], last["end"]) == ("hold", pytest.approx(0.18))
    assert last["ended_by"]["name"] == "interrupted"


@pytest.mark.usefixtures("by_python")
def test_glimpse_shows_the_first_force_axis(tap: Path, tmp_path: Path) -> None:
    seen: list[Glimpse] = []
    execute(load_task(tap), tmp_path / "run", progress=lambda look: seen.append(look()))
    assert [g.clock for g in seen] == sorted(g.clock for g in seen)
    assert seen[0].stage == "approach"
    assert seen[0].axis == ""
    assert seen[-1].stage == "hold"
    assert seen[-1].axis == "x"
    assert seen[-1].reference == pytest.approx(5)
    assert seen[-1].force == pytest.approx(5, abs=1)
    assert seen[-1].real_time_factor > 0


def test_killed_run_is_readable_to_its_last_batch(tap: Path, tmp_path: Path) -> None:
    tap.write_text(tap.read_text().replace("time: 0.3 s", "time: 1000 s"))
    code = (
        "from pathlib import Path; import sys\n"
        "from taskspec.spec import load_task; from taskspec_runner.session import execute\n"
        "execute(load_task(Path(sys.argv[1])), Path(sys.argv[2]))"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tap), str(tmp_path / "run")])
    log = tmp_path / "run" / "log.arrow"
    deadline = time.monotonic() + 60
    try:
        while not (log.exists() and log.stat().st_size > 300_000):
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.02)
    finally:
        process.kill()
        process.wait()
    assert manifest(tmp_path / "run")["status"] == "running"
    whole = read_log(log)
    assert len(whole) >= 500
    assert len(whole) % 500 == 0
    # It may have been killed on the way through the next batch, of which there is a part then.
    while len(cut := read_log(log)) == len(whole):
        log.write_bytes(log.read_bytes()[:-7777])
    # Of a batch that is not complete, nothing is taken.
    assert len(cut) == len(whole) - 500
    np.testing.assert_allclose(np.diff(whole.columns["clock"]), 1e-3)


def test_log_of_a_finished_run_ends_properly(tap: Path, tmp_path: Path) -> None:
    result = run(tap, tmp_path / "run")
    table = pa.ipc.open_stream(result.folder / "log.arrow").read_all()
    assert table.num_rows == result.summary["ticks"]
