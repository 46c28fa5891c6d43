"""What a controller takes and answers in a run of a shipped task, for what is exported of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from taskspec.compiler import compile_task, compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_task, load_text
from taskspec_runner.loop.assembly import assemble
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


@cache
def program(name: str) -> Program:
    if name in SERVOS:
        return compile_unchecked(load_text(SERVOS[name], "touch.yaml"))
    return compile_task(load_task(TASKS / f"{name}.yaml"))


@cache
def recorded(name: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Samples (ticks, numbers) of a run by the machine, its torques (ticks, n), and its end."""
    made = program(name)
    parts = assemble(made)
    machine, plant, period = parts.machine, parts.plant, made.context.period
    sensing = Sensing(plant.arm, plant.views.equations, machine)
    sensing.read()
    machine.start()
    samples, torques = [], []
    while not machine.ended:
        if samples:
            sensing.read()
        wrench = machine.wrench if machine.sensor is None else machine.sensor.reading
        reactions = machine.reactions if machine.reactions.size else np.zeros(1)
        clock = len(samples) * period
        samples.append(np.concatenate([machine.q, machine.v, wrench, reactions, [clock]]))
        machine.tick(clock)
        torques.append(machine.torque.copy())
        plant.step(machine.torque)
    return np.array(samples), np.array(torques), machine.ended
