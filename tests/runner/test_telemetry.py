"""What is seen of a run as it goes on: telemetry by UDP, and the line on a terminal."""

from __future__ import annotations

import json
import os
import pty
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from short_tasks import TAP
from typer.testing import CliRunner, Result

from taskspec.spec import load_task
from taskspec_runner.cli import app
from taskspec_runner.cli.progress import Trail, describe, sparkline
from taskspec_runner.errors import InputError
from taskspec_runner.loop import telemetry
from taskspec_runner.loop.telemetry import Address, Telemetry, message, read_address
from taskspec_runner.record.log import read_log
from taskspec_runner.record.nested import path_of
from taskspec_runner.session import Glimpse, execute

COMMAND = [sys.executable, "-c", "from taskspec_runner.cli import main; main()"]


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        found.bind(("127.0.0.1", 0))
        found.settimeout(5)
        yield found


def received(listener: socket.socket, number: int) -> list[dict[str, Any]]:
    return [json.loads(listener.recv(65535)) for _ in range(number)]


def values_of(tree: dict[str, Any], before: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    """Leaves of nested data by their path."""
    found = {}
    for name, value in tree.items():
        path = (*before, name)
        found |= values_of(value, path) if isinstance(value, dict) else {path: value}
    return found


# telemetry


@pytest.mark.parametrize(("query", "every"), [("", 10), ("?rate=50", 20), ("?rate=400", 2)])
def test_messages_are_rows_of_the_log(
    tap: Path, tmp_path: Path, listener: socket.socket, query: str, every: int
) -> None:
    address = f"udp://127.0.0.1:{listener.getsockname()[1]}{query}"
    # Read while the run goes on, as the tool that listens would.
    history_rows: list[dict[str, Any]] = []
    asked = threading.Event()

    def read() -> None:
        listener.settimeout(0.2)
        while not asked.is_set():
            try:
                history_rows.append(json.loads(listener.recv(65535)))
            except TimeoutError:
                continue

    reader = threading.Thread(target=read)
    reader.start()
    result = call("run", tap, "--out", tmp_path / "run", "--telemetry", address, "--quiet")
    time.sleep(0.3)
    asked.set()
    reader.join()
    assert (result.exit_code, result.output) == (0, "")
    history = read_log(tmp_path / "run" / "log.arrow")
    rows = range(0, len(history), every)
    assert len(history_rows) == len(rows)
    for row, told in zip(rows, history_rows, strict=True):
        assert told.pop("timestamp") == history.columns["clock"][row]
        assert told.pop("stage") == history.stages[row]
        expected = {
            path_of(name): values[row]
            for name, values in history.columns.items()
            if name != "clock" and np.isfinite(values[row])
        }
        # The function of distances is evaluated for one tick or for many, which rounds otherwise.
        assert values_of(told) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_names_are_nested_and_what_has_no_value_is_left_out() -> None:
    row = {"clock": 0.5, "stage": "press", "force.z": -10.0, "force.z.ref": float("nan"),
           "force.z.measured": -9.0, "joint.1.torque": 2.0, "door.torque.ref": 1.0}  # fmt: skip
    assert json.loads(message(row)) == {
        "timestamp": 0.5,
        "stage": "press",
        "force": {"z": -10.0, "z_measured": -9.0},
        "joint": {"1": {"torque": 2.0}},
        "door": {"torque_ref": 1.0},
    }


def test_run_is_the_same_with_telemetry(tap: Path, tmp_path: Path) -> None:
    sink = Telemetry(Address("127.0.0.1", 9))
    plain = execute(load_task(tap), tmp_path / "plain", report=False)
    sent = execute(load_task(tap), tmp_path / "sent", report=False, telemetry=sink)
    sink.close()
    assert sink.sent == -(-plain.summary["ticks"] // 10)
    for name in ("log.arrow", "summary.json"):
        assert (plain.folder / name).read_bytes() == (sent.folder / name).read_bytes()


def test_nobody_who_listens_is_no_trouble(tap: Path, listener: socket.socket) -> None:
    port = listener.getsockname()[1]
    listener.close()
    result = call("run", tap, "--out", tap.parent / "run", "--telemetry", f"udp://127.0.0.1:{port}")
    assert (result.exit_code, result.stderr) == (0, "")


def test_what_cannot_be_sent_is_told_once(tap: Path) -> None:
    # A socket may not broadcast unless it asks to: every message fails.
    where = "udp://255.255.255.255:9870"
    result = call("run", tap, "--out", tap.parent / "run", "--telemetry", where)
    assert result.exit_code == 0
    assert result.stderr == (
        "taskspec: telemetry to 255.255.255.255:9870 does not get through: Permission denied\n"
    )


def test_name_without_an_address_is_told_once(tap: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", fail)
    result = call("run", tap, "--out", tap.parent / "run", "--telemetry", "udp://nowhere:9870")
    assert result.exit_code == 0
    assert result.stderr == (
        "taskspec: telemetry to nowhere:9870 does not get through: Name or service not known\n"
    )


def test_name_server_that_does_not_answer_keeps_nothing_waiting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answered = threading.Event()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: [answered.wait(30)])
    monkeypatch.setattr(telemetry, "_PATIENCE", 0.05)
    began = time.monotonic()
    sink = Telemetry(Address("slow", 9870))
    assert time.monotonic() - began < 5
    assert sink.trouble == "telemetry to slow:9870 does not get through: slow has no address"
    sink.send({"clock": 0.0})
    assert sink.sent == 0
    answered.set()


def test_full_buffer_drops_the_message() -> None:
    class Full:
        def sendto(self, *_: object) -> None:
            raise BlockingIOError

        def close(self) -> None:
            pass

    sink = Telemetry(Address("127.0.0.1", 9))
    sink.close()
    sink._socket = Full()  # type: ignore[assignment]
    sink.send({"clock": 0.0})
    assert (sink.sent, sink.trouble) == (0, "")


@pytest.mark.parametrize(
    "address",
    ["localhost:9870", "tcp://localhost:9870", "udp://localhost", "udp://:9870", "udp://h:99999",
     "udp://h:9870/x", "udp://h:9870?rate=0", "udp://h:9870?rate=fast", "udp://h:9870?hz=5"],
)  # fmt: skip
def test_address_that_is_none_is_wrong_usage(tap: Path, address: str) -> None:
    result = call("run", tap, "--telemetry", address)
    assert result.exit_code == 2
    assert "--telemetry needs" in result.stderr
    with pytest.raises(InputError):
        read_address(address)


def test_addresses() -> None:
    assert read_address("udp://127.0.0.1:9870") == Address("127.0.0.1", 9870, 100.0)
    assert read_address("udp://[::1]:9870?rate=25") == Address("::1", 9870, 25.0)


# the line on a terminal


def test_sparkline_goes_from_zero_to_the_top() -> None:
    assert sparkline([-1.0, 0.0, 5.0, 10.0, 12.0], 10.0) == "▁▁▅██"
    assert sparkline([0.0, 0.0], 0.0) == "▁▁"
    assert sparkline([], 1.0) == ""


def glimpse(clock: float, force: float, axis: str = "z") -> Glimpse:
    return Glimpse(clock, "press", axis, force, -10.0 if axis else 0.0, 30.0)


def test_trail_holds_the_last_seconds_of_simulated_time() -> None:
    trail = Trail()
    for tick in range(500):  # 10 s
        trail.add(glimpse(0.02 * tick, -10.0 if tick > 400 else 0.0))
    drawn = trail.drawn(glimpse(10.0, -10.0), 100)
    # 3 s in steps of 0.1 s; the force, wanted downwards, is there for the last 2 s.
    assert len(drawn) == 30
    assert drawn == "▁" * 11 + "█" * 19
    assert trail.drawn(glimpse(10.0, -10.0), 12) == "█" * 12
    assert trail.drawn(glimpse(10.0, -10.0), 5) == ""
    trail.add(glimpse(10.1, 0.0, axis=""))
    assert trail.drawn(glimpse(10.1, 0.0, axis=""), 100) == ""


def test_line_without_a_set_point_has_no_force() -> None:
    assert "force" not in describe(glimpse(1.0, 0.0, axis=""))
    assert "force.z" in describe(glimpse(1.0, -9.0))


@pytest.mark.parametrize(("encoding", "blocks"), [("utf-8", True), ("ascii", False)])
def test_terminal_shows_the_force_as_blocks(tmp_path: Path, encoding: str, blocks: bool) -> None:
    task = tmp_path / "tap.yaml"
    task.write_text(TAP.replace("time: 0.3 s", "time: 30 s"), encoding="utf-8")
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "PYTHONIOENCODING": encoding}
    command = [*COMMAND, "run", task, "--out", tmp_path / "run"]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=theirs, env=environment
    ) as process:
        os.close(theirs)
        seen = b""
        while True:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the other side is closed
                break
            seen += part
        os.close(ours)
    assert process.returncode == 0
    text = seen.decode("utf-8", "replace")
    assert "force.x" in text
    assert bool(re.search("[▁▂▃▄▅▆▇█]{8,}", text)) == blocks


def test_no_line_where_there_is_no_terminal(tap: Path, tmp_path: Path) -> None:
    command = [*COMMAND, "run", tap, "--out", tmp_path / "run"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
