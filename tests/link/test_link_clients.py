"""Whoever answers drives the plant: clients of other make, rubbish, silence, the wall clock."""

from __future__ import annotations

import random
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from meeting import ROOT, TOUCH, Serving, drive, drive_at, log_bytes, program_of, shipped, spoilt

from controller_samples import GRIP
from taskspec_runner.controller_c.fmu import NoBinaryError, fmu_of
from taskspec_runner.errors import LinkError
from taskspec_runner.link import packets
from taskspec_runner.link.packets import Packet
from taskspec_runner.link.server import ServerOptions
from taskspec_runner.link.udp_robot import UdpRobot
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

EXAMPLES = ROOT / "examples" / "plant"
#: The wipe, cut short: the force settles in 0.43 s, a fifth of it in place of a twentieth.
WIPE = shipped("wipe-table").read_text("utf-8").replace("time: 8 s", "time: 2 s")
WIPE = WIPE.replace("for 93 %", "for 75 %")


def wiping(command: str) -> str:
    """The same, shorter, with an arm that is commanded something else."""
    if command == "torque":
        return WIPE
    yielding = WIPE.replace("time: 2 s", "time: 1 s").replace("for 75 %", "for 50 %")
    yielding = yielding.replace("model: panda", f"model: panda\n  command: {command}")
    yielding = re.sub("kind: hybrid\n  force: .*\n", "kind: admittance\n", yielding)
    assert f"command: {command}" in yielding
    assert "kind: admittance" in yielding
    return yielding


def compiled(folder: Path) -> list[str]:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler on this machine")
    made = folder / "client"
    options = ["-O2", "-Wall", "-Wextra", "-Werror", "-o", str(made)]
    subprocess.run([compiler, *options, str(EXAMPLES / "client.c"), "-lm"], check=True)
    return [str(made)]


@pytest.mark.parametrize(
    ("language", "command"),
    [("python", "torque"), ("c", "torque"), ("python", "velocity"), ("c", "position")],
)
def test_client_of_the_examples_passes_the_task(
    language: str, command: str, tmp_path: Path
) -> None:
    client = [sys.executable, str(EXAMPLES / "client.py")]
    if language == "c":
        client = compiled(tmp_path)
    # The text of a shipped task, which has no file beside it.
    options = ServerOptions(wait=60.0, answer=30.0)
    with Serving(wiping(command), tmp_path / "run", options) as serving:
        done = subprocess.run(
            [*client, str(serving.port)], capture_output=True, text=True, timeout=120, check=True
        )
        run = serving.run
    assert "led to end" in done.stdout
    assert run.verdict == "passed", run.reason
    assert run.summary["link"]["name"] == f"client.{'py' if language == 'python' else 'c'}"
    assert run.summary["link"]["clipped"] == 0
    # By the truth, as that of a run is.
    assert "table.force" in run.history.columns


def test_both_clients_are_one_law(tmp_path: Path) -> None:
    forces = []
    for number, client in enumerate(
        ([sys.executable, str(EXAMPLES / "client.py")], compiled(tmp_path))
    ):
        options = ServerOptions(wait=60.0, answer=30.0)
        with Serving(WIPE, tmp_path / str(number), options) as serving:
            subprocess.run([*client, str(serving.port)], capture_output=True, check=True)
            forces.append(np.asarray(serving.run.during("wipe").signals["force.z"]))
    n = min(map(len, forces))
    # They sum in another order: what differs is rounding, and what a stiff contact makes of it.
    assert np.abs(forces[0][:n] - forces[1][:n]).max() < 1e-3


