"""Exported controllers of arms that take velocities or positions."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from controller_samples import SERVOS, program, recorded
from taskspec_runner.controller_c.fmu import fmu_of
from taskspec_runner.controller_c.source import controller_of
from taskspec_runner.link.fmu import InFmu
from taskspec_runner.link.library import ControllerLibrary, InLibrary
from taskspec_runner.session import execute_program

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")

ROOT = Path(__file__).resolve().parents[2]
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1")
RUNNING, DONE, BAD_SAMPLE, NOT_STARTED = 0, 1, 8, 11
PERIOD = 1e-3
#: Of both servos, in a control period [rad/s].
STEP = 20.0 * PERIOD


@pytest.fixture(scope="module", params=SERVOS)
def command(request) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def library(command, tmp_path_factory) -> Path:
    folder, made = tmp_path_factory.mktemp("c"), controller_of(program(command))
    made.write(folder)
    built = ["gcc", *STRICT, "-shared", "-fPIC", f"{made.name}.c", "-o", "it.so", "-lm"]
    done = subprocess.run(built, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "it.so"


class Host:
    """A host of a controller: answers by samples."""

    def __init__(self, library: Path, command: str) -> None:
        self._library = ControllerLibrary(library, controller_of(program(command)), 2, 0)

    def answers(self, samples: np.ndarray, *, started: bool = True) -> np.ndarray:
        """(ticks, 3) commands and state of each sample (ticks, 12)."""
        library, found = self._library, []
        for tick, sample in enumerate(samples):
            library.sample[:] = sample
            if tick == 0 and started:
                library.answer(sample[-1], first=True)
            if tick or library.state == RUNNING:
                library.answer(sample[-1])
            found.append([*library.command, library.state])
        return np.array(found)


def rates(command: str, commands: np.ndarray) -> np.ndarray:
    """Velocities that are commanded, of positions what they change by."""
    return commands if command == "velocity" else np.diff(commands, axis=0) / PERIOD


def test_commands_are_those_of_the_machine_to_the_bit(command, library) -> None:
    samples, commands, ended = recorded(command)
    found = Host(library, command).answers(samples)
    assert len(samples) > 200
    assert found[:, :2].tobytes() == commands.tobytes()
    assert (ended, found[-1, 2]) == ("end", DONE)


def test_its_run_leaves_the_same_bytes(command, library, tmp_path) -> None:
    made = program(command)
    own = execute_program(made, tmp_path / "own", report=False)
    run = execute_program(made, tmp_path / "by-c", report=False, link=InLibrary(library, made))
    logs = [(each.folder / "log.arrow").read_bytes() for each in (own, run)]
    assert logs[0] == logs[1]
    assert own.exit_code == 0


def test_after_an_end_the_arm_slows_down_and_rests(command, library) -> None:
    samples = recorded(command)[0][:300].copy()
    samples[120:] = samples[119]
    samples[120:, -1] = np.arange(120, 300) * PERIOD
    samples[120, 1] = np.nan
    found = Host(library, command).answers(samples)
    assert (found[119, 2], found[120, 2]) == (RUNNING, BAD_SAMPLE)
    assert np.isfinite(found).all()
    speeds = rates(command, found[118:, :2])
    assert np.abs(speeds[0]).max() > STEP
    assert np.abs(np.diff(speeds[1:], axis=0)).max() < STEP * (1 + 1e-6)
    assert np.abs(speeds[-1]).max() < 1e-9


def test_a_position_is_held_where_nothing_was_started(command, library) -> None:
    samples = recorded(command)[0][:3] + 0.01
    samples[:, -1] = np.arange(3) * PERIOD
    found = Host(library, command).answers(np.vstack([samples[:1], samples]), started=False)
    assert set(found[1:, 2]) == {NOT_STARTED}
    held = samples[0, :2] if command == "position" else np.zeros(2)
    assert (found[1:, :2] == held).all()


def test_the_header_names_what_is_commanded(command) -> None:
    header = controller_of(program(command)).header
    words = " ".join(" ".join(line.lstrip(" *") for line in header.splitlines()).split())
    number, unit = {"velocity": (1, "rad/s"), "position": (2, "rad")}[command]
    at_end = {"velocity": "velocities fall to zero", "position": "positions slow down and stay"}
    for text in (
        f"double {command}[2];",
        f"_quantity = {number} }};",
        f"0 joint1 rad rad/s {unit} ",
        "bandwidth 20 Hz, damping 1, delay 4 ms",
        "20 rad/s^2",
        f"the {at_end[command]}",
    ):
        assert text in words, text
    assert "The rates limit how fast it slows down at the end." in words
    (row,) = re.findall(r" 0 joint1 .* rad/s (\S+) rad/s\^2 1 joint2 ", words)
    (least,) = set(np.round(program(command).context.drives.rates, 4))
    assert float(row) == pytest.approx(least, rel=1e-4)
    assert "torque" not in header.replace("0 torques, 1 velocities", "")


def test_the_fmu_has_the_commands_beside_what_is_measured(command) -> None:
    text = fmu_of(program(command)).files["modelDescription.xml"]
    listed = ElementTree.fromstring(text).find("ModelVariables")
    units = {v.get("name"): (v.get("causality"), v.get("unit")) for v in listed}
    unit = {"velocity": "rad/s", "position": "rad"}[command]
    assert units[f"command.{command}.joint1"] == ("output", unit)
    assert units[f"{command}.joint1"] == ("input", unit)
    assert "torque.joint1" not in units
    said = {v.get("name"): v.get("description") for v in listed}
    assert said[f"command.{command}.joint2"].startswith(f"commanded {command}, which the arm's own")


def test_the_run_of_an_fmu_leaves_the_same_bytes(tmp_path) -> None:
    pytest.importorskip("fmpy")
    made, path = program("position"), tmp_path / "touch.fmu"
    exported = fmu_of(made)
    path.write_bytes(exported.to_bytes(exported.binary()))
    own = execute_program(made, tmp_path / "own", report=False)
    run = execute_program(made, tmp_path / "by-fmu", report=False, link=InFmu(path, made))
    logs = [(each.folder / "log.arrow").read_bytes() for each in (own, run)]
    assert logs[0] == logs[1]


def test_the_example_links_with_it_and_refuses_another_arm(command, library, tmp_path) -> None:
    """It is compiled for any task; `link.h` has what the plant's arm takes from its welcome."""
    name = controller_of(program(command)).name
    defined = (f"-DTASK={name}", f"-I{library.parent}")
    files = (str(ROOT / "examples/plant/exported.c"), str(library.parent / f"{name}.c"))
    strict = [flag for flag in STRICT if flag not in ("-pedantic", "-O1")]
    built = ["gcc", *strict, "-O0", *defined, *files, "-o", str(tmp_path / "exported"), "-lm"]
    done = subprocess.run(built, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
