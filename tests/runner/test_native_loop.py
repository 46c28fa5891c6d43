"""The loop in machine code does what Python's does, to the bit, and says where it cannot."""

from __future__ import annotations

import contextlib
import ctypes
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.native import code, engine
from taskspec.program.execution.machine import Machine, Opening
from taskspec.program.program import Program
from taskspec.spec import load_task
from taskspec_runner import run
from taskspec_runner.errors import InputError
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.closed_loop import ClosedLoop
from taskspec_runner.loop.native.loop import NativeLoop
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.record.block import checksums
from taskspec_runner.record.log import Log
from taskspec_runner.runs import Run

TASKS = Path(__file__).resolve().parents[2] / "tasks"
#: One with each thing that a plant or a sensor may have. `make native` has them all.
DIFFERENT = (
    "bushing-press",  # a spring in six directions
    "conveyor",  # an object that moves by itself
    "exact-ring",  # equations that hold exactly, one of which moves
    "coarse-encoders",  # encoders with lines, an observer, the truth observed beside
    "door-handle",  # a grip, a mechanism with a detent
    "helix-cut",  # axes that follow another one
    "linkage",  # equations on the tip and on joints
    "linkage-in-joints",  # a motion and a path of joints on a constraint, joint torques
    "pick-and-screw",  # a body that is gripped, and a thread that takes it
    "peg-in-hole",  # a tool with sides, a cut, retries by condition
    "press-qp",  # a program of limits
    "slot-insertion",  # a box as the tool
    "spiral-guide",  # equations on the tip's rotation
    "wipe-bowl",  # a hollow, of which a ball touches the inside
    "wipe-mesh",  # a mesh, whose facets a frame blends
    "unknown-normal",  # a frame that is estimated
    "wrist-sensor",  # a sensor with noise at the wrist, its zero measured
)


def logged(program: Program, folder: Path, loop: str, seed: int = 3) -> tuple[bytes, str]:
    """What a run of a loop writes, with its changes of stage, and which loop ran it."""
    folder.mkdir()
    path = folder / "log.arrow"
    parts = assemble(program)
    with closing(parts.recorder(Log(path))) as recorder:
        outcome = fixed_step.run(
            parts.machine,
            parts.plant,
            parts.bus,
            recorder,
            program.context.period,
            seed=seed,
            loop=loop,
        )
    return path.read_bytes() + repr(parts.machine.transitions).encode(), outcome.loop


def the_same(program: Program, folder: Path) -> bool:
    """Whether machine code, the interpreter and Python write the same, each where it should run."""
    native, loop = logged(program, folder / "native", "native")
    interpreted, tier = logged(program, folder / "interpreted", "interpreted")
    python, _ = logged(program, folder / "python", "python")
    assert (loop, tier) == ("native", "native")
    return native == interpreted == python


@pytest.mark.parametrize("task", DIFFERENT)
def test_the_loops_write_the_same_bytes(task: str, tmp_path: Path) -> None:
    assert the_same(compile_unchecked(load_task(TASKS / f"{task}.yaml")), tmp_path)


SLOWED = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 331 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 330 mm], friction: 0.2}}
stages:
  go:
    axes: {z: {force: -10 N - 6 N*sin(2*pi*t/(0.7 s))}}
    path:
      raster: {size: [20 mm, 8 mm], pitch: 4 mm}
      speed: 60 mm/s * clamp(1 + force.z/(15 N), 0, 1)
    within: {time: 20 s}
"""


def test_the_loops_go_along_a_slowed_path_alike(tmp_path: Path) -> None:
    (tmp_path / "slowed.yaml").write_text(SLOWED)
    program = compile_unchecked(load_task(tmp_path / "slowed.yaml"))
    assert the_same(program, tmp_path)


MEASURED = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world: {table: {shape: plane, xyz: [500 mm, 0, 300 mm], rpy: [0, 10 deg, 0], stiffness: 20 kN/m}}
frames: {here: {parent: world, xyz: [500 mm, 0, 300 mm]}}
frame: here
stages:
  approach: {axes: {z: {velocity: -10 mm/s}}, until: force.z < -2 N, within: {time: 2 s}}
  follow:
    axes:
      x: {velocity: 20 mm/s}
      z: {force: -8 N}
      y: {follows: 2 * z + 5 mm * sin(x/(5 mm))}
      rx: {follows: 3 rad/m * y}
    time: 0.5 s
"""


