"""Sliders of live params: who may move them, what they set, and how such a run is made again."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from screen import DESKTOP, PHONE
from typer.testing import CliRunner

from browser import Browser
from taskspec.compiler import compile_task
from taskspec.program.program import Program
from taskspec.program.worlds import true_world
from taskspec.spec import load_text
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.live.channel import Channel
from taskspec_runner.live.server import PageServer
from taskspec_runner.live.sliders import SET, Sliders, sliders_of
from taskspec_runner.live.watched_run import WatchedRun
from taskspec_runner.loop.hand import Hands
from taskspec_runner.loop.live_schedule import scheduled
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

TASK = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.2}}
params:
  press: {value: 12 N, live: 5..20 N, rate: 10 N/s}
  half: press / 2
  side: {value: 0, live: -20..20 mm, rate: 20 mm/s}
  soft: {value: 800 N/m, live: +- 50 %}
law: {kind: impedance, stiffness: {x: soft, y: soft, z: 1000 N/m}}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -half, within: {time: 2 s}}
  press: {axes: {z: {force: -press}, x: {position: 500 mm + side}}, time: 3 s}
expect:
  - max(norm(force)) < press + 15 N
"""


@pytest.fixture(scope="module")
def program() -> Program:
    return compile_task(load_text(TASK, "task.yaml"))


@pytest.fixture(autouse=True)
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test opens a window."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def sliders(program: Program) -> Sliders:
    return Sliders(program.context.loaded.task.live, program.context.period)


@pytest.fixture
def served(sliders: Sliders) -> Iterator[PageServer]:
    takes = {SET: sliders.request}
    with PageServer({"": lambda: "the page"}, Channel(3), takes=takes) as found:
        yield found


def post(url: str, body: bytes | Any, **headers: str) -> tuple[int, Any]:
    """Status and answer of a request; an answer that is no JSON is left out."""
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    _, _, place, path = url.split("/", 3)
    connection = http.client.HTTPConnection(place, timeout=10)
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(
        "POST", f"/{path}", content, {"Content-Type": "application/json"} | given
    )  # fmt: skip
    got = connection.getresponse()
    text = got.read().decode()
    connection.close()
    is_json = got.headers.get_content_type() == "application/json"
    return got.status, json.loads(text) if is_json else None


GOOD = {"name": "press", "value": 8.0}


def test_the_page_sets_what_its_bounds_allow(served: PageServer, sliders: Sliders) -> None:
    at, port = f"{served.url}{SET}", served.port
    assert post(at, GOOD) == (200, {"name": "press", "target": 8.0})
    for origin in (f"http://127.0.0.1:{port}", f"http://localhost:{port}"):
        assert post(at, {"name": "press", "value": 9}, Origin=origin)[0] == 200
    assert post(at, {"name": "side", "value": -1}) == (200, {"name": "side", "target": -0.02})
    kind = "application/json; charset=utf-8"
    assert post(at, {"name": "soft", "value": 1e9}, Content_Type=kind)[1]["target"] == 1200.0
    assert sliders.targets == {"press": 9.0, "side": -0.02, "soft": 1200.0}