@pytest.mark.parametrize(("task", "last"), [("wipe-table", "retreat"), (GRIP, "let_go")])
def test_fmpy_couples_the_fmu_of_a_task_to_its_plant(task: str, last: str, tmp_path: Path) -> None:
    """Its commands are the machine's to the bit: so are the bytes of the log."""
    pytest.importorskip("fmpy")
    program, path = program_of(task), tmp_path / "made.fmu"
    made = fmu_of(program)
    try:
        path.write_bytes(made.to_bytes(made.binary()))
    except NoBinaryError as error:
        pytest.skip(str(error))
    plain = execute_program(program, tmp_path / "plain", report=False)
    options = ServerOptions(wait=60.0, answer=30.0)
    with Serving(task, tmp_path / "run", options) as serving:
        couple = [sys.executable, str(ROOT / "examples" / "fmu" / "couple.py"), str(path)]
        done = subprocess.run(
            [*couple, str(serving.port)], capture_output=True, text=True, timeout=120, check=True
        )
        run = serving.run
    assert f"stage {last!r} led to end" in done.stdout
    assert run.summary["link"]["name"] == "couple.py"
    assert log_bytes(run) == log_bytes(plain)


def test_rubbish_does_not_end_the_server(tmp_path: Path) -> None:
    plain = execute_program(program_of(TOUCH), tmp_path / "plain", report=False)
    over, dice, sent = threading.Event(), random.Random(5), [0]
    hello = Packet(packets.HELLO, 0, 0, 0.0, b'{"client":"somebody else"}').to_bytes()
    stop = Packet(packets.STOP, 7, 0, 0.0, b"stop it").to_bytes()
    command = Packet(packets.COMMAND, 7, 3, 0.0, packets.command_body(np.ones(2))).to_bytes()

    def shout(port: int) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
            while not over.is_set():
                data = dice.choice([hello, stop, command])
                data = data if dice.random() < 0.2 else spoilt(data, dice)
                made.sendto(data, ("127.0.0.1", port))
                sent[0] += 1
                time.sleep(2e-4)

    with Serving(TOUCH, tmp_path / "served") as serving:
        # One that is a hello may come first, so ours is there before.
        robot = UdpRobot(serving.url, patience=20.0)
        shouting = threading.Thread(target=shout, args=(serving.port,))
        shouting.start()
        try:
            drive(TOUCH, robot, tmp_path / "driven")
            run = serving.run
        finally:
            over.set()
            shouting.join()
    assert log_bytes(run) == log_bytes(plain)
    assert run.summary["link"]["rejected"] > 20
    assert sent[0] > 100


def test_peer_that_sends_rubbish_is_given_up_in_time(tmp_path: Path) -> None:
    options = ServerOptions(wait=20.0, answer=0.5)
    with Serving(TOUCH, tmp_path / "served", options) as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        robot.read()
        robot.read()  # ready
        until, dice = time.monotonic() + 1.5, random.Random(1)
        while time.monotonic() < until:
            # Right in all but the number, or not right at all.
            robot._number = dice.randrange(1 << 20) + 5
            try:
                robot.write(np.ones(2))
                robot._socket.send(dice.randbytes(dice.randrange(1, 200)))
            except (OSError, LinkError):
                # It has given us up.
                break
            time.sleep(1e-3)
        run = serving.run
        robot.stop("")
    assert run.summary["ending"]["reason"] == "connection_lost"
    assert "no answer from the controller for 0.5 s" in run.reason
    assert run.exit_code == 4
    assert len(run) == run.summary["ticks"]


def test_controller_that_stops_ends_the_run(tmp_path: Path) -> None:
    with Serving(TOUCH, tmp_path / "served") as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        for _ in range(11):
            sample = robot.read()
            if sample.stamp or robot._number:
                robot.write(np.zeros(2))
        robot.stop("I have seen\x1b[2J enough")
        run = serving.run
    assert run.summary["ending"]["reason"] == "controller_stopped"
    assert r"I have seen\x1b[2J enough" in run.reason
    assert len(run) == 10
    assert_at_rest(run)


def assert_at_rest(run: Run) -> None:
    """The plant was brought to rest by its server, and its log has that."""
    assert run.to_rest is not None
    assert len(run.to_rest) == 500
    assert run.summary["stopping"]["residual_joint_speed"] < 0.01


