"""How often the intervals of `taskspec identify` hold: hidden worlds, each identified from one run.

A world is drawn by seed: what `truth` has of it is hidden from the file that is identified. Tasks
of `--tasks judge` are those of docs/identify.md; nothing was developed with them.

    python campaigns/identified_worlds.py --seed 7 --worlds 60 --tasks develop
    python campaigns/identified_worlds.py --seed 307 --worlds 500 --tasks judge
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from taskspec.compiler import compile_unchecked
from taskspec.geometry.rotation import from_rpy
from taskspec.program.components import value_of
from taskspec.program.program import Program
from taskspec.spec import load_text
from taskspec_runner.errors import InputError
from taskspec_runner.identify import Estimate, identify
from taskspec_runner.identify.poses import rpy_of
from taskspec_runner.trial.trial import trial

ROOT = Path(__file__).resolve().parents[1]
#: Level of the intervals.
LEVEL = 0.9
DELAY = "robot.sensor.delay"
#: A log that ends sooner has less than a start in it: its time is none for 10 s [s].
SHORT = 1.0
#: Between these a page has the table.
BEGIN, END = "<!-- begin: identify -->", "<!-- end: identify -->"

Draw = Callable[[np.random.Generator], str]


def _uniform(low: float, high: float, unit: str = "") -> Draw:
    return lambda random: f"{random.uniform(low, high):.9g} {unit}".rstrip()


def _log(low: float, high: float, unit: str) -> Draw:
    ends = math.log(low), math.log(high)
    return lambda random: f"{math.exp(random.uniform(*ends)):.9g} {unit}"


def _list(*entries: Draw | str) -> Draw:
    def drawn(random: np.random.Generator) -> str:
        return f"[{', '.join(e if isinstance(e, str) else e(random) for e in entries)}]"

    return drawn


@dataclass(frozen=True)
class Hidden:
    """A task whose worlds are drawn.

    Attributes:
        name: of it.
        text: of the file without its truth.
        truth: what is drawn, by paths.
        faults: of the truth, as the file has them; they do not vary.
    """

    name: str
    text: str
    truth: Mapping[str, Draw]
    faults: str = ""


_LIGHT = _list(*(_uniform(-1, 1, "N"),) * 3, *(_uniform(-50, 50, "mN*m"),) * 3)
_SENSOR = "noise: {force: 0.15 N, torque: 8 mN*m}"

DEVELOP = (
    Hidden(
        "press-plane",
        f"""
robot: {{model: ur5e, tool: {{shape: sphere, radius: 12 mm, length: 120 mm, mass: 400 g}},
  start: {{xyz: [450 mm, 100 mm, 320 mm]}}, sensor: {{{_SENSOR}}}}}
world: {{bench: {{shape: plane, xyz: [0, 0, 300 mm],
  stiffness: 15 kN/m, damping: 40 N*s/m, friction: 0.2}}}}
frames: {{task: {{surface: bench}}}}
frame: task
stages:
  approach: {{axes: {{z: {{velocity: -20 mm/s}}}}, until: force.z < -3 N for 10 ms, within: 4 s}}
  press:
    axes:
      z: {{force: "-12 N - 6 N*sin(2*pi*t/(0.4 s))"}}
      x: {{velocity: "30 mm/s*sin(2*pi*t/(0.9 s))"}}
      y: {{velocity: "20 mm/s*sin(2*pi*t/(0.7 s))"}}
    time: 2 s
""",
        {
            "world.bench.stiffness": _log(8, 40, "kN/m"),
            "world.bench.damping": _uniform(20, 120, "N*s/m"),
            "world.bench.friction": _uniform(0.1, 0.5),
            "world.bench.xyz": _list("0", "0", _uniform(298, 302, "mm")),
            "world.bench.rpy": _list(_uniform(-2, 2, "deg"), _uniform(-2, 2, "deg"), "0"),
            "robot.sensor.bias": _list(
                *(_uniform(-1, 1, "N"),) * 3, *(_uniform(-50, 50, "mN*m"),) * 3
            ),
            "robot.sensor.delay": _uniform(0, 6, "ms"),
            "robot.sensor.filter": _log(40, 200, "Hz"),
        },
    ),
    Hidden(
        "wipe-pipe",
        f"""
robot: {{model: panda, tool: {{shape: sphere, radius: 8 mm, length: 100 mm, mass: 300 g}},
  start: {{xyz: [500 mm, 20 mm, 345 mm]}}, sensor: {{at: wrist, {_SENSOR}}}}}
