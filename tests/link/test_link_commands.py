"""`taskspec plant` and `taskspec run --on` as commands, and what they say of what is wrong."""

from __future__ import annotations

import socket
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from meeting import TOUCH, Serving, program_of
from typer.testing import CliRunner, Result

import taskspec
import taskspec_runner
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.link import found, packets
from taskspec_runner.link.packets import Packet
from taskspec_runner.link.robot import RobotFacts
from taskspec_runner.link.simulated import SimulatedRobot
from taskspec_runner.link.udp_robot import UdpRobot

COMMAND = [sys.executable, "-c", "from taskspec_runner.cli import main; main()"]


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


@pytest.fixture
def touch(tmp_path: Path) -> Path:
    path = tmp_path / "touch.yaml"
    path.write_text(TOUCH, encoding="utf-8")
    return path


@pytest.fixture
def port() -> int:
    """One that is free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        return int(made.getsockname()[1])


def test_two_commands_and_a_run(touch: Path, tmp_path: Path, port: int) -> None:
    url = f"udp://127.0.0.1:{port}"
    serving = subprocess.Popen(
        [*COMMAND, "plant", touch, "--listen", url, "--out", tmp_path / "served"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    driven = call("run", touch, "--on", url, "--out", tmp_path / "driven")
    out, err = serving.communicate(timeout=60)
    assert (driven.exit_code, serving.returncode) == (0, 0), driven.output + err
    assert "on the robot in lock-step, " in driven.output
    assert "2 of 2 expectations met; as measured" in driven.output
    assert "driven by taskspec " in out
    assert f"listening at {url}" in err
    page = (tmp_path / "driven" / "report.html").read_text("utf-8")
    assert "on the robot in lock-step" in page
    # A run that was measured is judged again, and read, as any other.
    assert call("judge", tmp_path / "driven").exit_code == 0
    run = taskspec_runner.read(tmp_path / "driven")
    assert "as measured" in run.reason
    assert call("plant", touch, "--listen", url, "--wait", "0.1").exit_code == 2


def test_python_runs_on_a_robot(tmp_path: Path) -> None:
    task = taskspec.load_text(TOUCH, "touch.yaml") if hasattr(taskspec, "load_text") else None
    if task is None:
        from taskspec.spec import load_text

        task = load_text(TOUCH, "touch.yaml")
    with Serving(TOUCH, tmp_path / "served") as serving:
        run = taskspec_runner.run(task, tmp_path / "driven", report=False, robot=serving.url)
        assert serving.run.passed
    assert run.passed
    again = taskspec_runner.run(
        task, tmp_path / "again", report=False, robot=SimulatedRobot(program_of(TOUCH))
    )
    assert len(again) == len(run)


def test_robots_are_found_by_entry_points(
    monkeypatch: pytest.MonkeyPatch, touch: Path, tmp_path: Path
) -> None:
    made = []

    def opened(url: str) -> SimulatedRobot:
        made.append(url)
        return SimulatedRobot(program_of(TOUCH))

    monkeypatch.setattr(sys.modules[__name__], "_opened", opened, raising=False)
    points = [
        EntryPoint("mine", f"{__name__}:_opened", found.GROUP),
        EntryPoint("broken", "no_such_module:robot", found.GROUP),
    ]
    monkeypatch.setattr(found, "entry_points", lambda group: points if group == found.GROUP else [])
    result = call("run", touch, "--on", "mine://arm", "--out", tmp_path / "run")
    assert (result.exit_code, made) == (0, ["mine://arm"]), result.output
    for url, said in {
        "mime://arm": "no robot is known as 'mime'; did you mean 'mine'?",
        "broken://arm": "failed with ModuleNotFoundError",
    }.items():
        result = call("run", touch, "--on", url, "--out", tmp_path / "run")
        assert result.exit_code == 2
        assert said in " ".join(result.output.split())


WRONG = {
    ("run", "--on", "udp://127.0.0.1"): "--on needs udp://HOST:PORT, such as",
    ("run", "--on", "127.0.0.1:5"): "--on needs udp://HOST:PORT, such as",
    ("run", "--on", "udp://127.0.0.1:0"): "--on needs udp://HOST:PORT, such as",
    ("run", "--on", "udp://h:5", "--lost", "wait"): "--lost is catch-up or hold, not 'wait'",
    ("run", "--on", "udp://h:5", "--world", "1"): "--world is of a simulated plant",
    ("run", "--on", "udp://h:5", "--seed", "3"): "--seed is of a simulated plant",
    ("run", "--on", "udp://h:5", "--loop", "native"): "--loop native is of a simulated plant",
    ("run", "--on", "udp://h:5", "--watch"): "--watch is of a simulated plant",
    ("run", "--on", "udp://no.such.host.invalid:5"): "has no address",
    ("plant", "--listen", "udp://here"): "--listen needs udp://HOST:PORT, such as",
    ("plant", "--listen", "udp://0.0.0.0:0"): "add --open to mean it",
    ("plant", "--listen", "udp://127.0.0.1:0", "--wait", "0.2"): "no controller has said hello",
    ("plant", "--listen", "udp://203.0.113.7:5", "--open"): "cannot listen at udp://203.0.113.7:5",
}


@pytest.mark.parametrize("arguments", WRONG)
def test_what_cannot_be_used_is_told(arguments: tuple[str, ...], touch: Path) -> None:
    command, *options = arguments
    result = call(command, touch, *options)
    assert result.exit_code == 2
    assert WRONG[arguments] in " ".join(result.output.split())


def test_port_that_is_taken_is_told(touch: Path, port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", port))
        result = call("plant", touch, "--listen", f"udp://127.0.0.1:{port}")
    assert result.exit_code == 2
    assert "choose another port, or port 0" in " ".join(result.output.split())


def test_nobody_there_is_told(port: int) -> None:
    said: list[str] = []
    with pytest.raises(InputError, match=r"no plant answers at .* in 1.2 s \(nothing listens"):
        UdpRobot(f"udp://127.0.0.1:{port}", patience=1.2, say=said.append)
    assert said == [f"waiting for udp://127.0.0.1:{port}: 1 s of 1 s"]


def answering(answer: bytes) -> tuple[socket.socket, str]:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(10)

    def reply() -> None:
        _, peer = made.recvfrom(65535)
        made.sendto(answer, peer)

    import threading

    threading.Thread(target=reply, daemon=True).start()
    return made, f"udp://127.0.0.1:{made.getsockname()[1]}"


def test_other_versions_and_welcomes_are_told() -> None:
    newer = bytearray(Packet(packets.WELCOME, 1, 0, 0.0, b"{}").to_bytes())
    newer[4] = 9
    for answer, said in (
        (bytes(newer), "version 9 of the protocol, this is version 1; install the same"),
        (Packet(packets.WELCOME, 1, 0, 0.0, b"{}").to_bytes(), "is not what version 1"),
        (Packet(packets.STOP, 0, 0, 0.0, b"taken").to_bytes(), "takes no controller: taken"),
    ):
        made, url = answering(answer)
        with made, pytest.raises(InputError, match=said):
            UdpRobot(url, patience=10.0)


def test_other_robots_and_rates_are_told(tmp_path: Path, touch: Path) -> None:
    with Serving(TOUCH, tmp_path / "served") as serving:
        other = touch.with_name("other.yaml")
        other.write_text(TOUCH.replace("planar2", "planar3"), encoding="utf-8")
        result = call("run", other, "--on", serving.url)
        assert result.exit_code == 2
        told = " ".join(result.output.split())
        assert "is 'planar2' with" in told
        assert "name this one as the task's 'robot.model'" in told
        # Who says hello and goes keeps nobody else from driving.
        assert call("run", touch, "--on", serving.url).exit_code == 0
        assert serving.run.passed
    mine = RobotFacts.of(program_of(TOUCH), lock_step=True)
    parts = {name: getattr(mine, name) for name in ("name", "joints", "period", "wrench")}
    for change, said in (
        ({"period": 2e-3}, "runs at 500 Hz, .* run it with --set control.rate=500Hz"),
        ({"wrench": "reading"}, "gives readings of a sensor"),
        ({"reactions": ("bars",)}, "measures bars, the task needs none"),
    ):
        with pytest.raises(InputError, match=said):
            mine.check(RobotFacts(**parts | change), "udp://h:5")