def test_others_set_nothing(served: PageServer, sliders: Sliders) -> None:
    at, port, before = f"{served.url}{SET}", served.port, sliders.targets
    for origin in (
        "http://example.com",
        f"https://127.0.0.1:{port}",
        f"http://127.0.0.1:{port + 1}",
        f"http://example.com:{port}",
        "null",
        "",
    ):
        assert post(at, GOOD, Origin=origin)[0] == 403, origin
    assert post(at, GOOD, Host="example.com")[0] == 403
    assert post(f"http://127.0.0.1:{port}/{SET}", GOOD)[0] == 403
    token = served.url.split("/")[3]
    assert post(f"http://127.0.0.1:{port}/{token[:-1]}/{SET}", GOOD)[0] == 403
    assert post(served.url, GOOD)[0] == 404
    assert post(f"{served.url}other", GOOD)[0] == 404
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""):
        assert post(at, GOOD, Content_Type=kind)[0] == 415, kind
    assert sliders.targets == before


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        (b"{", 400, "no JSON"),
        (b"\xff", 400, "no JSON"),
        (b"[" * 4000, 400, "no JSON"),
        (b'{"name": "press", "value": 1' + b"0" * 400 + b"}", 400, "no JSON"),
        (b"", 400, "no JSON"),
        (b"[]", 422, "a request is"),
        ({"name": "press"}, 422, "a request is"),
        (GOOD | {"more": 1}, 422, "a request is"),
        ({"name": "pres", "value": 8}, 422, "press"),
        ({"name": "half", "value": 8}, 422, "no live param of that name"),
        ({"name": ["press"], "value": 8}, 422, "no live param of that name"),
        (b'{"name": "press", "value": NaN}', 422, "finite"),
        (b'{"name": "press", "value": -Infinity}', 422, "finite"),
        (b'{"name": "press", "value": 1e999}', 422, "finite"),
        ({"name": "press", "value": "8"}, 422, "finite"),
        ({"name": "press", "value": True}, 422, "finite"),
        ({"name": "press", "value": None}, 422, "finite"),
    ],
)
def test_what_is_no_request_is_refused(
    served: PageServer, sliders: Sliders, body: Any, status: int, said: str
) -> None:
    before = sliders.targets
    got, answer = post(f"{served.url}{SET}", body)
    assert (got, said in answer["error"]) == (status, True), answer
    assert sliders.targets == before


def test_a_body_is_short_and_has_a_length(served: PageServer, sliders: Sliders) -> None:
    at, before = f"{served.url}{SET}", sliders.targets
    assert post(at, json.dumps(GOOD).encode() + b" " * 5000)[0] == 413
    for length in ("9" * 5000, "4097"):
        assert post(at, b"", Content_Length=length)[0] == 413
    for length in ("-1", "x", "", "１"):
        assert post(at, b"", Content_Length=length.encode().decode("latin-1"))[0] == 411
    assert sliders.targets == before


def test_a_page_without_live_params_takes_nothing() -> None:
    with PageServer({"": lambda: "the page"}, Channel(3)) as plain:
        assert post(f"{plain.url}{SET}", GOOD)[0] == 501


def test_a_run_that_is_over_takes_nothing(served: PageServer, sliders: Sliders) -> None:
    sliders.finish()
    status, answer = post(f"{served.url}{SET}", GOOD)
    assert (status, answer) == (409, {"error": "the run is over"})


def test_places_of_a_slider_are_round(program: Program) -> None:
    made = {each.name: each for each in sliders_of(program.context.loaded.task.live)}
    assert [(s.unit, s.low, s.high, s.step) for s in made.values()] == [
        ("N", 5.0, 20.0, 0.1),
        ("mm", -20.0, 20.0, 0.2),
        ("N/m", 400.0, 1200.0, 5.0),
    ]