world: {{pipe: {{shape: cylinder, xyz: [500 mm, 0, 290 mm], rpy: [0, 90 deg, 0],
  radius: 40 mm, length: 500 mm,
  stiffness: 20 kN/m, friction: 0.3}}}}
frames: {{task: {{surface: pipe}}}}
frame: task
stages:
  lean: {{frame: world,
    axes: {{rx: {{move: 15 deg, speed: 20 deg/s}}, ry: {{move: 10 deg, speed: 20 deg/s}}}}}}
  back: {{frame: world,
    axes: {{rx: {{move: -15 deg, speed: 20 deg/s}}, ry: {{move: -10 deg, speed: 20 deg/s}}}}}}
  approach: {{axes: {{z: {{velocity: -20 mm/s}}}}, until: force.z < -3 N for 10 ms, within: 4 s}}
  press:
    axes:
      z: {{force: "-10 N - 5 N*sin(2*pi*t/(0.3 s))"}}
      x: {{velocity: "30 mm/s*sin(2*pi*t/(0.9 s))"}}
      y: {{velocity: "20 mm/s*sin(2*pi*t/(1.3 s))"}}
    time: 2.6 s
""",
        {
            "world.pipe.stiffness": _log(10, 40, "kN/m"),
            "world.pipe.damping": _uniform(20, 90, "N*s/m"),
            "world.pipe.friction": _uniform(0.1, 0.4),
            "world.pipe.xyz": _list("500 mm", _uniform(-1, 1, "mm"), _uniform(288, 292, "mm")),
            "robot.payload.mass": _uniform(50, 400, "g"),
            "robot.payload.xyz": _list(*(_uniform(-20, 20, "mm"),) * 2, _uniform(-60, 0, "mm")),
            "robot.sensor.bias": _list(
                *(_uniform(-1, 1, "N"),) * 3, *(_uniform(-50, 50, "mN*m"),) * 3
            ),
            "robot.sensor.delay": _uniform(0, 4, "ms"),
        },
        "[{torque: noise 0.05 N*m}]",
    ),
    Hidden(
        "swing",
        f"""
robot: {{model: ur5e, tool: {{shape: sphere, radius: 12 mm, length: 120 mm, mass: 400 g}},
  start: {{xyz: [450 mm, 100 mm, 420 mm]}}, sensor: {{{_SENSOR}}}}}
stages:
  swing:
    frame: world
    axes:
      x: {{position: "450 mm + 60 mm*sin(2*pi*t/(1.6 s))"}}
      y: {{position: "100 mm + 60 mm*sin(2*pi*t/(1.1 s))"}}
      z: {{position: "420 mm + 50 mm*sin(2*pi*t/(1.3 s))"}}
      rx: {{velocity: "50 deg/s*cos(2*pi*t/(1.4 s))"}}
      ry: {{velocity: "50 deg/s*cos(2*pi*t/(1.7 s))"}}
      rz: {{velocity: "50 deg/s*cos(2*pi*t/(1.9 s))"}}
    time: 4 s
""",
        {
            "robot.payload.mass": _uniform(50, 800, "g"),
            "robot.payload.xyz": _list(*(_uniform(-30, 30, "mm"),) * 3),
            "robot.joint_friction": _uniform(0.01, 0.3, "N*m"),
            "robot.joint_damping": _uniform(0.05, 0.5, "N*m*s/rad"),
        },
        "[{torque: noise 0.05 N*m}]",
    ),
)

_WRENCH = _list(*(_uniform(-1.5, 1.5, "N"),) * 3, *(_uniform(-80, 80, "mN*m"),) * 3)

JUDGE = (
    Hidden(
        "rub-a-slope",
        """
robot: {model: panda, tool: {shape: sphere, radius: 10 mm, length: 110 mm, mass: 350 g},
  start: {xyz: [480 mm, -60 mm, 330 mm]},
  sensor: {noise: {force: 0.2 N, torque: 12 mN*m}, delay: 1 ms}}
world: {slope: {shape: plane, xyz: [480 mm, -60 mm, 300 mm], rpy: [0, 12 deg, 0],
  stiffness: 18 kN/m, friction: 0.25}}
frames: {task: {surface: slope}}
frame: task
stages:
  near: {axes: {z: {velocity: -15 mm/s}}, until: force.z < -4 N for 10 ms, within: 4 s}
  rub:
    axes:
      z: {force: "-14 N - 5 N*sin(2*pi*t/(0.25 s)) - 3 N*sin(2*pi*t/(1.1 s))"}
      x: {velocity: "25 mm/s*sin(2*pi*t/(0.8 s))"}
      y: {velocity: "35 mm/s*sin(2*pi*t/(1.2 s))"}
    time: 2.4 s
