"""Holds exported controllers against the native loop, byte by byte, and measures them.

Every shipped task is exported, compiled and run in worlds of its own until it has had its share of
the ticks: by the native loop, and by the C, whose instance gives the log its outputs. No machine of
Python's runs beside it. The two logs are to have the same bytes.

    python campaigns/exported.py --ticks 10000000 [--table docs/c.md] [SHIPPED ...]

What the first run of a task measured is then given to other builds of its C: by clang, and with
AddressSanitizer and UndefinedBehaviorSanitizer. Their answers are to have the same bytes, too. The
program that times ticks repeats that run. The least time of each tick over the repetitions is that
of the code without interrupts; the worst of these is the worst tick.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import native
from taskspec.compiler import compile_task
from taskspec.control.qp.dual import dual_solver
from taskspec.native.kernel import Kind
from taskspec.program.components import changed
from taskspec.program.execution.controller_memory import controller_memories
from taskspec.program.program import Program
from taskspec.program.worlds import World, random_world, true_world
from taskspec.spec import load_task
from taskspec_runner.controller_c.layout import Layout
from taskspec_runner.controller_c.source import controller_of
from taskspec_runner.link.library import ControllerLibrary, InLibrary
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.closed_loop import LOOK_EVERY
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.record.log import Log

ROOT = Path(__file__).resolve().parents[1]
HERE = Path(__file__).resolve().parent
Array = NDArray[np.float64]

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused-function")
_CHECKED = "-fsanitize=address,undefined,float-cast-overflow"
SANITIZED = ("-g", _CHECKED, "-fno-sanitize-recover=all")
#: Builds whose answers are held against those of the library, which gcc makes at -O2.
BUILDS: Mapping[str, Sequence[str]] = {
    "clang": ("clang", "-O2", "-ffp-contract=off"),
    "sanitizers": ("gcc", "-O0", *SANITIZED),
}
#: What a tick may take [us], and how many times its median.
MOST, RATIO = 100.0, 3.0
#: How often the program that times ticks repeats them.
REPETITIONS = 30
#: What `--table` replaces.
_MARK = "<!-- table: exported -->"
#: States of the header.
RUNNING, DONE, FAILED, STOPPED, ATTEMPTS, UNKNOWN, UNANSWERED = range(7)  # of `STATES`


# --- worlds ----------------------------------------------------------------------------------


def worlds(program: Program, seed: int) -> Iterator[World]:
    """The true world, and random ones without end: of `vary`, with some load and some friction.

    Each has its own noise of the sensor.
    """
    context = program.context
    yield true_world(context, seed)
    number = 0
    while True:
        drawn = random_world(context, seed, number)
        draws = np.random.default_rng([seed, number])
        task = changed(drawn.task, "robot.payload.mass", None, float(draws.uniform(0.0, 0.2)))
        task = changed(task, "robot.joint_friction", None, float(draws.uniform(0.0, 0.2)))
        for name in task.shapes:
            path = f"world.{name}.friction"
            if path not in context.loaded.task.vary:
                task = changed(task, path, None, float(draws.uniform(0.0, 0.5)))
        yield replace(drawn, task=task, number=number)
        number += 1


# --- the two runs ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Ran:
    """A run: how it ended, its ticks, and the SHA-256 of its log."""

    ended: str
    ticks: int
    digest: str


def by_native_loop(program: Program, world: World, path: Path) -> Ran:
    """A run by the native loop."""
    status, _, ticks, digest = native.ran(program, path, fixed_step.NATIVE, world)
    return Ran(status, ticks, digest)


class Exported:
    """A task's controller in C, as a library that drives the plant.

    Attributes:
        controller: its text.
        seconds: that gcc took at -O2.
        bytes: of the instance; code: of the library's instructions and tables.
    """

    def __init__(self, program: Program, folder: Path) -> None:
        """Writes and compiles it."""
        self.program, self.controller = program, controller_of(program)
        self.header, self.source = self.controller.write(folder)
        self.path = folder / f"{self.controller.name}.so"
        begin = os.times()
        build(("gcc", *STRICT, "-O2", "-shared", "-fPIC", str(self.source)), self.path)
        self.seconds = os.times().children_user - begin.children_user
        size = subprocess.run(["size", str(self.path)], check=True, capture_output=True, text=True)
        text, data = size.stdout.splitlines()[1].split()[:2]
        self.code = int(text) + int(data)
        machine = program.machine(own=dual_solver)
        block = Layout(controller_memories(machine)).blocks[Kind.VECTOR]
        self._outputs, self._now = block.place(machine.outputs), block.place(machine.now)
        self.bytes = len(self.library().memory)

    def library(self) -> ControllerLibrary:
        """A new instance."""
        context = self.program.context
        task = context.loaded.task
        return ControllerLibrary(
            self.path,
            self.controller,
            context.robot.n,
            len(task.reported),
            grips=bool(task.gripped),
        )

    def run(self, world: World, path: Path, samples: list[Array] | None = None) -> Ran:
        """A run by the C; the samples of its ticks are added to `samples`."""
        program, library = self.program, self.library()
        parts, period = assemble(program, world), program.context.period
        plant, bus, machine = parts.plant, parts.bus, parts.machine
        sensing = Sensing(plant.arm, plant.views.equations, machine, world.noise_seed)
        wrench = machine.wrench if machine.sensor is None else machine.sensor.reading
        # They are what the instance begins with.
        numbers = library.memory.view(np.float64)
        outputs = numbers[self._outputs : self._outputs + len(bus.outputs)]
        now = numbers[self._now : self._now + 2]
        clock, t, stage = (bus.slices[name].start for name in ("clock", "t", "stage"))
        ticks, state, to, kept = 0, RUNNING, bus.array, bus.outputs

        def read() -> None:
            sensing.read()
            library.q[:], library.v[:], library.wrench[:] = machine.q, machine.v, wrench
            library.reactions[: len(machine.reactions)] = machine.reactions

        with closing(parts.recorder(Log(path))) as recorder:
            read()
            library.answer(0.0, first=True)
            while True:
                read()
                to[clock] = ticks * period
                library.answer(to[clock])
                if samples is not None:
                    samples.append(library.sample.copy())
                state = library.state
                machine.torque[:], kept[:] = library.command, outputs
                if machine.grip.used:
                    np.asarray(machine.grip.command)[:] = library.grip
                to[t], to[stage] = now[0], library.stage
                # The tick that breaks a limit belongs to the log.
                if state == RUNNING or state in (STOPPED, UNKNOWN, UNANSWERED):
                    plant.step(machine.torque)
                    recorder.add()
                    ticks += 1
                if state != RUNNING:
                    break
                looks = plant.arm.diverged or ticks % LOOK_EVERY == 0
                if looks and plant.alarm() is not None:
                    state = STOPPED
                    break
        named = {DONE: fixed_step.DONE, FAILED: fixed_step.FAILED, ATTEMPTS: fixed_step.FAILED}
        return Ran(named.get(state, fixed_step.STOPPED), ticks, _digest(path))


def _digest(path: Path) -> str:
    """SHA-256 of a log, which is removed."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    for each in (path, path.with_name("log.block")):
        each.unlink(missing_ok=True)
    return digest


