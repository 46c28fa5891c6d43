"""What a robot or a controller may send: any value, and none of it is an internal error."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meeting import TOUCH, ClockedRobot, Serving, drive, drive_at, program_of
from numpy.typing import NDArray
from typer.testing import CliRunner

from taskspec.text.characters import escaped
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.link import on_robot, packets, server
from taskspec_runner.link.packets import Packet
from taskspec_runner.link.robot import Sample
from taskspec_runner.link.server import ServerOptions, welcome
from taskspec_runner.link.udp_robot import UdpRobot

WELCOME = welcome(program_of(TOUCH), ServerOptions())


class Stamped(ClockedRobot):
    """A robot whose samples from the tenth on have other stamps; `pace` is between two of them."""

    def __init__(self, stamps: Callable[[int], float], pace: float = 0.0) -> None:
        super().__init__(program_of(TOUCH))
        self._stamps, self._pace, self._count = stamps, pace, 0

    def read(self) -> Sample:
        sample = super().read()
        self._count += 1
        if self._count > 10:
            time.sleep(self._pace)
            sample.stamp = self._stamps(self._count)
        return sample


@pytest.mark.parametrize(
    ("stamps", "reason"),
    [
        (lambda _: 1e308, "bad_stamp"),
        (lambda n: -1e308 if n < 12 else 1e308, "bad_stamp"),
        (lambda _: float("inf"), "bad_stamp"),
        (lambda _: float("nan"), "bad_stamp"),
        (lambda _: 1e9, "bad_stamp"),
        (lambda _: 100.0, "samples_lost"),
    ],
)
def test_a_stamp_that_is_no_time_of_a_run_stops_it_by_name(
    tmp_path: Path, stamps: Callable[[int], float], reason: str
) -> None:
    run = drive(TOUCH, Stamped(stamps), tmp_path / "run")
    assert (run.exit_code, run.summary["ending"]["reason"]) == (4, reason)
    assert len(run) == 10 - 1
    assert run.damage == ""


@pytest.mark.parametrize("clock", [lambda _: 0.009, lambda n: 0.009 - 1e-3 * n])
def test_a_clock_that_stands_or_runs_back_is_given_up_in_time(
    tmp_path: Path, clock: Callable[[int], float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 20 samples a second 1000 of them would take 50 s."""
    monkeypatch.setattr(on_robot, "_USELESS_FOR", 0.5)
    began = time.monotonic()
    run = drive(TOUCH, Stamped(clock, 0.05), tmp_path / "run")
    assert time.monotonic() - began < 10
    assert (run.exit_code, run.summary["ending"]["reason"]) == (4, "no_new_sample")
    assert "the robot's clock stands or runs back" in run.reason


class FakePlant:
    """A socket that answers each hello by a welcome, whatever is in that."""

    def __init__(self, body: bytes) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.2)
        self._body = body
        self.url = f"udp://127.0.0.1:{self._socket.getsockname()[1]}"

    def answer(self) -> None:
        try:
            _, peer = self._socket.recvfrom(65535)
        except TimeoutError:
            return
        self._socket.sendto(Packet(packets.WELCOME, 1, 0, 0.0, self._body).to_bytes(), peer)

    def close(self) -> None:
        self._socket.close()


