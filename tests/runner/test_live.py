"""Pages that are looked at while they come about: who may, what they get, and what it costs."""

from __future__ import annotations

import base64
import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from screen import DESKTOP, PHONE
from short_tasks import TAP
from typer.testing import CliRunner

from browser import Browser
from taskspec.compiler import compile_task, compile_unchecked
from taskspec.program.worlds import true_world
from taskspec.spec import load_task, load_text
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.live.arm import LiveArm
from taskspec_runner.live.channel import Channel
from taskspec_runner.live.server import PageServer
from taskspec_runner.live.watched_run import WatchedRun
from taskspec_runner.live.watched_sweep import WatchedSweep
from taskspec_runner.loop.assembly import Assembly
from taskspec_runner.loop.driven import Driven
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.recorder import Recorder
from taskspec_runner.runs import Run
from taskspec_runner.scene.recorded import recorded_scene
from taskspec_runner.session import execute_program
from taskspec_runner.sweep.session import sweep
from taskspec_runner.sweep.worlds import Worlds
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

TASKS = Path(__file__).resolve().parents[2] / "tasks"
COMMAND = [sys.executable, "-c", "from taskspec_runner.cli import main; main()"]


def lasting(seconds: int) -> str:
    """The task with a longer hold [s]."""
    return TAP.replace("time: 0.3 s", f"time: {seconds} s")


@pytest.fixture(autouse=True)
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test opens a window."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def answer(url: str, *, method: str = "GET", **headers: str) -> tuple[int, str]:
    """Status and body of a request to an address."""
    _, _, place, path = url.split("/", 3)
    connection = http.client.HTTPConnection(place, timeout=10)
    connection.request(method, f"/{path}", headers=headers)
    got = connection.getresponse()
    body = got.read().decode()
    connection.close()
    return got.status, body


@contextmanager
def started(command: list[str], folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A command that serves a page."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=folder) as process:
        try:
            yield process
        finally:
            process.kill()


class Reader:
    """Reads all messages of a page's server."""

    def __init__(self, url: str) -> None:
        self.messages: list[tuple[int, str, Any]] = []
        _, _, place, path = url.split("/", 3)
        self._connection = http.client.HTTPConnection(place, timeout=20)
        self._connection.request("GET", f"/{path}events")
        self._stream = self._connection.getresponse()
        assert self._stream.status == 200
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        fields: dict[str, str] = {}
        for raw in self._stream:
            line = raw.decode().rstrip("\n")
            if line.startswith(":"):
                continue
            if line:
                name, _, value = line.partition(": ")
                fields[name] = value
            elif fields:
                data = json.loads(fields["data"])
                self.messages.append((int(fields["id"]), fields["event"], data))
                fields = {}

    def of(self, kind: str) -> list[Any]:
        return [data for _, each, data in self.messages if each == kind]

    def wait(self) -> None:
        """Waits until the server has closed."""
        self._thread.join(20)
        assert not self._thread.is_alive()
        self._connection.close()


# who may look


@pytest.fixture
def served(tmp_path: Path) -> Iterator[PageServer]:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "report.html").write_text("the report")
    (folder / "task.yaml").write_text("the task")
    (tmp_path / "other.html").write_text("another")
    (folder / "link.html").symlink_to(tmp_path / "other.html")
    with PageServer({"": lambda: "the page"}, Channel(3), folder=folder) as found:
        yield found


def test_pages_are_for_who_has_the_address(served: PageServer) -> None:
    at = f"http://127.0.0.1:{served.port}"
    assert served.url.startswith(f"{at}/")
    assert len(served.url) > len(at) + 30
    assert answer(served.url) == (200, "the page")
    assert answer(f"{served.url}report.html") == (200, "the report")
    for path in ("/", "/events", "/report.html", f"{served.url[len(at) : -2]}/", "//", "/%2e%2e/"):
        assert answer(at + path)[0] == 403, path
    with PageServer({"": lambda: "the page"}, Channel(3)) as other:
        assert other.url.split("/")[3] != served.url.split("/")[3]