# --- builds ----------------------------------------------------------------------------------


def build(command: Sequence[str], out: Path) -> None:
    """Compiles C."""
    subprocess.run([*command, "-o", str(out), "-lm"], check=True)


def possible() -> list[tuple[str, Sequence[str]]]:
    """The builds whose compiler is on this computer."""
    return [(name, by) for name, by in BUILDS.items() if shutil.which(by[0])]


def around(made: Exported, source: Path) -> tuple[str, ...]:
    """Arguments of a compiler for a program around an exported controller."""
    defined = (f"-DNAME={made.controller.name}", f'-DHEADER="{made.header.name}"')
    return (*STRICT, *defined, f"-I{made.header.parent}", str(source))


def answered(made: Exported, samples: Array, command: Sequence[str]) -> bytes:
    """The answers of a build to samples."""
    out = made.path.with_name("drive")
    build((*command, *around(made, ROOT / "tests/controller_c/drive.c"), str(made.source)), out)
    done = subprocess.run([out], input=samples.tobytes(), check=True, capture_output=True)
    return done.stdout


def replayed(made: Exported, samples: Array) -> bytes:
    """The answers of the library to the same samples."""
    library, found = made.library(), []
    for i, sample in enumerate(samples):
        library.sample[:] = sample
        if i == 0:
            library.answer(sample[-1], first=True)
        library.answer(sample[-1])
        answer = (library.command, library.grip, [library.state, library.stage])
        found.append(np.concatenate(answer))
    return np.array(found).tobytes()


def timed(made: Exported, samples: Array) -> dict[str, tuple[float, float]]:
    """Median and worst tick [us]: of whole runs, and of single ticks that are repeated."""
    file, out = made.path.with_name("samples"), made.path.with_name("worst_tick")
    file.write_bytes(samples.tobytes())
    source = HERE / "worst_tick.c"
    build(("gcc", "-O2", *around(made, source), str(made.path), "-Wl,-rpath,$ORIGIN"), out)
    done = subprocess.run([out, file, str(REPETITIONS)], check=True, capture_output=True)
    run, place = 1e6 * np.frombuffer(done.stdout).reshape(2, len(samples))
    return {
        "run": (float(np.median(run)), float(run.max())),
        "place": (float(np.median(place[::64])), float(np.nanmax(place))),
    }


