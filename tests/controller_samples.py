"""What a controller takes and answers in a run of a shipped task, for what is exported of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from taskspec.compiler import compile_task, compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_task, load_text
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.live_schedule import scheduled
from taskspec_runner.loop.sensing import Sensing

TASKS = Path(__file__).resolve().parents[1] / "tasks"

#: Touches a wall and presses on it, with a sensor that is tared.
TOUCH = """\
taskspec: 1
name: touch
robot:
  model: planar2
  sensor: {noise: 0.05 N, bias: [0.3 N, 0, 0, 0, 0, 0], filter: 200 Hz, delay: 2 ms}
  start: {xyz: [400 mm, 100 mm, 0]}
world:
  wall:
    {shape: plane, xyz: [402 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 10 kN/m, damping: 30 N*s/m}
stages:
  tare: {axes: {}, time: 50 ms, tare: true}
  approach:
    axes: {x: {velocity: 20 mm/s}, y: {position: 5 mm * sin(2*pi*t/(0.2 s))}}
    until: force.x > 1 N
    within: {time: 0.4 s}
  hold:
    axes: {x: {force: 5 N, ramp: 50 ms}}
    time: 0.3 s
expect:
  - last(hold.force.x) within 5 N +- 0.5 N
"""


#: The same of arms that take velocities or positions, by what they take.
SERVOS = {
    command: TOUCH.replace("touch", f"touch-{command}", 1)
    .replace("  sensor:", f"  command: {command}\n  servo: {{acceleration: 20 rad/s^2}}\n  sensor:")
    .replace("stages:", f"law: {law}\nstages:")
    for command, law in (("velocity", "admittance"), ("position", "force-velocity"))
}

#: The same with a sliding term and a disturbance observer, whose estimate goes from stage to stage.
ROBUST = TOUCH.replace("touch", "touch-robust", 1).replace(
    "stages:",
    "law: {kind: hybrid, sliding: {layer: 0.3 m/s, payload: 50 g, uncertainty: 5 %}, "
    "disturbance_observer: 10 Hz}\ntruth: {robot.payload: 50 g, robot.joint_friction: 0.02 N*m}\n"
    "stages:",
)
#: Grips a loose body, carries it, lets it go, and grips the air where it was.
GRIP = """\
taskspec: 1
name: pick
robot:
  model: planar2
  gripper: {axis: y, stroke: 50 mm, speed: 500 mm/s}
  start: {xyz: [400 mm, 100 mm, 0]}
world:
  table: {shape: plane, xyz: [0, 0, -15 mm], friction: 0.3}
  block:
    {shape: box, size: [30 mm, 30 mm, 30 mm], free: true, mass: 200 g, xyz: [400 mm, 100 mm, 0],
     friction: 0.4}
stages:
  grasp: {grip: {object: block, force: 10 N}, until: grip.force > 9 N, within: 0.5 s}
  carry: {axes: {x: {move: 10 mm}}, fail_if: grip.slip > 1 mm, time: 0.2 s}
  let_go: {release: block, time: 100 ms}
expect:
  - last(carry.grip.load) within 0.2 kg +- 1 %
"""
#: The same with params that may be set while it runs, one at a rate and one that jumps.
LIVE = (
    TOUCH.replace("touch", "touch-live", 1)
    .replace("50 ms, tare", "20 ms, tare")
    .replace("force: 5 N", "force: push")
    .replace("{position: 5 mm *", "{position: sway *")
    .replace("force.x > 1 N", "force.x > push / 5")
    .replace("within 5 N +- 0.5 N", "within 2..8.5 N")
    .replace(
        "stages:",
        "params:\n"
        "  push: {value: 5 N, live: 2..8 N, rate: 20 N/s}\n"
        "  sway: {value: 5 mm, live: 0..10 mm}\n"
        "stages:",
    )
)
#: The same on a wall that is four times as stiff as declared, which is estimated in two stages.
ESTIMATE = (
    TOUCH.replace("touch", "touch-estimate", 1)
    .replace("filter: 200 Hz", "filter: 200 Hz, rate: 500 Hz")
    .replace(
        "stages:",
        "truth: {world.wall.stiffness: 40 kN/m}\n"
        "law: {kind: parallel, estimate: {stiffness: 1..100 kN/m, dead_zone: 0.3 N}}\nstages:",
    )
    .replace(
        "expect:",
        "  on:\n    axes: {x: {force: 8 N + 2 N * sin(2*pi*t/(0.2 s))}, y: {move: 5 mm}}\n"
        "    time: 0.6 s\nexpect:",
    )
)
#: Tares with a block in its gripper, turns it, and lets it go.
HELD = """\
taskspec: 1
name: held
robot:
  model: panda
  tool: {shape: sphere, radius: 4 mm, length: 120 mm, mass: 700 g}
  gripper: {stroke: 60 mm, speed: 200 mm/s}
  sensor: {at: wrist, bias: [1 N, 0, 2 N, 0, 0, 0]}
  start: {xyz: [450 mm, 0, 330 mm]}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], friction: 0.4}
  block:
    {shape: box, size: [60 mm, 40 mm, 60 mm], xyz: [450 mm, 0, 330 mm], free: true, mass: 500 g,
     friction: 0.4}