""",
        {
            "world.slope.stiffness": _log(10, 50, "kN/m"),
            "world.slope.damping": _uniform(20, 100, "N*s/m"),
            "world.slope.friction": _uniform(0.1, 0.5),
            "world.slope.rpy": _list("0", _uniform(10.5, 13.5, "deg"), "0"),
            "robot.sensor.bias": _WRENCH,
            "robot.sensor.delay": _uniform(0.1, 5, "ms"),
            "robot.sensor.filter": _log(30, 120, "Hz"),
        },
    ),
    Hidden(
        "press-a-dome",
        """
robot: {model: ur5e, tool: {shape: sphere, radius: 15 mm, length: 130 mm, mass: 500 g},
  start: {xyz: [420 mm, 130 mm, 360 mm]},
  sensor: {noise: {force: 0.1 N, torque: 6 mN*m}, filter: 80 Hz}}
world: {dome: {shape: sphere, xyz: [420 mm, 130 mm, 240 mm], radius: 90 mm,
  stiffness: 12 kN/m, damping: 40 N*s/m, friction: 0.3}}
frames: {task: {surface: dome}}
frame: task
stages:
  near: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -3 N for 10 ms, within: 4 s}
  circle:
    axes:
      z: {force: "-10 N - 4 N*sin(2*pi*t/(0.3 s))"}
      x: {velocity: "40 mm/s*sin(2*pi*t/(1.0 s))"}
      y: {velocity: "40 mm/s*cos(2*pi*t/(1.0 s))"}
    time: 2.2 s
""",
        {
            "world.dome.stiffness": _log(6, 30, "kN/m"),
            "world.dome.damping": _uniform(15, 90, "N*s/m"),
            "world.dome.friction": _uniform(0.1, 0.5),
            "world.dome.xyz": _list(
                _uniform(418, 422, "mm"), _uniform(128, 132, "mm"), _uniform(238, 242, "mm")
            ),
            "robot.sensor.bias": _WRENCH,
            "robot.sensor.filter": _log(40, 200, "Hz"),
        },
    ),
    Hidden(
        "weigh-and-press",
        """
robot: {model: ur5e, tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 250 g},
  start: {xyz: [460 mm, 0, 345 mm]},
  sensor: {at: wrist, noise: {force: 0.2 N, torque: 10 mN*m}}}
world: {block: {shape: box, xyz: [460 mm, 0, 280 mm], size: [200 mm, 200 mm, 60 mm],
  stiffness: 25 kN/m, friction: 0.2}}
stages:
  left: {frame: world,
    axes: {rx: {move: 25 deg, speed: 40 deg/s}, ry: {move: 15 deg, speed: 30 deg/s}}}
  right: {frame: world,
    axes: {rx: {move: -25 deg, speed: 40 deg/s}, ry: {move: -15 deg, speed: 30 deg/s}}}
  down:
    {frame: world, axes: {z: {velocity: -15 mm/s}}, until: force.z < -4 N for 10 ms, within: 5 s}
  push:
    frame: world
    axes:
      z: {force: "-11 N - 5 N*sin(2*pi*t/(0.35 s))"}
      x: {velocity: "25 mm/s*sin(2*pi*t/(0.9 s))"}
      y: {velocity: "25 mm/s*sin(2*pi*t/(0.6 s))"}
    time: 2 s
""",
        {
            "world.block.stiffness": _log(10, 50, "kN/m"),
            "world.block.damping": _uniform(20, 100, "N*s/m"),
            "world.block.friction": _uniform(0.1, 0.4),
            "world.block.xyz": _list("460 mm", "0", _uniform(278.5, 281.5, "mm")),
            "robot.payload.mass": _uniform(100, 600, "g"),
            "robot.payload.xyz": _list(*(_uniform(-20, 20, "mm"),) * 2, _uniform(-50, 0, "mm")),
            "robot.sensor.bias": _WRENCH,
            "robot.sensor.delay": _uniform(0.1, 4, "ms"),
        },
        "[{torque: noise 0.03 N*m}]",
    ),
    Hidden(
        "wave",
        """
robot: {model: panda, tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g},
  start: {xyz: [450 mm, 0, 450 mm]}, sensor: {noise: {force: 0.2 N, torque: 10 mN*m}}}
