"""What a worker keeps of the worlds that it has run: nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from taskspec.compiler import compile_task
from taskspec.native import code, rows
from taskspec.native.engine import available
from taskspec.program.worlds import random_world
from taskspec.spec import load_task
from taskspec_runner.sweep.world_run import run_world

TASKS = Path(__file__).resolve().parents[2] / "tasks"

FELT = """taskspec: 1
robot:
  model: planar3
  start: {xyz: [500 mm, 300 mm, 0]}
  sensor: {at: wrist, bias: [1 N, 0, 0, 0, 0, 0], filter: 100 Hz}
world: {wall: {shape: plane, xyz: [520 mm, 0, 0], rpy: [0, -90 deg, 0]}}
frame: wall
stages:
  touch: {axes: {z: {velocity: -40 mm/s}}, until: force.z < -4 N, within: 0.6 s}
  press: {axes: {z: {force: -10 N}}, time: 0.1 s}
vary:
  robot.tool.mass: normal(10 g)
  robot.sensor.bias: [normal(0.3 N), normal(0.3 N), 0, 0, 0, 0]
  robot.sensor.filter: 80..200 Hz
  world.wall.stiffness: 10..100 kN/m
  world.wall.xyz: [normal(1 mm), 0, 0]
expect: [max(norm(force)) < 12 N]
"""

GROWTH = """
import ctypes
import gc
import sys
from taskspec.program.worlds import random_world
from taskspec.compiler import compile_task
from taskspec.native import code, rows
from taskspec.spec import load_text
from taskspec_runner.sweep.world_run import run_world

# Code comes once, with LLVM itself, some 16 MB: all of it before anything is measured.
rows._WORTH = 1

def anonymous():
    code._compiler().submit(int).result()
    # What waits for the collector, and free pages that malloc holds back, are nobody's: 5 to 13 MB
    # by the moment at which they are asked for, 0.3 MB of what is live.
    gc.collect()
    getattr(ctypes.CDLL(None), "malloc_trim", int)(0)
    with open("/proc/self/smaps_rollup") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("Anonymous:"))

program = compile_task(load_text(sys.argv[1], "felt.yaml"))
for number in range(71):
    run_world(program, number, random_world(program.context, 0, number), "native")
    if number in (20, 70):
        print(anonymous())
"""


@pytest.mark.skipif(not available(), reason="there is no machine code here")
@pytest.mark.skipif(not Path("/proc/self/smaps_rollup").exists(), reason="Linux tells it")
def test_a_worker_does_not_grow_with_its_worlds():
    """Anonymous memory of a process of its own, between its worlds 20 and 70 [kB].

    Ticks of a world here are some 0.5 MB, the code of its three functions 0.5 MB: a worker that
    keeps either grows by 25 MB.
    """
    ran = subprocess.run(
        [sys.executable, "-c", GROWTH, FELT], capture_output=True, text=True, check=True
    )
    before, after = map(int, ran.stdout.split())
    assert after - before < 50 * 125


VARIED = {
    "wrist-sensor": "{robot.tool.mass: +- 10 g, robot.sensor.bias: [normal(2 N), 0, 0, 0, 0, 0]}",
    "drawer": "{world.drawer.detent.force: 10..20 N, world.drawer.rpy: [0, 0, +- 1 deg]}",
    "screw": "{world.cap.pitch: 3..5 mm/turn, world.cap.rpy: [+- 1 deg, 0, 0]}",
    "ring": "{world.rim.stiffness: 30..60 kN/m, world.level.damping: 50..200 N*s/m}",
    "linkage": "{world.bars.stiffness: 1..3 kN*m/rad}",
    "exact-ring": "{robot.joint_damping: 0..2 N*m*s/rad, robot.payload.mass: 0..300 g}",
}


@pytest.mark.skipif(not available(), reason="there is no machine code here")
@pytest.mark.parametrize("name", VARIED)
def test_worlds_share_their_machine_code(name, monkeypatch):
    """Numbers of a world are read by the code, and not in it: a second world compiles nothing."""
    # Signals of the log are compiled by the first world too, not once some worlds have asked.
    monkeypatch.setattr(rows, "_WORTH", 1)
    program = compile_task(load_task(TASKS / f"{name}.yaml", {"vary": VARIED[name]}), force=True)
    held = []
    for number in (0, 1, 2):
        run_world(program, number, random_world(program.context, 0, number), "native")
        # What a world left to be compiled beside it is counted as its own.
        code._compiler().submit(int).result()
        held.append(len(code._ENGINES._made))
    assert held[0] == held[1] == held[2]