@pytest.mark.parametrize("host", ["example.com", "example.com:{}", "127.0.0.1", "", "127.0.0.2:{}"])
def test_pages_are_not_for_another_host(served: PageServer, host: str) -> None:
    assert answer(served.url, Host=f"localhost:{served.port}")[0] == 200
    assert answer(served.url, Host=host.format(served.port))[0] == 403


def test_pages_are_reached_on_loopback_alone(served: PageServer) -> None:
    for address in ("127.0.0.2", socket.gethostbyname(socket.gethostname())):
        if address == "127.0.0.1":
            continue
        with pytest.raises(OSError, match=r"refused|timed out"):
            socket.create_connection((address, served.port), timeout=2)


def test_pages_are_read_and_nothing_else(served: PageServer) -> None:
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert answer(served.url, method=method)[0] == 501
    for path in ("task.yaml", "../other.html", "link.html", "%2e%2e/other.html", "no.html", "."):
        assert answer(served.url + path)[0] == 404, path


def test_a_port_that_is_taken_is_named(served: PageServer) -> None:
    with pytest.raises(InputError, match=f"cannot serve a page at port {served.port}: .*--port"):
        PageServer({}, Channel(1), port=served.port)


def test_a_port_is_of_a_page(tap: Path) -> None:
    for words in (["run", tap], ["sweep", tap], ["replay", tap.parent]):
        result = CliRunner().invoke(app, [*map(str, words), "--port", "4000"])
        assert result.exit_code == 2
        assert "--port is that of the page" in result.stderr


# messages


def test_messages_come_in_order_and_a_newcomer_gets_the_last() -> None:
    channel = Channel(3)
    for number in range(5):
        channel.send("row", number, passes=True)
        channel.send("verdict", f"after {number}")
    kept = channel.after(0, 0.0)
    assert [(m.kind, json.loads(m.text)) for m in kept] == [
        ("row", 2), ("row", 3), ("row", 4), ("verdict", "after 4"),
    ]  # fmt: skip
    assert [m.number for m in kept] == sorted(m.number for m in kept)
    assert channel.after(kept[-1].number, 0.0) == []
    channel.send("row", 5, passes=True)
    assert [m.text for m in channel.after(kept[-1].number, 1.0)] == ["5"]


def test_a_browser_that_takes_nothing_keeps_nobody_waiting(served: PageServer) -> None:
    _, _, place, path = served.url.split("/", 3)
    with socket.create_connection(("127.0.0.1", served.port)) as slow:
        slow.sendall(f"GET /{path}events HTTP/1.0\r\nHost: {place}\r\n\r\n".encode())
        while not served.channel.read:
            time.sleep(0.01)
        began = time.monotonic()
        for _ in range(200):
            served.channel.send("row", "x" * 100_000, passes=True)
        assert time.monotonic() - began < 2.0
    while served.channel.read:
        # It has gone, which the next write shows.
        served.channel.send("row", 0, passes=True)
        time.sleep(0.05)
    assert time.monotonic() - began < 20.0


# a run


@pytest.mark.parametrize("loop", ["native", "python"])
def test_a_watched_run_is_the_same_and_tells_what_its_log_has(tmp_path: Path, loop: str) -> None:
    program = compile_task(load_text(TAP, "tap.yaml"))
    plain = execute_program(program, tmp_path / "plain", report=False, loop=loop)
    with WatchedRun(program, true_world(program.context)) as page:
        status, html = answer(page.server.url)
        assert status == 200
        reader = Reader(page.server.url)
        began = time.monotonic()
        out = tmp_path / "watched"
        watched = execute_program(program, out, report=False, loop=loop, spectator=page)
        # Watched, it keeps to the wall clock.
        assert time.monotonic() - began > watched.end - 0.1
        page.end(watched)
    reader.wait()
    for name in ("log.arrow", "summary.json"):
        assert (plain.folder / name).read_bytes() == (watched.folder / name).read_bytes()
    numbers = [number for number, _, _ in reader.messages]
    assert numbers == sorted(set(numbers))
    rows = [row for message in reader.of("rows") for row in message["rows"]]
    every = 20
    assert [row["time"] for row in rows] == pytest.approx(watched.columns["clock"][::every])
    said = json.loads(
        re.search(r'id="run-data">(.*?)</script>', html)[1]  # type: ignore[index]
    )
    traces = [trace for chart in said["charts"].values() for trace in chart["traces"]]
    assert {"force.x", "force.x.ref", "error.y"} <= {trace["column"] for trace in traces}
    for trace in traces:
        got = [np.nan if (v := row["values"][trace["number"]]) is None else v for row in rows]
        wanted = trace["factor"] * watched.columns[trace["column"]][::every]
        np.testing.assert_allclose(got, wanted, rtol=1e-5, atol=1e-9)
    assert [said["names"][row["stage"]] for row in rows] == watched.history.stages[::every].tolist()
    kind, last = reader.messages[-1][1:]
    assert (kind, last["over"]) == ("verdict", True)
    assert "passed" in last["box"]
    assert "All 3 expectations held" in last["box"] or "All 4 expectations held" in last["box"]