stages:
  grasp: {grip: {object: block, force: 30 N}, until: grip.force > 29.9 N, within: 2 s}
  up: {axes: {z: {move: 20 mm, speed: 100 mm/s}}}
  zero: {tare: true, time: 60 ms}
  lean: {axes: {rx: {move: 8 deg}}}
  let_go: {release: true, time: 100 ms}
"""
#: What is set in its runs, some of it before the first tick.
MOVES = (
    *("push = 4 N @ 0 s", "sway = 3 mm @ 0 s", "sway = 7 mm @ 31 ms"),
    *("push = 8 N @ 0.2 s", "push = 3 N @ 0.25 s", "push = 3 N @ 0.26 s"),
)


@cache
def program(name: str) -> Program:
    if name == "live":
        return compile_unchecked(load_text(LIVE, "touch.yaml"))
    if name == "grip":
        return compile_unchecked(load_text(GRIP, "pick.yaml"))
    if name == "robust":
        return compile_unchecked(load_text(ROBUST, "touch.yaml"))
    if name == "estimate":
        return compile_unchecked(load_text(ESTIMATE, "touch.yaml"))
    if name == "held":
        return compile_unchecked(load_text(HELD, "held.yaml"))
    if name in SERVOS:
        return compile_unchecked(load_text(SERVOS[name], "touch.yaml"))
    return compile_task(load_task(TASKS / f"{name}.yaml"))


@cache
def recorded(name: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Samples (ticks, numbers) of a run by the machine, its torques (ticks, n), and its end.

    Of a task that grips a last column is what each jaw is to press with.
    """
    made = program(name)
    parts = assemble(made)
    machine, plant, period = parts.machine, parts.plant, made.context.period
    moves = scheduled(MOVES if name == "live" else (), made.context.loaded.task, period)
    sensing = Sensing(plant.arm, plant.views.equations, machine)
    sensing.read()
    machine.start()
    samples, torques = [], []
    while not machine.ended:
        if moves is not None:
            moves.set(machine.live, len(samples))
        if samples:
            sensing.read()
        wrench = machine.wrench if machine.sensor is None else machine.sensor.reading
        reactions = machine.reactions if machine.reactions.size else np.zeros(1)
        clock = len(samples) * period
        samples.append(np.concatenate([machine.q, machine.v, wrench, reactions, [clock]]))
        machine.tick(clock)
        jaws = machine.grip.command if machine.grip.used else np.zeros(0)
        torques.append(np.append(machine.torque, jaws))
        plant.step(machine.torque)
    return np.array(samples), np.array(torques), machine.ended
