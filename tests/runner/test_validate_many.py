"""Many files: the same findings in the same order by one process and by several."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from taskspec_runner.cli import parallel
from taskspec_runner.cli.formats import DiagnosticFormat
from taskspec_runner.cli.reporters import REPORTERS
from taskspec_runner.cli.validate import examine

ERRORS = Path(__file__).parents[1] / "corpus" / "err"
COMMAND = [sys.executable, "-c", "from taskspec_runner.cli import main; main()", "validate"]


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Wrong, unreadable and sound files, in turn."""
    sources = sorted(ERRORS.glob("TS1*.yaml"))[:20]
    made = []
    for i in range(parallel.FEWEST + 3):
        path = tmp_path / f"t{i:03}.yaml"
        path.write_bytes(b"\xff" if i % 7 == 3 else sources[i % 20].read_bytes())
        made.append(path)
    made[5].unlink()
    return made


def test_same_findings_by_several_processes(
    files: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parallel, "processors", lambda: 1)
    alone = examine(files)
    monkeypatch.setattr(parallel, "processors", lambda: 2)
    together = examine(files)
    assert together == alone
    assert list(together.diagnostics) == list(alone.diagnostics)
    assert together.exit_code == 2
    for form in DiagnosticFormat:
        assert REPORTERS[form].report(together) == REPORTERS[form].report(alone)


def _where(path: Path) -> tuple[str, int]:
    return path.name, os.getpid()


def _dies(path: Path) -> str:
    if path.name == "3" and os.getpid() != int(os.environ["TASKSPEC_TEST_PARENT"]):
        os._exit(1)
    return path.name


def test_only_many_files_are_shared_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "processors", lambda: 2)
    few = [Path(str(i)) for i in range(parallel.FEWEST - 1)]
    assert {pid for _, pid in parallel.in_order(_where, few)} == {os.getpid()}
    many = [*few, Path("last")]
    found = list(parallel.in_order(_where, many))
    assert [name for name, _ in found] == [path.name for path in many]
    assert os.getpid() not in {pid for _, pid in found}


def test_a_lost_process_loses_no_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "processors", lambda: 2)
    monkeypatch.setenv("TASKSPEC_TEST_PARENT", str(os.getpid()))
    files = [Path(str(i)) for i in range(parallel.FEWEST)]
    assert list(parallel.in_order(_dies, files)) == [path.name for path in files]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupting_leaves_nothing_behind(tmp_path: Path, number: signal.Signals) -> None:
    text = (Path(__file__).parents[2] / "tasks" / "press-saturated.yaml").read_text("utf-8")
    for i in range(400):
        (tmp_path / f"t{i}.yaml").write_text(text, "utf-8")
    process = subprocess.Popen(
        [*COMMAND, str(tmp_path)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    end = time.monotonic() + 30
    while len(children.read_text().split()) < 2 and time.monotonic() < end:
        time.sleep(0.05)
    begun = children.read_text().split()
    assert begun or parallel.processors() == 1
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert "Traceback" not in out + err
    for child in begun:
        while Path(f"/proc/{child}").exists() and time.monotonic() < end + 30:
            time.sleep(0.05)
        assert not Path(f"/proc/{child}").exists()
