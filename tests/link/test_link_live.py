"""Live params of runs in other processes: set at either end, and by requests from elsewhere."""

from __future__ import annotations

import json
import math
import socket
import threading
from pathlib import Path

import pytest
from meeting import (
    Proxy,
    Serving,
    drive_at,
    log_bytes,
    own_columns,
    program_of,
    same_bits,
)
from typer.testing import CliRunner

from controller_samples import LIVE, MOVES
from taskspec.program.execution.live_params import LiveParams
from taskspec_runner import run
from taskspec_runner.cli.app import app
from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.link.live_client import LiveClient
from taskspec_runner.link.on_robot import LostPolicy, OnRobot
from taskspec_runner.link.udp_robot import UdpRobot
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.live_requests import LiveRequests, setting
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

PERIOD = 1e-3
TOKEN = "a-token-of-a-test"
ADDRESS = f"udp://127.0.0.1:0/{TOKEN}"


def task():
    return program_of(LIVE).context.loaded.task


def plain(folder: Path) -> Run:
    with setting(MOVES, task(), PERIOD) as hand:
        return execute_program(program_of(LIVE), folder, report=False, hand=hand)


@pytest.mark.parametrize("shares", [{}, {"drop": 0.05, "twice": 0.05, "late": 0.05}])
def test_what_is_set_at_the_plant_its_controller_follows(shares, tmp_path) -> None:
    own = plain(tmp_path / "plain")
    assert {3.0, 4.0} < set(own.history.columns["param.push"].tolist())
    with (
        Serving(LIVE, tmp_path / "served", live=MOVES) as serving,
        Proxy(serving.port, 7, **shares) as proxy,
    ):
        driven = drive_at(LIVE, proxy.url, tmp_path / "driven")
        served = serving.run
    assert log_bytes(served) == log_bytes(own)
    assert len(driven) == len(own)
    same_bits(driven, own, own_columns(driven))


def test_what_is_set_at_both_ends_is_set_once(tmp_path) -> None:
    own = plain(tmp_path / "plain")
    with Serving(LIVE, tmp_path / "served", live=MOVES) as serving:
        link = OnRobot(UdpRobot(serving.url, patience=20.0), LostPolicy(), "test")
        with setting(MOVES, task(), PERIOD) as hand:
            execute_program(
                program_of(LIVE), tmp_path / "driven", report=False, link=link, hand=hand
            )
        assert log_bytes(serving.run) == log_bytes(own)


def test_a_controller_alone_is_set_on_a_robot_that_knows_no_params(tmp_path) -> None:
    with Serving(LIVE, tmp_path / "served") as serving:
        link = OnRobot(UdpRobot(serving.url, patience=20.0), LostPolicy(), "test")
        with setting(["push = 8 N @ 0.1 s"], task(), PERIOD) as hand:
            driven = execute_program(
                program_of(LIVE), tmp_path / "driven", report=False, link=link, hand=hand
            )
        served = serving.run
    assert driven.history.columns["param.push"][-1] == 8.0
    assert served.history.columns["param.push"][-1] == 5.0
    assert served.history.columns["force.x"][-1] == pytest.approx(8.0, abs=0.5)


class Requested:
    """Requests to a run, and a hand that waits for them at a tick.

    Whatever the processor does meanwhile, they come at that tick.
    """

    def __init__(self, tick: int) -> None:
        self.requests = LiveRequests(ADDRESS, task(), PERIOD)
        self._tick, self._answers = tick, list[dict]()

    def set(self, live: LiveParams, ticks: int) -> int | None:
        after = self.requests.set(live, ticks)
        while ticks >= self._tick and not self.requests.lines:
            self.requests.set(live, ticks)
        return after

    @property
    def lines(self) -> tuple[str, ...]:
        return self.requests.lines


def test_a_program_sets_params_of_a_run_which_can_be_made_again(tmp_path) -> None:
    hand = Requested(tick=100)
    answers = []

    def operate() -> None:
        with LiveClient(hand.requests.url, patience=20.0) as client:
            answers.append(client.set(push=80, sway="2 mm + 1 mm"))
            answers.append(client.read())

    operator = threading.Thread(target=operate)
    operator.start()
    first = execute_program(program_of(LIVE), tmp_path / "first", report=False, hand=hand)
    # The run may have ended before the second request: somebody answers it all the same.
    parts = assemble(program_of(LIVE))
    while operator.is_alive():
        hand.requests.set(parts.machine.live, 0)
    hand.requests.close()
    push = answers[0]["push"]
    assert (push["target"], push["low"], push["high"], push["unit"]) == (8.0, 2.0, 8.0, "N")
    assert answers[0]["sway"]["target"] == pytest.approx(3e-3)
    assert first.history.columns["param.push"][-1] == 8.0
    lines = json.loads((first.folder / "manifest.json").read_text())["live"]
    assert len(lines) == 2
    assert lines[0].startswith("push = 8.0 N @ ")
    with setting(lines, task(), PERIOD) as known:
        again = execute_program(program_of(LIVE), tmp_path / "again", report=False, hand=known)
    assert log_bytes(again) == log_bytes(first)