# --- the command -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """What came of a task.

    Attributes:
        ticks, worlds: that it was run. differ: worlds whose logs differ.
        bytes, code, seconds: as `Exported`.
        builds: whose answers differ.
        times: median and worst tick [us], as `timed`.
    """

    task: str
    ticks: int
    worlds: int
    differ: list[str]
    ended: Mapping[str, int]
    bytes: int
    code: int
    seconds: float
    builds: list[str]
    times: Mapping[str, tuple[float, float]]


def row(task: str, ticks: int, folder: Path) -> Row:
    """Runs a task for so many ticks, at least once, and all builds of it."""
    program = compile_task(load_task(ROOT / "tasks" / f"{task}.yaml"), force=True)
    made, log, own = (
        Exported(program, folder),
        folder / "log.arrow",
        folder / "native" / "log.arrow",
    )
    own.parent.mkdir()
    samples: list[Array] = []
    differ, ended, count, total = [], Counter[str](), 0, 0
    for world in worlds(program, 0):
        wanted = by_native_loop(program, world, own)
        found = made.run(world, log, None if count else samples)
        if not world.task.joints_exact:
            # What is true of the arm is what the file's machine, which runs beside, would know.
            link = InLibrary(made.path, program)
            status, _, ran, _ = native.ran(program, log, fixed_step.PYTHON, world, link)
            found = Ran(status, ran, _digest(log))
        if found != wanted:
            differ.append(f"{world.label or 'true'}: {wanted}, {found}")
        ended[wanted.ended] += 1
        count, total = count + 1, total + wanted.ticks
        if total >= ticks:
            break
    given = np.array(samples)
    answers = replayed(made, given)
    builds = [name for name, by in possible() if answered(made, given, by) != answers]
    times = timed(made, given)
    measured = (made.bytes, made.code, made.seconds, builds, times)
    return Row(task, total, count, differ, dict(ended), *measured)


def table(rows: Sequence[Row]) -> str:
    """The table of the page."""
    lines = [
        "| task | ticks | worlds | instance | code | gcc | median | worst | | in place | worst | |",
        "| --- |" + " --- |" * 11,
    ]
    for each in rows:
        times = [
            f"{median:.1f} us | {worst:.1f} us | {worst / median:.1f}"
            for median, worst in each.times.values()
        ]
        cells = [
            *(each.task, f"{each.ticks:_}".replace("_", " "), str(each.worlds)),
            f"{each.bytes:_}".replace("_", " "),
            *(f"{each.code / 1000:.0f} kB", f"{each.seconds:.1f} s", *times),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    """Runs the tasks; the exit code is 1 if anything differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=10_000_000, help="of all tasks")
    parser.add_argument("--rows", type=Path, default=ROOT / "runs" / "exported.jsonl")
    parser.add_argument("--table", type=Path, help="page that gets the table of all rows")
    parser.add_argument("shipped", nargs="*", help="names of tasks; all without a row if left out")
    given = parser.parse_args()
    shipped = sorted(path.stem for path in (ROOT / "tasks").glob("*.yaml"))
    given.rows.parent.mkdir(parents=True, exist_ok=True)
    for name in BUILDS.keys() - dict(possible()).keys():
        say(f"{BUILDS[name][0]} is not installed: the build by {name} is left out")
    done = kept(given.rows)
    for task in given.shipped or [task for task in shipped if task not in done]:
        with tempfile.TemporaryDirectory() as folder:
            found = row(task, -(-given.ticks // len(shipped)), Path(folder))
        with given.rows.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(found)) + "\n")
        say(f"{task}: {found}")
    rows = sorted(kept(given.rows).values(), key=lambda each: each.task)
    if given.table is not None:
        before, _, after = given.table.read_text(encoding="utf-8").split(_MARK)
        text = f"{before}{_MARK}\n{table(rows)}\n{_MARK}{after}"
        given.table.write_text(text, encoding="utf-8")
    wrong = [each for each in rows if each.differ or each.builds]
    ended = sum((Counter(each.ended) for each in rows), Counter[str]())
    say(
        f"{len(rows)} tasks, {sum(each.worlds for each in rows)} worlds "
        f"({', '.join(f'{name} {count}' for name, count in sorted(ended.items()))}), "
        f"{sum(each.ticks for each in rows)} ticks, {len(wrong)} differ"
    )
    for name in ("run", "place"):
        worst = max(rows, key=lambda each: each.times[name][1])
        above = [each.task for each in rows if each.times[name][1] > RATIO * each.times[name][0]]
        say(
            f"{name}: the worst tick takes {worst.times[name][1]:.1f} of {MOST:.0f} us "
            f"({worst.task}); of {len(above)} tasks more than {RATIO:g} medians"
        )
    late = [each for each in rows if any(worst > MOST for _, worst in each.times.values())]
    return int(bool(wrong or late))


def kept(path: Path) -> dict[str, Row]:
    """The rows of a file, the last of each task."""
    if not path.is_file():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    return {each.task: each for each in (Row(**json.loads(line)) for line in lines)}


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