def test_the_loops_follow_measured_and_commanded_axes_alike(tmp_path: Path) -> None:
    (tmp_path / "measured.yaml").write_text(MEASURED)
    program = compile_unchecked(load_task(tmp_path / "measured.yaml"))
    assert the_same(program, tmp_path)


FLAT = """
taskspec: 1
robot:
  model: panda
  tool: {{{tool}, length: 120 mm, mass: 300 g}}
  start: {{xyz: [500 mm, 0, 332 mm], rpy: [181 deg, 2 deg, 0]}}
world: {{plate: {{{plate}, stiffness: 40 kN/m, damping: 60 N*s/m, friction: 0.3}}}}
stages:
  press: {{axes: {{z: {{force: -15 N}}, rx: {{torque: 0}}, ry: {{torque: 0}}}}, time: 0.5 s}}
  slide:
    axes: {{x: {{velocity: 60 mm/s}}, z: {{force: -15 N}}, rx: {{torque: 0}}, ry: {{torque: 0}}}}
    time: 1 s
"""


@pytest.mark.parametrize(
    "tool", ["cylinder, radius: 15 mm, thickness: 20 mm", "box, size: [30 mm, 20 mm, 20 mm]"]
)
@pytest.mark.parametrize(
    "plate",
    [
        "box, size: [100 mm, 200 mm, 20 mm], xyz: [500 mm, 0, 320 mm]",
        "hole, radius: 25 mm, depth: 10 mm, xyz: [540 mm, 0, 330 mm]",
    ],
)
def test_the_loops_press_and_slide_a_flat_tool_alike(tool: str, plate: str, tmp_path: Path) -> None:
    """It seats itself, slides, and comes over the edge of the plate or into its hole."""
    text = FLAT.format(tool=f"shape: {tool}", plate=f"shape: {plate}")
    (tmp_path / "flat.yaml").write_text(text)
    program = compile_unchecked(load_task(tmp_path / "flat.yaml"))
    assert the_same(program, tmp_path)


VARYING = """
taskspec: 1
robot: {{model: {arm}, start: {{xyz: [500 mm, 0, 340 mm]}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 330 mm], friction: 0.2}}}}
law:
  kind: {law}
  stiffness:
    x: 900 N/m + 200 N/m * sin(2*pi*t/(0.7 s))
    z: "max(600 N/m + 20 kN/m^2 * table.gap, 200 N/m)"
    xz: 150 N/m + 20 N/m * cos(2*pi*clock/(1 s))
    zrx: 5 N/rad
    yrz: 4 N/rad
    xrz: 2 N/rad
    y: 800 N/m
    rx: 40 N*m/rad
    rz: 40 N*m/rad
stages:
  approach: {{axes: {{z: {{move: -15 mm, speed: 50 mm/s}}}}}}
  press: {{axes: {{z: {{force: -8 N}}}}, time: 0.6 s}}
  leave: {{axes: {{x: {{velocity: 20 mm/s}}}}, time: 0.5 s}}
"""


@pytest.mark.parametrize("arm", ["ur5e", "panda"])
@pytest.mark.parametrize("law", ["impedance", "impedance-natural", "pd-joint", "parallel"])
def test_the_loops_compute_gains_that_vary_alike(arm: str, law: str, tmp_path: Path) -> None:
    (tmp_path / "varying.yaml").write_text(VARYING.format(arm=arm, law=law))
    program = compile_unchecked(load_task(tmp_path / "varying.yaml"))
    assert program.context.loaded.task.varying_gains
    assert the_same(program, tmp_path)


TRACKING = """
taskspec: 1
robot:
  model: panda
  tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}
  start: {xyz: [500 mm, 0, 403 mm]}
world:
  pipe:
    {shape: cylinder, xyz: [500 mm, 0, 300 mm], rpy: [90 deg, 0, 0], radius: 100 mm,
     length: 300 mm, stiffness: 10 kN/m, damping: 30 N*s/m, friction: 0.2}
frames: {skin: {track: force}}
frame: skin
law: parallel
stages:
  touch: {axes: {z: {velocity: -20 mm/s, force: -15 N}}, time: 0.5 s}
  slide: {axes: {x: {velocity: 40 mm/s}, z: {force: -15 N}}, time: 0.5 s}
  more: {axes: {x: {velocity: 40 mm/s}, z: {force: -15 N}, ry: {hold: world}}, time: 0.5 s}
"""


