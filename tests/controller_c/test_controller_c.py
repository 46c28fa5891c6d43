"""Exported controllers: the torques of the machine to the bit, and ends by name."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from controller_samples import program, recorded
from taskspec_runner.cli.app import app
from taskspec_runner.controller_c.source import controller_of, identifier
from taskspec_runner.errors import InputError
from taskspec_runner.link.library import ControllerLibrary, InLibrary
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.sensing import Sensing

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused-function")
_CHECKED = "-fsanitize=address,undefined,float-cast-overflow"
SANITIZED = ("-g", _CHECKED, "-fno-sanitize-recover=all")
#: A frame that is estimated and a sensor's zero; limits that collide; coordinates chosen again; a
#: body that is gripped, whose mass is handed over; a tank that is handed on, and is empty; a zero
#: that is measured with a body in the gripper.
TASKS = (
    *(
        "unknown-normal",
        "reach-limits",
        "ring",
        "pick-and-screw",
        "energy-tank",
        "estimate",
        "held",
    ),
)
RUNNING, DONE, STOPPED, BAD_SAMPLE, BAD_STAMP, LOST, NOT_STARTED = 0, 1, 3, 8, 9, 10, 11

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The program that drives the exported controller of a task, under sanitizers."""
    programs: dict[str, Path] = {}

    def path(name: str) -> Path:
        if name not in programs:
            folder = tmp_path_factory.mktemp("c")
            made = controller_of(program(name))
            made.write(folder)
            defined = (f"-DNAME={made.name}", f'-DHEADER="{made.name}.h"', f"-I{folder}")
            files = (str(HERE / "drive.c"), f"{made.name}.c", "-o", "drive", "-lm")
            command = ["gcc", *STRICT, *SANITIZED, "-O0", *defined, *files]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
            programs[name] = folder / "drive"
        return programs[name]

    return path


@pytest.fixture(scope="module")
def driven(built):
    """Answers (ticks, n + 2) of the exported controller of a task."""

    def answers(name: str, samples: np.ndarray) -> np.ndarray:
        done = subprocess.run([built(name)], input=samples.tobytes(), capture_output=True)
        assert done.returncode == 0, done.stderr.decode()
        made = program(name).context
        doubles = made.robot.n + bool(made.loaded.task.gripped)
        return np.frombuffer(done.stdout).reshape(-1, doubles + 2)

    return answers


@pytest.mark.parametrize("name", TASKS)
def test_torques_are_those_of_the_machine_to_the_bit(name, driven) -> None:
    samples, torques, ended = recorded(name)
    assert len(samples) > 1000
    found = driven(name, samples)
    assert found[:, :-2].tobytes() == torques.tobytes()
    assert ended == "end"
    assert set(found[:-1, -2]) == {RUNNING}
    assert found[-1, -2] == DONE


def test_the_jaws_are_commanded_what_the_machine_commands(driven) -> None:
    samples, commands, ended = recorded("grip")
    assert ended == "end"
    assert set(commands[:, -1]) == {0.0, 10.0}
    assert (commands[0, -1], commands[-1, -1]) == (10.0, 0.0)
    found = driven("grip", samples)
    assert found[:, :-2].tobytes() == commands.tobytes()
    header = controller_of(program("grip")).header
    assert "double grip; /* what each jaw of the gripper is to press with [N]" in header
    assert "0: what each jaw of the gripper presses with [N], 0 with nothing in it" in header
    assert "double grip" not in controller_of(program("ring")).header


def test_a_sliding_term_and_an_observer_are_those_of_the_machine(driven) -> None:
    samples, torques, ended = recorded("robust")
    assert len(samples) > 300
    found = driven("robust", samples)
    assert found[:, :-2].tobytes() == torques.tobytes()
    assert ended == "end"


def spoiled(ticks: int) -> np.ndarray:
    return recorded("ring")[0][:ticks].copy()