class _Kept:
    """Keeps every tick that it looks at."""

    rate, looks = 50.0, True

    def begin(self, parts: Assembly[Driven], recorder: Recorder, folder: Path) -> None:
        assert recorder.ticks == 0
        assert folder.is_dir()
        self._bus, self.rows = parts.bus, []

    def look(self) -> None:
        self.rows.append(self._bus.array.copy())

    def finish(self) -> None:
        assert self.rows


@pytest.mark.parametrize("name", ["conveyor", "pivot-box", "screw"])
def test_the_arm_stands_as_in_the_report(tmp_path: Path, name: str) -> None:
    """With a table that moves, with a loose body, with a mechanism."""
    program = compile_unchecked(load_task(TASKS / f"{name}.yaml"))
    kept = _Kept()
    run = execute_program(program, tmp_path / "run", report=False, spectator=kept)
    task = true_world(program.context).task
    arm = LiveArm(program, task, Bus(program.context.robot.n, task).slices)
    layout = LogLayout.of(program, task)
    scene = recorded_scene(RecordedWorld(Recording.of(run)))
    clock, values = (
        np.frombuffer(base64.b64decode(scene["track"][key]), "<f4") for key in ("clock", "values")
    )
    track = values.reshape(-1, len(clock)).T
    width = scene["width"]
    ticks = np.rint(clock / run.period).astype(int)
    common = np.flatnonzero(ticks % 20 == 0)
    assert len(common) > 10
    for row in common[:: len(common) // 8]:
        bus = kept.rows[ticks[row] // 20]
        columns = {n: float(v[0]) for n, (v, _) in layout.columns(bus[np.newaxis]).items()}
        got = arm.values(bus, columns)
        np.testing.assert_allclose(got[: width + 3], track[row, : width + 3], atol=2e-5)
        # A quaternion and its opposite are one rotation.
        assert abs(got[width + 3 : width + 7] @ track[row, width + 3 : width + 7]) > 1 - 1e-5
        np.testing.assert_allclose(got[width + 7 :], track[row, width + 7 : width + 10], atol=1e-3)


@pytest.mark.parametrize("ended", [True, False])
def test_ctrl_c_ends_a_page_and_a_run(tmp_path: Path, ended: bool) -> None:
    (tmp_path / "tap.yaml").write_text(TAP if ended else lasting(60))
    command = [*COMMAND, "run", "tap.yaml", "--watch", "--out", "run"]
    with started(command, tmp_path) as process:
        assert process.stderr is not None
        url = process.stderr.readline().strip()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", url)
        reader = Reader(url)
        end = time.monotonic() + 60
        while not (any(v["over"] for v in reader.of("verdict")) if ended else reader.of("rows")):
            assert time.monotonic() < end
            assert process.poll() is None
            time.sleep(0.02)
        if ended:
            assert "All 4 expectations held" in answer(f"{url}report.html")[1]
            assert process.stderr.readline() == "Ctrl-C ends the page\n"
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=20)
        assert process.returncode == (0 if ended else 130)
    reader.wait()
    assert "report: " in said
    if not ended:
        assert "stopped" in reader.messages[-1][2]["box"]
        assert Run.load(tmp_path / "run").summary["status"] == "stopped"


def test_the_page_of_a_run_moves(browser: Browser, tmp_path: Path) -> None:
    program = compile_task(load_text(lasting(3), "tap.yaml"))
    with WatchedRun(program, true_world(program.context)) as page:
        made: list[Run] = []
        going = threading.Thread(
            target=lambda: made.append(execute_program(program, tmp_path / "run", spectator=page))
        )
        browser.media(dark=True)
        browser.size(*DESKTOP)
        browser.visit(page.server.url)
        assert "has not begun" in browser.run("document.getElementById('verdict').textContent")
        going.start()
        seen = []
        while going.is_alive():
            seen.append(
                browser.run(
                    """[parseFloat(document.getElementById("time").textContent),
                    document.querySelector(".plot .trace.line")?.getAttribute("d"),
                    document.querySelector(".view").dataset.tip,
                    document.getElementById("verdict").textContent]"""
                )
            )
            time.sleep(0.1)
        page.end(made[0])
        end = time.monotonic() + 10
        while "passed" not in browser.run("document.getElementById('verdict').textContent"):
            assert time.monotonic() < end
            time.sleep(0.05)
        times = [at for at, *_ in seen if at is not None]
        assert len(set(times)) > 2
        assert times == sorted(times)
        assert len({line for _, line, *_ in seen if line}) > 2
        assert any("So far 3 of 4" in text or "So far 4 of 4" in text for *_, text in seen)
        # Nobody has pointed at a time: the arm is where it is now, and says its force.
        labels = "[...document.querySelectorAll('.arm .scene-label')].map((e) => e.textContent)"
        assert any(text.endswith(" N") for text in browser.run(labels))
        for size in (DESKTOP, PHONE):
            browser.size(*size, phone=size == PHONE)
            assert browser.run("document.documentElement.scrollWidth") <= size[0]
        assert browser.run("document.querySelectorAll('#expectations .good').length") == 4
        browser.visit(browser.run("document.querySelector('.open').href"))
        assert "passed" in browser.run("document.getElementById('verdict').textContent").lower()
        assert browser.errors == []


# a sweep


def test_the_page_of_a_sweep_fills(tmp_path: Path) -> None:
    text = TAP + "vary: {world.wall.stiffness: 5..30 kN/m}\n"
    program = compile_task(load_text(text, "tap.yaml"))
    worlds = Worlds.of(program.context, 0, 3)
    with WatchedSweep(program.context.loaded.task) as page:
        reader = Reader(page.server.url)
        pages = [answer(page.server.url)[1]]

        def watch(glimpse: Any) -> None:
            page.watch(glimpse)
            pages.append(answer(page.server.url)[1])

        result = sweep(program, worlds, tmp_path / "s", watch=watch)
        page.end()
        pages.append(answer(page.server.url)[1])
    reader.wait()
    assert len(pages) == 6
    for number, html in enumerate(pages[1:5]):
        assert f'<progress value="{number}" max="3"' in html
        assert "EventSource" in html
        assert f"all {number}</button>" in html or not number
    assert pages[-1] == (result.path / "sweep.html").read_text()
    assert "EventSource" not in pages[-1]
    assert [each["done"] for each in reader.of("far")][-1] == 3
    assert reader.messages[-1][1] == "over"


# a recorded run


def test_a_recorded_run_is_replayed_in_a_page(browser: Browser, tmp_path: Path) -> None:
    program = compile_task(load_text(TAP, "tap.yaml"))
    execute_program(program, tmp_path / "run", report=False)
    command = [*COMMAND, "replay", str(tmp_path / "run"), "--web", "--speed", "0.02"]
    with started(command, tmp_path) as process:
        assert process.stderr is not None
        url = process.stderr.readline().strip()
        assert url.endswith("/#play=0.02")
        browser.size(*DESKTOP)
        browser.visit(url)
        seen = []
        end = time.monotonic() + 20
        while len(set(seen)) < 3:
            seen.append(browser.run("document.querySelector('.arm .clock').textContent"))
            assert time.monotonic() < end, seen
        assert browser.errors == []
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    assert not (tmp_path / "run" / "report.html").exists()


def test_a_replay_is_of_one_kind(tmp_path: Path) -> None:
    for words in (["--web", "--view"], ["--web", "--video", "a.mp4"]):
        result = CliRunner().invoke(app, ["replay", str(tmp_path), *words])
        assert (result.exit_code, "one of --video, --view and --web" in result.stderr) == (2, True)
