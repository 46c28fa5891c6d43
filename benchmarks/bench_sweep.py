"""What a world of a sweep costs, side by side with bare physics.

A sweep of a task on the processors of this machine, without logs, as multiples of a bare `mj_step`
of the same scene in one process: the time on the wall from its beginning to its last row, by the
steps that all worlds have taken together. Bare steps are timed before and after it, so that a
machine that slows down slows both. Where others use the processors, the time on the wall says
little: processor time of all processes, shared out to so many, is what is left of it.

`--threads` has so many threads of this process run the worlds instead, and nothing else of a sweep:
no rows, no statistics.

    python benchmarks/bench_sweep.py [--worlds N] [--jobs N] [--task NAME] [--loop native|python]
        [--threads]
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np

from taskspec.compiler import compile_task
from taskspec.native.code import Compiling
from taskspec.program.program import Program
from taskspec.program.worlds import random_world
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.closed_loop import ClosedLoop
from taskspec_runner.loop.fixed_step import LOOP
from taskspec_runner.loop.native.loop import NativeLoop
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.rows import RowKeeper
from taskspec_runner.sweep.executors import Workers
from taskspec_runner.sweep.session import sweep
from taskspec_runner.sweep.world_run import run_world
from taskspec_runner.sweep.worlds import Worlds

TASKS = Path(__file__).resolve().parent.parent / "tasks"
STEPS, ROUNDS = 2000, 9
#: Bare steps in a row before the state is put back.
UNCONTROLLED = 100


def bare_step(program: Program) -> float:
    """Processor time of a bare step in contact [s], the median of some rounds."""
    parts = assemble(program)
    keeper = RowKeeper(parts.bus)
    model, data = parts.plant.model, parts.plant.data
    # Into contact by the task itself, then the torque of that moment is held.
    stop = int(1.5 / program.context.period)
    sensing = Sensing(parts.plant.arm, parts.plant.views.equations, parts.machine, 0)
    sensing.read()
    parts.machine.start()
    for tick in range(stop):
        parts.machine.tick(tick * program.context.period)
        parts.plant.step(parts.machine.torque)
        keeper.add()
        sensing.read()
    kept = np.concatenate([data.qpos, data.qvel, data.ctrl])
    nq, nv = model.nq, model.nv
    found = []
    for _ in range(ROUNDS):
        taken = 0.0
        for _ in range(STEPS // UNCONTROLLED):
            began = time.thread_time()
            for _ in range(UNCONTROLLED):
                mujoco.mj_step(model, data)
            taken += time.thread_time() - began
            # Under a torque that nothing controls the tool slides out of its contact.
            data.qpos[:], data.qvel[:] = kept[:nq], kept[nq : nq + nv]
            data.ctrl[:] = kept[nq + nv :]
            mujoco.mj_forward(model, data)
        found.append(taken / STEPS)
    return statistics.median(found)


def start(program: Program) -> float:
    """Processor time from nothing to the first tick of a world [s], the median of some."""
    found = []
    for number in range(15):
        world = random_world(program.context, 0, number)
        began = time.thread_time()
        parts = assemble(program, world)
        keeper = RowKeeper(parts.bus)
        LogLayout.of(program, world.task)
        sensing = Sensing(parts.plant.arm, parts.plant.views.equations, parts.machine, 0)
        sensing.read()
        parts.machine.start()
        native = NativeLoop(
            ClosedLoop(parts.machine, parts.plant, parts.bus, sensing, keeper), keeper.block
        )
        native.run(0, 1, Compiling.WAIT)
        found.append(time.thread_time() - began)
    return statistics.median(found)


def processor_time() -> float:
    """Of this process and of those that it has begun and that have ended [s]."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in both)


def by_processes(program: Program, given: argparse.Namespace) -> int:
    """Ticks of a sweep."""
    with tempfile.TemporaryDirectory() as folder:
        worlds = Worlds.of(program.context, 0, given.worlds)
        workers = Workers(None, given.jobs)
        result = sweep(program, worlds, Path(folder) / "s", workers=workers, keep="none")
    return sum(row["ticks"] for row in result.rows)


def by_threads(program: Program, given: argparse.Namespace) -> int:
    """Ticks of the same worlds, run by threads of this process."""

    def ticks(number: int) -> int:
        world = random_world(program.context, 0, number)
        return int(run_world(program, number, world, given.loop)["ticks"])

    with ThreadPoolExecutor(given.jobs) as threads:
        return sum(threads.map(ticks, range(given.worlds)))


def main() -> None:
    """Prints the ratios."""
    options = argparse.ArgumentParser()
    options.add_argument("--worlds", type=int, default=1000)
    options.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    options.add_argument("--task", default="wipe-table")
    options.add_argument("--loop", default="native")
    options.add_argument("--threads", action="store_true")
    given = options.parse_args()
    os.environ[LOOP] = given.loop
    program = compile_task(load_task(TASKS / f"{given.task}.yaml"))
    # Machine code is compiled once for a machine: the cache has it from here on.
    run_world(program, 0, random_world(program.context, 0, 0), given.loop)
    before = bare_step(program)
    began, used = time.perf_counter(), processor_time()
    ticks = (by_threads if given.threads else by_processes)(program, given)
    wall, used = time.perf_counter() - began, processor_time() - used
    after = bare_step(program)
    steps = ticks * round(
        program.context.loaded.task.control.plant_rate / program.context.loaded.task.control.rate
    )
    bare = (before + after) / 2
    who = resource.RUSAGE_SELF if given.threads else resource.RUSAGE_CHILDREN
    memory = resource.getrusage(who).ru_maxrss / 1024
    by = "threads" if given.threads else "processes"
    print(f"{given.task}, {given.worlds} worlds, {given.jobs} {by}, loop {given.loop}")
    print(f"bare step         {1e6 * before:.2f} us before, {1e6 * after:.2f} us after")
    print(f"a step of a world {1e6 * wall / steps:.2f} us on the wall, {wall / steps / bare:.2f} x")
    shared = used / given.jobs / steps
    print(f"                  {1e6 * shared:.2f} us of processors, {shared / bare:.2f} x")
    print(f"a world           {1e3 * used / given.worlds:.0f} ms of processors")
    if given.loop == "native":
        print(f"start of a world  {1e3 * start(program):.1f} ms")
    print(f"memory            {memory:.0f} MB of the largest worker")


if __name__ == "__main__":
    main()