@pytest.mark.parametrize("column", [0, 8, 15, -1])
def test_a_sample_that_is_no_number_ends_the_task_and_the_torques_stay_finite(
    column, driven
) -> None:
    samples = spoiled(60)
    samples[40, column] = np.nan
    found = driven("ring", samples)
    assert found[39, -2] == RUNNING
    assert set(found[40:, -2]) == {BAD_SAMPLE}
    assert np.isfinite(found[:, :-2]).all()


def test_a_clock_that_runs_back_ends_the_task(driven) -> None:
    samples = spoiled(60)
    samples[40, -1] = samples[38, -1]
    found = driven("ring", samples)
    assert (found[39, -2], found[40, -2]) == (RUNNING, BAD_STAMP)


@pytest.mark.parametrize(("lost", "state"), [(20, RUNNING), (21, LOST)])
def test_lost_samples_are_ticks_on_the_last_one_up_to_what_is_borne(lost, state, driven) -> None:
    samples = spoiled(100)
    found = driven("ring", np.delete(samples, slice(30, 30 + lost), axis=0))
    assert found[30, -2] == state
    held = samples.copy()
    held[30 : 30 + lost, :-1] = samples[29, :-1]
    if state == RUNNING:
        assert found[30:].tobytes() == driven("ring", held)[30 + lost :].tobytes()


def test_a_host_at_half_the_rate_ends_the_task(driven) -> None:
    found = driven("ring", spoiled(100)[::2])
    assert set(found[:21, -2]) == {RUNNING}
    assert set(found[21:, -2]) == {LOST}


def test_a_host_without_stamps_ends_the_task(driven) -> None:
    samples = spoiled(60)
    samples[:, -1] = 0.0
    assert driven("ring", samples)[:, -2].tolist() == [RUNNING] + 59 * [BAD_STAMP]


def test_positions_in_degrees_end_the_task_by_a_limit(driven) -> None:
    samples = spoiled(60)
    samples[:, :7] = np.degrees(samples[:, :7])
    found = driven("ring", samples)
    assert set(found[:, -2]) == {STOPPED}
    assert np.isfinite(found).all()


@pytest.mark.parametrize("columns", [slice(0, 7), slice(7, 14), slice(14, 20)])
@pytest.mark.parametrize("value", [1e300, -1e150])
def test_numbers_of_no_arm_are_in_no_torque(value, columns, driven) -> None:
    samples = spoiled(60)
    samples[40:, columns] = value
    found = driven("ring", samples)
    assert found[39, -2] == RUNNING
    assert RUNNING not in found[40:, -2]
    assert np.isfinite(found).all()


def test_a_task_is_started_before_it_steps_and_may_be_started_again(tmp_path) -> None:
    made = controller_of(program("ring"))
    made.write(tmp_path)
    command = ["gcc", "-std=c99", "-O0", "-shared", "-fPIC", "ring.c", "-o", "ring.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ControllerLibrary(tmp_path / "ring.so", made, 7, 2)
    samples, torques, _ = recorded("ring")

    def answers(tick: int, *, first: bool = False) -> list[float]:
        library.q[:], library.v[:] = samples[tick, :7], samples[tick, 7:14]
        library.wrench[:], library.reactions[:] = samples[tick, 14:20], samples[tick, 20:22]
        library.answer(tick * 1e-3, first=first)
        return library.command.tolist()

    answers(3)
    assert library.state == NOT_STARTED
    assert np.isfinite(library.command).all()
    for _ in range(2):
        answers(0, first=True)
        assert [answers(tick) for tick in range(30)] == torques[:30].tolist()
        assert library.state == RUNNING
    size = int(re.search(r"define RING_SIZE (\d+)", made.header)[1])
    library._library.ring_size.restype = ctypes.c_uint64
    assert size - 100 <= library._library.ring_size() <= size == made.size


def test_fast_math_is_refused(tmp_path) -> None:
    controller_of(program("ring")).write(tmp_path)
    command = ["gcc", "-ffast-math", "-fsyntax-only", "ring.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0
    assert "compile it without -ffast-math" in done.stderr


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        (
            "ring",
            [
                "flange 'flange'. The tip is the tool's extreme point on its axis, 0.1 m from it",
                "0  joint1  rad  rad/s  N*m     0         -2.8973 .. 2.8973   87 N*m",
                "1: round",
                "done: its moves, path and time are done -> end",
                "force: limit on force: 40 N",
                "force x y z [N], then moment x y z about the tip [N m].",
                "Of the contact alone, in world axes",
                "0: rim [N]: x^2 + y^2 = (90 mm)^2",
                "within the torque limits of the table at all times",
            ],
        ),
        ("unknown-normal", ["A sensor's reading in the axes of the tip frame", "Its zero is "]),
        ("reach-limits", ["within the torque limits of the table at all times", "no equations."]),
    ],
)
def test_the_header_has_units_frames_signs_stages_and_limits(name, lines) -> None:
    text = controller_of(program(name)).header
    header = " ".join(" ".join(line.lstrip(" *") for line in text.splitlines()).split())
    for line in lines:
        assert " ".join(line.split()) in header