@pytest.mark.parametrize("of", ["force", "velocity"])
def test_the_loops_turn_a_frame_that_tracks_alike(of: str, tmp_path: Path) -> None:
    (tmp_path / "tracking.yaml").write_text(TRACKING.replace("track: force", f"track: {of}"))
    program = compile_unchecked(load_task(tmp_path / "tracking.yaml"))
    assert the_same(program, tmp_path)


@pytest.mark.parametrize("loop", ["native", "python"])
def test_ticks_of_either_loop_have_the_checksums_that_a_reader_expects(
    loop: str, tmp_path: Path
) -> None:
    """A run that is killed keeps the ticks whose checksums are right."""
    program = compile_unchecked(load_task(TASKS / "press-qp.yaml"))
    parts, log = assemble(program), Log(tmp_path / "log.arrow")
    with closing(parts.recorder(log)) as recorder:
        ticks = fixed_step.run(
            parts.machine, parts.plant, parts.bus, recorder, program.context.period, loop=loop
        ).ticks
        assert recorder.block is not None
        room = len(recorder.block.rows)
        last = np.arange(ticks - min(ticks, room), ticks)
        rows = recorder.block.rows[last % room]
        assert recorder.block.sums[last % room].tolist() == checksums(rows, last).tolist()


def test_threads_write_the_same_bytes(tmp_path: Path) -> None:
    program = compile_unchecked(load_task(TASKS / "press-qp.yaml"))
    with ThreadPoolExecutor(2) as pool:
        paths = [tmp_path / str(i) for i in range(4)]
        made = list(pool.map(lambda path: logged(program, path, "native")[0], paths))
    assert made == made[:1] * 4