def test_controller_that_is_gone_leaves_an_arm_at_rest(tmp_path: Path) -> None:
    options = ServerOptions(wait=20.0, answer=0.2)
    with Serving(TOUCH, tmp_path / "served", options) as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        for _ in range(11):
            robot.read()
            robot.write(np.array([10.0, -10.0]))
        run = serving.run
        robot.stop("it has been silent")
    assert run.summary["ending"]["reason"] == "connection_lost"
    assert abs(run.signals["joint.1.velocity"][-1]) > 0.1
    assert_at_rest(run)


def test_torques_beyond_the_motors_are_cut(tmp_path: Path) -> None:
    with Serving(TOUCH, tmp_path / "served") as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        limit = np.array(robot.limits.torque)
        for _ in range(6):
            robot.read()
            if robot._number:
                robot.write(10 * limit)
        robot.stop("enough")
        run = serving.run
    assert run.summary["link"]["clipped"] == 5
    assert np.array_equal(run.signals["joint.1.torque"], np.full(5, limit[0]))


def test_wall_clock_keeps_its_books(tmp_path: Path) -> None:
    """On a machine that is loaded: the run ends as its policy says, and every tick is accounted."""
    options = ServerOptions(free_running=True, wait=20.0)
    with Serving(TOUCH, tmp_path / "served", options) as serving:
        driven = drive_at(TOUCH, serving.url, tmp_path / "driven")
        served = serving.run
    link = served.summary["link"]
    ending = served.summary["ending"]["reason"]
    assert ending in ("end", "answers_lost", "controller_stopped", "connection_lost")
    lost = np.asarray(served.signals["link.lost"])
    assert link["ticks"] == len(served) == served.summary["ticks"]
    if ending == "end":
        assert (link["lost"], link["in_a_row"]) == (np.sum(lost > 0), np.max(lost))
        assert link["in_a_row"] <= options.stop_after
    # One more without an answer each time, or none.
    assert np.all(np.diff(lost) <= 1)
    assert np.all(lost >= 0)
    # Without an answer the last torque is held.
    torque = np.asarray(served.signals["joint.1.torque"])
    held = np.flatnonzero(np.diff(lost) == 1) + 1
    assert np.array_equal(torque[held], torque[held - 1])
    late = np.asarray(served.signals["link.late"])
    assert np.all(late >= 0)
    assert link["lateness"]["max"] == np.max(late)
    assert driven.summary["link"]["ticks"] == len(driven)
    assert driven.summary["link"]["mode"] == "free-running"


def test_a_file_judges_answers_that_are_lost(tmp_path: Path) -> None:
    """Over UDP at the wall clock: five samples in a row get no answer, and are judged so."""
    text = TOUCH + "  - max(link.lost) < 5\n  - link.lost < 1 for 50 %\n"
    options = ServerOptions(free_running=True, stop_after=200, wait=20.0)
    with Serving(text, tmp_path / "served", options) as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        for tick in range(40):
            robot.read()
            if not 20 <= tick < 25:
                robot.write(np.zeros(2))
        robot.stop("enough")
        run = serving.run
    lost = np.asarray(run.signals["link.lost"])
    assert np.max(lost) >= 5
    judged = {each.text: each for each in run.expectations}
    assert not judged["max(link.lost) < 5"].passed
    assert judged["max(link.lost) < 5"].signals == ("link.lost",)
    assert judged["link.lost < 1 for 50 %"].passed == (np.mean(lost < 1) >= 0.5)


def test_wall_clock_stops_without_answers(tmp_path: Path) -> None:
    options = ServerOptions(free_running=True, stop_after=7, wait=20.0)
    with Serving(TOUCH, tmp_path / "served", options) as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        for _ in range(2):
            robot.read()
        run = serving.run
        robot.stop("")
    assert run.summary["ending"]["reason"] == "answers_lost"
    assert "8 samples in a row went without an answer; up to 7 are borne" in run.reason
    assert np.asarray(run.signals["link.lost"]).tolist() == [1, 2, 3, 4, 5, 6, 7]