#: What becomes of a number, and of the stamps from a tick on [s].
NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e20, -1e20, 1e6, 5e-324, -5e-324, -0.0)
STAMPS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e9, 0.05, 0.0201, 0.002, 1e-9, 5e-324, -1e-3)


def spoiled_at_random(number: int, ticks: int) -> np.ndarray:
    """Samples that are spoiled, lost, repeated and out of order; the same for the same number."""
    rng = np.random.default_rng(number)
    samples = spoiled(ticks)
    how_often = rng.choice([0.02, 0.1, 0.5])
    for i in range(1, ticks):
        if rng.random() >= how_often:
            continue
        kind = rng.integers(4)
        if kind == 0:
            samples[i, rng.integers(samples.shape[1])] = rng.choice(NUMBERS)
        elif kind == 1 and np.isfinite(samples[i:, -1]).all():
            samples[i:, -1] += rng.choice(STAMPS)
        elif kind == 2:
            samples[i] = samples[rng.integers(ticks)]
        else:
            samples[i, rng.random(samples.shape[1]) < 0.3] = rng.choice(NUMBERS)
    return samples


def test_whatever_comes_no_torque_is_not_a_number_and_an_end_is_one(driven) -> None:
    ends = set()
    for number in range(60):
        samples = spoiled_at_random(number, 150)
        found = driven("ring", samples)
        assert len(found) == len(samples)
        assert np.isfinite(found[:, :-2]).all(), number
        states = found[:, -2]
        over = np.flatnonzero(states != RUNNING)
        if over.size:
            assert set(states[over[0] :]) == {states[over[0]]}, number
            ends.add(int(states[over[0]]))
    assert {BAD_SAMPLE, BAD_STAMP, LOST} <= ends
    assert ends <= set(range(1, 11))


def test_the_stop_takes_motion_away(driven) -> None:
    """From an end on the torques carry the arm: at rest they are its gravity terms."""
    samples = spoiled(60)
    samples[40:, 7:14] = 0.0
    samples[40, 0] = np.inf
    samples[40:, :7] = samples[39, :7]
    samples[40, 0] = np.inf
    found = driven("ring", samples)
    parts = assemble(program("ring"))
    parts.machine.q[:], parts.machine.v[:] = samples[59, :7], 0.0
    parts.machine.update_terms()
    assert found[59, :7] == pytest.approx(parts.machine.terms.gravity, abs=1e-9)