@pytest.fixture
def asked():
    """The answer of a run's requests to a datagram; None where there is none."""
    requests = LiveRequests(ADDRESS, task(), PERIOD)
    live = assemble(program_of(LIVE)).machine.live
    port = int(requests.url.split(":")[-1].split("/")[0])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        link.setblocking(False)

        def answer(content: object) -> dict | None:
            data = content if isinstance(content, bytes) else json.dumps(content).encode()
            link.send(data)
            assert requests.set(live, 7) == 10
            try:
                return json.loads(link.recv(8192))
            except BlockingIOError:
                return None

        answer.live, answer.requests = live, requests
        yield answer
    requests.close()


def test_requests_are_answered_and_values_are_bounded(asked) -> None:
    found = asked({"token": TOKEN})
    assert found["time"] == pytest.approx(0.007)
    assert found["params"]["push"]["value"] == 5.0
    for value, target in ((-1e300, 2.0), (10**300, 8.0)):
        found = asked({"token": TOKEN, "set": {"push": value}})
        assert found["params"]["push"]["target"] == target
    assert asked.requests.lines == ("push = 2.0 N @ 0.007 s", "push = 8.0 N @ 0.007 s")
    # What it goes to already is no change.
    asked({"token": TOKEN, "set": {"push": "9 N"}})
    assert len(asked.requests.lines) == 2


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        ({"push": 3, "shove": 3}, "no live param 'shove'; live are push, sway"),
        ({"push": math.nan}, "'push' is set to a number in SI units, or to a text such as '8 N'"),
        ({"push": None}, "'push' is set to a number"),
        ({"push": True}, "'push' is set to a number"),
        ({"push": "3 mm"}, "a force (N) is needed here"),
        ({"push": "3 N +"}, "push = 3 N +: "),
        ([1], "'set' is a mapping"),
    ],
)
def test_what_cannot_be_set_is_said_and_nothing_is_set(wanted, text, asked) -> None:
    found = asked({"token": TOKEN, "set": wanted})
    assert text in found["error"]
    assert asked.live.target("push") == 5.0
    assert asked.requests.lines == ()


@pytest.mark.parametrize(
    "content",
    [
        {"set": {"push": 3}},
        {"token": TOKEN[:-1], "set": {"push": 3}},
        {"token": 7, "set": {"push": 3}},
        *(b"", b"no JSON", b"[" * 9000, b"[" * 5000, b"\xff\xfe", b"[1]"),
    ],
)
def test_whoever_does_not_know_the_token_has_no_answer(content, asked) -> None:
    assert asked(content) is None
    assert asked.live.target("push") == 5.0
    assert asked.requests.rejected == 1


def test_a_client_says_that_nobody_answers() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{nobody.getsockname()[1]}/{TOKEN}"
        with LiveClient(url, patience=0.2) as client, pytest.raises(LinkError, match="no run"):
            client.set(push=3)
    with pytest.raises(InputError, match=r"udp://127\.0\.0\.1:PORT/TOKEN"):
        LiveClient("udp://127.0.0.1:39018")


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("udp://0.0.0.0:39018", "requests are taken from this machine alone"),
        ("udp://127.0.0.1", "--live needs udp://127.0.0.1:PORT"),
        ("udp://127.0.0.1:1/short", "a token has 16 or more characters"),
    ],
)
def test_an_address_that_is_none_is_refused(address, text, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("touch.yaml").write_text(LIVE)
    done = CliRunner().invoke(app, ["run", "touch.yaml", "--live", address])
    assert done.exit_code == 2
    assert text in " ".join(done.output.split())


def test_a_port_that_is_taken_and_a_task_without_live_params_are_errors(tmp_path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"udp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(InputError, match="cannot listen there"):
            run(program_of(LIVE).context.loaded, tmp_path / "run", live=[address])
    still = LIVE.replace("{value: 5 N, live: 2..8 N, rate: 20 N/s}", "5 N")
    still = still.replace("{value: 5 mm, live: 0..10 mm}", "5 mm")
    with pytest.raises(InputError, match="the task has no live params; write such as press"):
        run(program_of(still).context.loaded, tmp_path / "run", live=[ADDRESS])


def test_the_command_says_where_it_is_set(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("touch.yaml").write_text(LIVE)
    given = ["run", "touch.yaml", "--live", ADDRESS, "--live", MOVES[0], "--quiet", "--out", "a"]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 0, done.output
    assert "live params are set at udp://127.0.0.1:" in done.output
    assert f"/{TOKEN}\n" in done.output
    lines = json.loads(Path("a/manifest.json").read_text())["live"]
    assert lines == ["push = 4.0 N @ 0.0 s"]