@pytest.mark.parametrize("loop", ["native", "python"])
def test_a_run_with_moves_is_made_again(tmp_path: Path, program: Program, loop: str) -> None:
    """From the lines that it keeps, of the page and of the command line, byte for byte."""
    task, period = program.context.loaded.task, program.context.period
    with WatchedRun(program, true_world(program.context)) as page:
        assert page.sliders is not None
        at = f"{page.server.url}{SET}"
        page.expect()
        made: list[Run] = []
        known = scheduled(["soft = 600 N/m @ 0.5 s"], task, period)
        assert known is not None
        hand = Hands([known, page.sliders])
        going = threading.Thread(
            target=lambda: made.append(
                execute_program(
                    program, tmp_path / "run", report=False, loop=loop, spectator=page, hand=hand
                )
            )
        )
        going.start()
        sent = 0
        while going.is_alive():
            # Twice each: what is set again is none of its moves.
            value = 6.0 + 0.37 * (sent // 2 % 30)
            for name, each in (("press", value), ("side", 1e-3 * value), ("soft", 77 * value)):
                assert post(at, {"name": name, "value": each})[0] in (200, 409)
            sent += 1
            time.sleep(0.02)
        assert post(at, GOOD)[0] == 409
    lines = Run.load(tmp_path / "run").manifest["live"]
    assert len(lines) > 20
    assert "soft = 600.0 N/m @ 0.5 s" in lines
    assert {line.split()[0] for line in lines} == {"press", "side", "soft"}
    (tmp_path / "task.yaml").write_text(TASK)
    by_line = [word for line in lines for word in ("--live", line)]
    for number, moves in enumerate((by_line, ["--live", str(tmp_path / "run")])):
        again = tmp_path / f"again-{number}"
        words = ["run", str(tmp_path / "task.yaml"), "--out", str(again), "--loop", loop, *moves]
        assert CliRunner().invoke(app, words).exit_code == made[0].exit_code
        for name in ("log.arrow", "summary.json"):
            assert (again / name).read_bytes() == (tmp_path / "run" / name).read_bytes()
        assert Run.load(again).manifest["live"] == sorted(
            lines, key=lambda line: round(float(line.split()[-2]) / period)
        )
    plain = execute_program(program, tmp_path / "plain", report=False, loop=loop)
    assert (plain.folder / "log.arrow").read_bytes() != (again / "log.arrow").read_bytes()


def test_a_run_that_kept_no_moves_is_named(tmp_path: Path, program: Program) -> None:
    task, period = program.context.loaded.task, program.context.period
    run = execute_program(program, tmp_path / "run", report=False)
    with pytest.raises(InputError, match="no live params were set in that run"):
        scheduled([str(run.folder)], task, period)
    with pytest.raises(InputError, match="neither the folder of a run nor a move"):
        scheduled([str(tmp_path)], task, period)


def test_a_move_counts_within_20_ms(program: Program, tmp_path: Path) -> None:
    """Of simulated time: it is set at the first tick of a multiple of them after the request."""
    sliders = Sliders(program.context.loaded.task.live, program.context.period)
    sliders.request({"name": "soft", "value": 500.0})
    run = execute_program(program, tmp_path / "run", report=False, hand=sliders)
    assert sliders.lines == ("soft = 500.0 N/m @ 0.0 s",)
    assert run.columns["param.soft"].tolist()[1] == 500.0
    assert round(20e-3 / program.context.period) == 20


#: Every change of the slider of `press` goes to `seen`.
WATCHED = """(() => {
    const row = document.querySelector('[data-param="press"]'), input = row.querySelector("input");
    window.seen = [];
    new MutationObserver(() => seen.push({
        now: row.querySelector(".now").textContent, goes: row.querySelector(".goes").textContent,
        text: input.getAttribute("aria-valuetext"), off: input.disabled,
    })).observe(row, {subtree: true, childList: true, attributes: true});
})()"""


def test_sliders_are_moved_by_keys(browser: Browser, tmp_path: Path, program: Program) -> None:
    with WatchedRun(program, true_world(program.context)) as page:
        made: list[Run] = []
        going = threading.Thread(
            target=lambda: made.append(
                execute_program(program, tmp_path / "run", spectator=page, hand=page.sliders)
            )
        )
        for size in (PHONE, DESKTOP):
            browser.size(*size, phone=size == PHONE)
            browser.visit(page.server.url)
            assert browser.run("document.documentElement.scrollWidth") <= size[0]
        labels = browser.run(
            """[...document.querySelectorAll(".sliders input")].map((input) => [
                input.labels[0].textContent, input.type, input.getAttribute("aria-valuetext"),
                document.getElementById(input.getAttribute("aria-describedby")).textContent])"""
        )
        assert labels == [
            ["press", "range", "12 N", "5 to 20 N, at 10 N/s"],
            ["side", "range", "0 mm", "−20 to 20 mm, at 20 mm/s"],
            ["soft", "range", "800 N/m", "400 to 1200 N/m"],
        ]
        browser.run(WATCHED)
        browser.run("document.getElementById('live-press').focus()")
        browser.key("Home")
        going.start()
        going.join()
        page.end(made[0])
        end = time.monotonic() + 10
        while not (states := browser.run("seen"))[-1]["off"]:
            assert time.monotonic() < end
            time.sleep(0.05)
        assert browser.errors == []
    assert any(s["goes"] == "→ 5 N" and s["now"] not in ("5 N", "12 N") for s in states)
    assert any(s["goes"] == "" and s["now"] == "5 N" and s["text"] == "5 N" for s in states)
    (line,) = made[0].manifest["live"]
    assert line.startswith("press = 5.0 N @ ")
    assert made[0].columns["param.press"][-1] == 5.0