def changed(path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """The welcome of a plant with another value somewhere."""
    made: dict[str, Any] = json.loads(json.dumps(WELCOME))
    holder = made
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return made


#: Values that JSON can have, and that numbers, names and lists are not.
VALUES = (10**400, -(10**400), 10**200, 1e308, -1.0, 0, "\ud800", "a\n\x07\x1b[2J", None, True, [],
          {}, [[1]], "x" * 3000, [10**400] * 2, [None] * 99)  # fmt: skip
PATHS = (("period",), ("mode",), ("wrench",), ("equations",), ("robot",), ("robot", "name"),
         ("robot", "joints"), ("robot", "limits"), ("robot", "limits", "torque"),
         ("robot", "limits", "velocity"), ("robot", "limits", "lower"))  # fmt: skip


@pytest.mark.parametrize("path", PATHS, ids=".".join)
def test_any_welcome_is_taken_or_refused(path: tuple[str, ...]) -> None:
    import threading

    told = 0
    for value in VALUES:
        plant = FakePlant(json.dumps(changed(path, value)).encode())
        thread = threading.Thread(target=plant.answer)
        thread.start()
        try:
            robot = UdpRobot(plant.url, patience=0.1)
        except InputError as error:
            told += 1
            texts = str(error).splitlines()
        else:
            texts = [robot.facts.name, *robot.facts.joints]
            robot._socket.close()
        finally:
            thread.join()
            plant.close()
        assert all(map(str.isprintable, texts))
    assert told >= 3


def test_text_from_elsewhere_is_escaped() -> None:
    assert escaped("plain ä ß") == "plain ä ß"
    assert escaped("a\nb\x07\x1b[2J\ud800\u202e") == r"a\nb\x07\x1b[2J\ud800\u202e"
    assert packets.read_stop(b"over\n\x1b[31m") == r"over\n\x1b[31m"


# Who drives a plant.


@pytest.fixture
def stray() -> Iterator[socket.socket]:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.settimeout(5)
    yield made
    made.close()


def received(by: socket.socket) -> Iterator[Packet]:
    """What has come, until nothing comes any more."""
    try:
        while True:
            yield packets.read_packet(by.recv(65535))
    except TimeoutError:
        return


def hello(name: str) -> bytes:
    body = packets.json_body({"protocol": 1, "client": name})
    return Packet(packets.HELLO, 0, 0, 0.0, body).to_bytes()


def test_a_hello_without_a_command_keeps_nobody_from_driving(
    tmp_path: Path, stray: socket.socket
) -> None:
    """The first command decides who drives; who had only said hello gets that message."""
    with Serving(TOUCH, tmp_path / "served") as serving:
        stray.sendto(hello("stray\x1b[2J"), ("127.0.0.1", serving.port))
        assert packets.read_packet(stray.recv(65535)).kind == packets.WELCOME
        run = drive_at(TOUCH, serving.url, tmp_path / "run")
        assert run.passed
        assert serving.run.passed
    stray.settimeout(0.5)
    sent = list(received(stray))
    assert {packet.kind for packet in sent} == {packets.STATE, packets.STOP}
    assert "drives it" in packets.read_stop(sent[-1].body)


def test_a_plant_waits_again_after_a_hello_without_a_command(
    tmp_path: Path, stray: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "_READY", 0.3)
    options = ServerOptions(wait=60.0, answer=0.3)
    with Serving(TOUCH, tmp_path / "served", options) as serving:
        stray.sendto(hello("stray"), ("127.0.0.1", serving.port))
        time.sleep(1.0)
        assert drive_at(TOUCH, serving.url, tmp_path / "run").passed
        assert serving.run.passed


def test_a_plant_that_nobody_drives_ends_by_name(
    tmp_path: Path, stray: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "_READY", 0.3)
    with Serving(TOUCH, tmp_path / "served", ServerOptions(wait=1.0, answer=0.3)) as serving:
        stray.sendto(hello("stray"), ("127.0.0.1", serving.port))
        run = serving.run
    assert (run.exit_code, run.summary["ending"]["reason"]) == (4, "connection_lost")


def test_what_another_version_is_answered_is_no_longer_than_it(
    tmp_path: Path, stray: socket.socket
) -> None:
    """The source of a packet may be somebody else's: nobody is sent more than was spent on it."""
    with Serving(TOUCH, tmp_path / "served") as serving:
        for body in (b"", b"x" * 40):
            other = bytearray(Packet(packets.HELLO, 0, 0, 0.0, body).to_bytes())
            other[4] = 9
            stray.sendto(bytes(other), ("127.0.0.1", serving.port))
            answer = stray.recv(65535)
            assert len(answer) <= len(other)
            assert packets.read_packet(answer).kind == packets.STOP
        assert drive_at(TOUCH, serving.url, tmp_path / "run").passed


def test_open_says_what_it_opens(tmp_path: Path) -> None:
    task = tmp_path / "touch.yaml"
    task.write_text(TOUCH, encoding="utf-8")
    for address, said in (("0.0.0.0", True), ("127.0.0.1", False)):
        options = ("--listen", f"udp://{address}:0", "--open", "--wait", "0.1")
        arguments = ["plant", str(task), *options, "--out", str(tmp_path / "run"), "--quiet"]
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2
        assert ("may drive the simulated plant" in result.stderr) == said


def test_a_sample_that_is_no_number_is_refused(tmp_path: Path) -> None:
    class Wrong(ClockedRobot):
        def read(self) -> Sample:
            sample = super().read()
            wrench: NDArray[np.float64] = np.full(6, 1e308) * 10
            sample.wrench = wrench
            return sample

    run = drive(TOUCH, Wrong(program_of(TOUCH)), tmp_path / "run")
    assert run.summary["ending"]["reason"] == "bad_sample"