def test_an_arm_whose_task_has_ended_comes_to_rest(built) -> None:
    made = program("ring")
    parts = assemble(made)
    machine, plant = parts.machine, parts.plant
    sensing = Sensing(plant.arm, plant.views.equations, machine)
    speeds, states = [], []
    with subprocess.Popen([built("ring")], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as driver:
        for tick in range(1500):
            sensing.read()
            clock = tick * made.context.period if tick != 800 else np.nan
            reactions = machine.reactions if machine.reactions.size else np.zeros(1)
            driver.stdin.write(
                np.concatenate([machine.q, machine.v, machine.wrench, reactions, [clock]]).tobytes()
            )
            driver.stdin.flush()
            answer = np.frombuffer(driver.stdout.read(8 * (len(machine.q) + 2)))
            plant.step(answer[:-2])
            speeds.append(np.abs(machine.v).max())
            states.append(answer[-2])
        driver.stdin.close()
    assert states[799:801] == [RUNNING, BAD_SAMPLE]
    assert speeds[800] > 0.05
    assert speeds[-1] < 1e-4


def test_the_command_line_exports_and_judges(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    task = str(ROOT / "tasks" / "press-hybrid.yaml")
    run = CliRunner()
    done = run.invoke(app, ["export", task, "--c", "c", "--set", "stages.slide.time=0.2 s"])
    assert done.exit_code == 0, done.output
    compiled = ["gcc", *STRICT, "-O1", "-shared", "-fPIC", "c/press_hybrid.c", "-lm"]
    subprocess.run([*compiled, "-o", "c/press_hybrid.so"], check=True)
    sets = ["--set", "stages.slide.time=0.2 s"]
    for out, on in (("by-c", ["--on", "lib:c/press_hybrid.so"]), ("own", [])):
        done = run.invoke(app, ["run", task, *sets, *on, "--out", out, "--quiet"])
        assert done.exit_code in (0, 1), done.output
    logs = [(tmp_path / out / "log.arrow").read_bytes() for out in ("by-c", "own")]
    assert logs[0] == logs[1]
    done = run.invoke(app, ["run", task, "--on", "lib:c/press_hybrid.so", "--out", "other"])
    assert done.exit_code == 2
    assert "another state of the task" in done.output


def test_what_is_no_library_is_an_error(tmp_path) -> None:
    (tmp_path / "a.so").write_text("no library\n")
    with pytest.raises(InputError, match=r"a\.so is no shared library .*: cc -std=c99 .* ring\.c"):
        InLibrary(tmp_path / "a.so", program("ring"))
    with pytest.raises(InputError, match=r"there is no .*b\.so; export the task with"):
        InLibrary(tmp_path / "b.so", program("ring"))
    (tmp_path / "c.c").write_text("int other(void) { return 1; }\n")
    subprocess.run(["gcc", "-shared", "-fPIC", "c.c", "-o", "c.so"], cwd=tmp_path, check=True)
    with pytest.raises(InputError, match="is no library of the task 'ring'"):
        InLibrary(tmp_path / "c.so", program("ring"))


def test_what_cannot_be_exported_is_said(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    task, run = str(ROOT / "tasks" / "ring.yaml"), CliRunner()
    Path("file").write_text("")
    for arguments, text in (
        ([task, "--c", "file"], "file cannot be written to: it is a file"),
        ([task, "--c", "c", "--csv"], "--csv is of the log of a run"),
        ([task, "--c", "c", "--fmi", "2"], "it is of an FMU; name one: --fmu PATH"),
        ([task, "out.csv", "--c", "c"], "out.csv is of the log of a run"),
        ([".", "--c", "c"], "--c takes a task file, and . is a folder"),
        ([".", "--csv", "--set", "a=1"], "--set is of a task file"),
    ):
        done = run.invoke(app, ["export", *arguments])
        assert done.exit_code == 2, arguments
        assert text in done.output


def test_the_header_is_one_of_cpp_as_well(tmp_path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("there is no g++")
    made = controller_of(program("ring"))
    header, _ = made.write(tmp_path)
    command = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-x", "c++"]
    done = subprocess.run([*command, str(header)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_controller_is_the_same_text_each_time() -> None:
    first, second = (controller_of(program("ring")) for _ in range(2))
    assert first == second
    assert first.digest in first.header


@pytest.mark.parametrize(
    ("name", "written"),
    [
        *(("a-b c", "a_b_c"), ("3d", "task_3d"), ("ä", "task__")),
        *(("int", "task_int"), ("class", "task_class"), ("math", "task_math")),
    ],
)
def test_names_become_those_of_c(name, written) -> None:
    assert identifier(name) == written