def test_code_that_nobody_waited_for_is_not_taken_for_another_function(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Functions are known by where they lie, where others come to lie once they are gone."""
    monkeypatch.setenv("TASKSPEC_CACHE", "")
    monkeypatch.setattr(code, "_ENGINES", code._Engines())
    x = ca.SX.sym("x")
    for number in range(60):
        function = ca.Function("f", [x], [x + number])
        with contextlib.suppress(code.NotReadyError):
            code.expression_engine(function, code.Compiling.BESIDE)
        del function
    code._compiler().submit(int).result()
    for number in range(100, 160):
        function = ca.Function("f", [x], [x + number])
        made = code.expression_engine(function, code.Compiling.WAIT)
        argument, result = np.ones(1), np.zeros(1)
        pointers = [(ctypes.c_void_p * 1)(array.ctypes.data) for array in (argument, result)]
        call = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 4, ctypes.c_int)
        call(made.address(code.CODE))(*pointers, None, None, 0)
        assert result[0] == number + 1.0


def test_code_that_is_on_its_way_is_found_by_what_is_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Worlds of a sweep come with functions of their own while that of the first is compiled."""
    monkeypatch.setenv("TASKSPEC_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(code, "_ENGINES", code._Engines())
    x = ca.SX.sym("x")
    functions = [ca.Function("f", [x], [x + 1]) for _ in range(4)]
    held = threading.Event()
    code._compiler().submit(held.wait)
    for function in functions[:3]:
        with pytest.raises(code.NotReadyError):
            code.expression_engine(function, code.Compiling.BESIDE)
    held.set()
    made = code.expression_engine(functions[3], code.Compiling.WAIT)
    assert all(
        code.expression_engine(function, code.Compiling.NOT_YET) is made for function in functions
    )
    assert len(code._ENGINES._made) == 1
    assert not code._ENGINES._alike_under_way


def test_code_of_all_stages_is_asked_for_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is compiled beside a run is that of stages too that it has not come to yet."""
    monkeypatch.setenv("TASKSPEC_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(code, "_ENGINES", code._Engines())
    program = compile_unchecked(load_task(TASKS / "press-parallel-pid.yaml"))
    parts = assemble(program)
    with closing(parts.recorder(Log(tmp_path / "log.arrow"))) as recorder:
        sensing = Sensing(parts.plant.arm, parts.plant.views.equations, parts.machine)
        closed = ClosedLoop(parts.machine, parts.plant, parts.bus, sensing, recorder)
        loop = NativeLoop(closed, recorder.block)
        loop.ready(code.Compiling.NOT_YET)
        assert not code._ENGINES._under_way
        loop.ready(code.Compiling.BESIDE)
        asked = [runner.tick.function for runner in parts.machine.runners]
        code._compiler().submit(int).result()
    for function in asked:
        assert code.expression_engine(function, code.Compiling.NOT_YET).names == (code.CODE,)


@pytest.fixture
def nothing_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TASKSPEC_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(code, "_ENGINES", code._Engines())
    monkeypatch.delenv("TASKSPEC_LOOP", raising=False)


def with_code_of_their_own(machine: Machine) -> list[bool]:
    """Of each stage, whether its tick has machine code of its own."""
    return [runner.tick.code is not None for runner in machine.runners]


@pytest.mark.usefixtures("nothing_kept")
def test_a_file_that_nobody_has_seen_runs_natively_without_being_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From its first tick on: Python makes those alone with which stages begin and end."""
    program = compile_unchecked(load_task(TASKS / "tilted-force.yaml"))
    by_python: list[float] = []
    tick = Machine.tick

    def ticks(machine: Machine, clock: float) -> float:
        by_python.append(clock)
        return tick(machine, clock)

    monkeypatch.setattr(Machine, "tick", ticks)
    parts = assemble(program)
    with closing(parts.recorder(Log(tmp_path / "log.arrow"))) as recorder:
        period = program.context.period
        outcome = fixed_step.run(parts.machine, parts.plant, parts.bus, recorder, period)
    assert outcome.loop == "native"
    assert outcome.ticks > 1000 * max(len(by_python), 1)
    assert with_code_of_their_own(parts.machine) == [False] * len(parts.machine.runners)
    assert not {runner.tick.function.__hash__() for runner in parts.machine.runners} & set(
        code._ENGINES._made
    )


@pytest.mark.usefixtures("nothing_kept")
def test_code_of_its_own_takes_over_in_a_long_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = compile_unchecked(load_task(TASKS / "tilted-force.yaml"))
    monkeypatch.setattr(fixed_step, "_WORTH_COMPILING", 1000)
    had: list[tuple[float, bool]] = []

    def progress(machine: Machine, clock: float) -> None:
        """Waits for what has been asked for, so that it is there on the next tick."""
        code._compiler().submit(int).result()
        had.append((clock, machine.runner.tick.code is not None))

    parts = assemble(program)
    with closing(parts.recorder(Log(tmp_path / "log.arrow"))) as recorder:
        fixed_step.run(
            *(parts.machine, parts.plant, parts.bus, recorder, program.context.period),
            progress,
            seed=3,
        )
    assert not any(own for clock, own in had if clock < 1.0)
    assert all(own for clock, own in had if clock > 2.0)
    assert {own for _, own in had} == {False, True}
    expected, _ = logged(program, tmp_path / "python", "python")
    transitions = repr(parts.machine.transitions).encode()
    assert (tmp_path / "log.arrow").read_bytes() + transitions == expected


@pytest.fixture
def without_llvmlite(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(code, "_ENGINES", code._Engines())
    monkeypatch.setattr(engine, "missing", lambda: "llvmlite is not installed")
    monkeypatch.delenv("TASKSPEC_LOOP", raising=False)


@pytest.mark.usefixtures("without_llvmlite")
def test_without_machine_code_python_runs_and_the_manifest_says_so(tmp_path: Path) -> None:
    made = run(load_task(TASKS / "tilted-force.yaml"), tmp_path / "run", report=False)
    assert made.manifest["loop"] == "python"
    assert made.manifest["why_python"] == "llvmlite is not installed"
    with pytest.raises(InputError, match="native loop cannot be had: llvmlite is not installed"):
        run(load_task(TASKS / "tilted-force.yaml"), tmp_path / "run", report=False, loop="native")


def test_the_environment_names_a_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = load_task(TASKS / "tilted-force.yaml")
    monkeypatch.setenv("TASKSPEC_LOOP", "native")
    made = run(loaded, tmp_path / "run", report=False)
    assert (made.manifest["loop"], made.manifest["why_python"]) == ("native", None)
    monkeypatch.setenv("TASKSPEC_LOOP", "fast")
    with pytest.raises(
        InputError, match="TASKSPEC_LOOP names native, interpreted or python, not 'fast'"
    ):
        run(loaded, tmp_path / "run", report=False)


def test_code_is_kept_and_what_is_damaged_is_made_anew(tmp_path: Path) -> None:
    """In a cache that is empty, another version's, full, and spoiled, the log's bytes are alike."""
    cache, out = tmp_path / "cache", tmp_path / "run"
    logs = [in_process(cache, out, OTHER_VERSION)]
    others = code_in(cache)
    logs.append(in_process(cache, out))
    kept = code_in(cache)
    assert kept > others
    assert len(kept) == 2 * len(others) > 3
    logs.append(in_process(cache, out))
    assert code_in(cache) == kept
    for path in filter(Path.is_file, cache.rglob("*")):
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
    logs.append(in_process(cache, out))
    assert logs == logs[:1] * 4


#: What makes a process keep machine code as another version does.
OTHER_VERSION = "from taskspec.native import engine; engine._SCHEMA = -1"


def code_in(cache: Path) -> set[Path]:
    return {path for path in (cache / "native").rglob("*") if path.is_file()}


def in_process(cache: Path, out: Path, first: str = "") -> bytes:
    """What a run in a process of its own logs, with its machine code kept in a folder.

    Args:
        cache: that folder.
        out: of the run.
        first: what the process does before it.
    """
    environment = {**os.environ, "TASKSPEC_CACHE": str(cache)}
    task = TASKS / "tilted-force.yaml"
    program = f"{first}\nfrom taskspec_runner.cli import main; main()"
    command = [sys.executable, "-c", program, "run", task, "--loop", "native"]
    subprocess.run([*command, "--quiet", "--out", out], env=environment, check=True)
    assert Run.load(out).manifest["loop"] == "native"
    return (out / "log.arrow").read_bytes()


@pytest.mark.parametrize("task", ["linkage", "raster-polish", "unknown-normal", "wrist-sensor"])
def test_machine_code_opens_the_stages_that_follow(
    task: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Coordinates are chosen, a path is entered, a frame is estimated, a sensor's zero measured."""
    program = compile_unchecked(load_task(TASKS / f"{task}.yaml"))
    opened: list[str] = []
    by_python = Machine.open

    def opens(machine: Machine, opening: Opening) -> None:
        opened.append(machine.stage.name)
        by_python(machine, opening)

    monkeypatch.setattr(Machine, "open", opens)
    logged(program, tmp_path / "python", "python")
    assert opened
    opened.clear()
    logged(program, tmp_path / "native", "native")
    assert not opened


REPEATED = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 335 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 330 mm]}}
stages:
  down:
    axes: {z: {velocity: -40 mm/s}}
    until: force.z < -3 N
    within: {time: 3 s}
  press:
    axes: {z: {force: -20 N}}
    limits: {force: {max: 15 N, then: up}}
    time: 2 s
    next: end
  up:
    axes: {z: {velocity: 20 mm/s}}
    limits: {force: {max: 12 N, then: down}}
    time: 300 ms
    attempts: 2
    next: down
"""


def test_the_loops_take_ways_that_python_has_to_open_alike(tmp_path: Path) -> None:
    """A limit that leads to a stage does not count there at first, and attempts come to an end."""
    (tmp_path / "repeated.yaml").write_text(REPEATED)
    program = compile_unchecked(load_task(tmp_path / "repeated.yaml"))
    assert the_same(program, tmp_path)


OSQP = """
taskspec: 1
robot:
  model: ur5e
  tool: {shape: cylinder, radius: 4.5 mm, thickness: 40 mm, length: 121 mm, mass: 300 g}
  start: {xyz: [417.5 mm, 92.1 mm, 125 mm]}
world:
  socket: {shape: hole, depth: 9 mm, radius: 4.58 mm, chamfer: 1.6 mm, xyz: [417 mm, 92 mm, 124 mm],
           stiffness: 1.1 kN/m, damping: 11 N*s/m, friction: 0.28}
law: {kind: hybrid, solve: qp, solver: osqp}
limits: {force: 124 N}
control: {rate: 500 Hz}
stages:
  approach: {axes: {z: {velocity: -24 mm/s}}, until: touching for 10 ms, within: {time: 2 s}}
  insert: {axes: {x: {force: 0}, y: {force: 0}, rx: {torque: 0}, z: {force: -16 N}}, time: 0.2 s}
"""


def test_a_stage_whose_first_tick_python_has_to_make_is_opened_once(tmp_path: Path) -> None:
    """OSQP answers in Python: machine code leaves that tick, and goes on with the next one."""
    (tmp_path / "osqp.yaml").write_text(OSQP)
    program = compile_unchecked(load_task(tmp_path / "osqp.yaml"))
    assert the_same(program, tmp_path)