stages:
  wave:
    frame: world
    axes:
      x: {position: "450 mm + 70 mm*sin(2*pi*t/(1.5 s))"}
      y: {position: "80 mm*sin(2*pi*t/(1.2 s))"}
      z: {position: "450 mm + 60 mm*sin(2*pi*t/(1.7 s))"}
      rx: {velocity: "55 deg/s*cos(2*pi*t/(1.3 s))"}
      ry: {velocity: "45 deg/s*cos(2*pi*t/(1.6 s))"}
      rz: {velocity: "60 deg/s*cos(2*pi*t/(2.1 s))"}
    time: 4 s
""",
        {
            "robot.payload.mass": _uniform(100, 900, "g"),
            "robot.payload.xyz": _list(*(_uniform(-30, 30, "mm"),) * 3),
            "robot.joint_friction": _uniform(0.02, 0.4, "N*m"),
            "robot.joint_damping": _uniform(0.1, 0.6, "N*m*s/rad"),
            "robot.sensor.bias": _WRENCH,
        },
        "[{torque: noise 0.05 N*m}]",
    ),
    Hidden(
        "admit",
        """
robot: {model: ur5e, command: velocity,
  tool: {shape: sphere, radius: 15 mm, length: 120 mm, mass: 300 g},
  start: {xyz: [450 mm, 100 mm, 325 mm]}, sensor: {noise: {force: 0.3 N, torque: 15 mN*m}}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.2}}
frame: world
stages:
  near: {axes: {z: {velocity: -10 mm/s}}, until: force.z < -4 N for 10 ms, within: 5 s}
  press:
    axes:
      z: {force: "-15 N - 6 N*sin(2*pi*t/(0.8 s))"}
      x: {velocity: "20 mm/s*sin(2*pi*t/(1.0 s))"}
      y: {velocity: "20 mm/s*sin(2*pi*t/(0.7 s))"}
    time: 2.4 s
""",
        {
            "world.table.stiffness": _log(8, 30, "kN/m"),
            "world.table.damping": _uniform(20, 100, "N*s/m"),
            "world.table.friction": _uniform(0.1, 0.4),
            "world.table.xyz": _list("0", "0", _uniform(298.5, 301.5, "mm")),
            "world.table.rpy": _list(_uniform(-1.5, 1.5, "deg"), _uniform(-1.5, 1.5, "deg"), "0"),
            "robot.sensor.bias": _WRENCH,
            "robot.sensor.filter": _log(40, 150, "Hz"),
        },
    ),
)

TASKS = {"develop": DEVELOP, "judge": JUDGE}


@dataclass(frozen=True)
class Row:
    """One value of one world.

    Attributes:
        task, world: of it.
        name: of the value; path: without the component.
        true, value, low, high: [SI].
        seconds: of the processor, of the whole identification.
        span: of the log [s].
    """

    task: str
    world: int
    path: str
    name: str
    true: float
    value: float
    low: float
    high: float
    seconds: float
    span: float


def drawn(hidden: Hidden, seed: int, world: int) -> tuple[str, str]:
    """The file without and with its truth."""
    random = np.random.Generator(np.random.PCG64([seed, world]))
    head = f"taskspec: 1\nname: {hidden.name}\n"
    truth = [f"{path}: {draw(random)}" for path, draw in hidden.truth.items()]
    if hidden.faults:
        truth.append(f"faults: {hidden.faults}")
    body = head + hidden.text
    return body, body + "truth:\n" + "".join(f"  {line}\n" for line in truth)


def rows_of(which: str, name: str, seed: int, world: int) -> list[Row]:
    """What is identified of one world, beside what is true."""
    from taskspec.program.worlds import World

    hidden = next(each for each in TASKS[which] if each.name == name)
    plain, whole = drawn(hidden, seed, world)
    program = compile_unchecked(load_text(whole, f"{hidden.name}.yaml"))
    context = program.context
    run = trial(program, World(context.loaded.true_task, seed=1000 * seed + world))
    file = compile_unchecked(load_text(plain, f"{hidden.name}.yaml"))
    begun = time.process_time()
    try:
        found = identify(file, [run.history], level=LEVEL)
    except InputError:  # A run that a limit stopped at once.
        return []
    seconds = time.process_time() - begun
    span = len(run.history) * context.period
    return [
        Row(hidden.name, world, e.path, e.name, true_value(program, e), e.value, e.low, e.high,
            seconds, span)
        for e in found.estimates
    ]  # fmt: skip


def true_value(program: Program, estimate: Estimate) -> float:
    """What is true of an estimate, in its own terms."""
    context = program.context
    nominal, true = context.loaded.task, context.loaded.true_task
    if estimate.along:
        name = estimate.path.split(".")[1]
        own, really = nominal.shapes[name], true.shapes[name]
        R = from_rpy(own.rpy)
        assert estimate.index is not None
        if estimate.path.endswith(".xyz"):
            return float((R.T @ (np.array(really.xyz) - own.xyz))[estimate.index])
        return float(rpy_of(R.T @ from_rpy(really.rpy), np.zeros(3))[estimate.index])
    value = value_of(context, true, estimate.path, estimate.index)
    if estimate.path == "robot.sensor.filter" and value == 0:
        return math.inf
    return value


def counted(row: Row) -> bool:
    """Whether a value has an interval with ends that follows from noise.

    A delay is counted in ticks; what torques without noise say has only rounding in it; and an
    interval that begins at its bound cannot miss a true value that is there.
    """
    exact = row.high - row.low <= 1e-7 * max(abs(row.true), 1e-3)
    ends = math.isfinite(row.high) and math.isfinite(row.true)
    return row.name != DELAY and ends and not exact and not row.low == row.true == 0


def table(rows: Sequence[Row]) -> Iterator[Sequence[str]]:
    """One line for each value: how often its interval holds, and how far it is off on average."""
    yield "task", "value", "worlds", "interval holds", "mean error / half width", "half width"
    keys = sorted({(row.task, row.name) for row in rows if counted(row)})
    for task, name in keys:
        own = [r for r in rows if r.task == task and r.name == name and counted(r)]
        held = np.mean([r.low <= r.true <= r.high for r in own])
        half = np.array([(r.high - r.low) / 2 for r in own])
        error = np.array([r.value - r.true for r in own])
        with np.errstate(all="ignore"):
            bias = np.mean(error / half)
        yield (
            task,
            name,
            str(len(own)),
            f"{100 * held:.1f} %",
            f"{bias:+.3f}",
            f"{np.median(half):.3g}",
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Draws worlds, identifies them, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--worlds", type=int, default=60)
    parser.add_argument("--tasks", default="develop", choices=TASKS)
    parser.add_argument("--only")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    tasks = [t for t in TASKS[given.tasks] if given.only in (None, t.name)]
    kept = given.rows or ROOT / "runs" / "identify" / f"{given.tasks}-{given.seed}.jsonl"
    kept.parent.mkdir(parents=True, exist_ok=True)
    rows = (
        [Row(**json.loads(line)) for line in kept.read_text().splitlines()] if kept.exists() else []
    )
    there = {row.world for row in rows}
    with ProcessPoolExecutor(given.jobs) as pool, kept.open("a") as file:
        waiting = {
            pool.submit(
                rows_of, given.tasks, tasks[world % len(tasks)].name, given.seed, world
            ): world
            for world in range(given.worlds)
            if world not in there
        }
        for future in as_completed(waiting):
            if future.exception():
                pool.shutdown(cancel_futures=True)
            found = future.result()
            rows += found
            file.write("".join(json.dumps(asdict(row)) + "\n" for row in found))
            file.flush()
            sys.stderr.write(f"\r{len({row.world for row in rows})} of {given.worlds} worlds")
    text = page_table([row for row in rows if row.world < given.worlds], given.seed, given.worlds)
    sys.stdout.write(f"\n{text}\n")
    if given.page is not None:
        whole = given.page.read_text(encoding="utf-8")
        before, _, rest = whole.partition(BEGIN)
        _, _, after = rest.partition(END)
        given.page.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")


def page_table(rows: Sequence[Row], seed: int, drawn: int) -> str:
    """What a page has of it.

    Args:
        rows: of all values.
        seed: of the worlds.
        drawn: how many there are.
    """
    lines = [*table(rows)]
    made = [" | ".join(line) for line in (lines[0], ["---"] * len(lines[0]), *lines[1:])]
    worlds = len({row.world for row in rows})
    spans: dict[int, tuple[float, float]] = {row.world: (row.seconds, row.span) for row in rows}
    rates = sorted(10 * seconds / span for seconds, span in spans.values() if span > SHORT)
    delays = [row for row in rows if row.name == DELAY]
    right = sum(row.low <= row.true <= row.high for row in delays)
    held = [row.low <= row.true <= row.high for row in rows if counted(row)]
    return (
        f"Seed {seed}, {worlds} worlds of {drawn}; the other runs were stopped at once. "
        f"Of all {len(held)} intervals {100 * np.mean(held):.1f} % hold. The delay in ticks is "
        f"right in {right} of {len(delays)}. Processor time for a log of 10 s: "
        f"{rates[len(rates) // 2]:.1f} s in the median, {rates[-1]:.1f} s at most.\n\n"
        + "\n".join(f"| {line} |" for line in made)
    )


if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    main()
