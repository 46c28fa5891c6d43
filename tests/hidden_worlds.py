"""Worlds that are hidden from a file, and their runs."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec.compiler import compile_unchecked
from taskspec.program.components import value_of
from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec.spec import load_text
from taskspec_runner.record.history import History
from taskspec_runner.trial.trial import trial

#: A press with a varying force that rubs along both axes.
PRESS = """
taskspec: 1
name: press
robot:
  model: ur5e
  tool: {{shape: sphere, radius: 12 mm, length: 120 mm, mass: 400 g}}
  start: {{xyz: [450 mm, 100 mm, 315 mm]}}
  sensor: {sensor}
world: {{bench: {{shape: {shape}, stiffness: 15 kN/m, damping: 40 N*s/m, friction: 0.2}}}}
frames: {{task: {{surface: bench}}}}
frame: task
stages:
  approach: {{axes: {{z: {{velocity: -20 mm/s}}}}, until: force.z < -3 N for 10 ms, within: 4 s}}
  press:
    axes:
      z: {{force: "-12 N - 6 N*sin(2*pi*t/(0.4 s))"}}
      x: {{velocity: "30 mm/s*sin(2*pi*t/(0.9 s))"}}
      y: {{velocity: "20 mm/s*sin(2*pi*t/(0.7 s))"}}
    time: 1.5 s
"""
PLANE = "plane, xyz: [0, 0, 300 mm]"

#: An arm that waves about in free space.
SWING = """
taskspec: 1
name: swing
robot:
  model: ur5e
  tool: {shape: sphere, radius: 12 mm, length: 120 mm, mass: 400 g}
  start: {xyz: [450 mm, 100 mm, 420 mm]}
stages:
  swing:
    frame: world
    axes:
      x: {position: "450 mm + 60 mm*sin(2*pi*t/(1.6 s))"}
      y: {position: "100 mm + 60 mm*sin(2*pi*t/(1.1 s))"}
      z: {position: "420 mm + 50 mm*sin(2*pi*t/(1.3 s))"}
      rx: {velocity: "50 deg/s*cos(2*pi*t/(1.4 s))"}
      ry: {velocity: "50 deg/s*cos(2*pi*t/(1.7 s))"}
    time: 2 s
"""


def press(sensor: str = "{}", shape: str = PLANE) -> str:
    """The press with a sensor, on a shape."""
    return PRESS.format(sensor=sensor, shape=shape)


def program(text: str) -> Program:
    """A compiled task."""
    return compile_unchecked(load_text(text, "hidden.yaml"))


def run(text: str, truth: Mapping[str, str], seed: int = 0) -> tuple[Program, History]:
    """A task in a world that differs from its file, and the ticks of its run."""
    lines = "".join(f"  {path}: {value}\n" for path, value in truth.items())
    made = program(text + (f"truth:\n{lines}" if truth else ""))
    return made, trial(made, World(made.context.loaded.true_task, seed=seed)).history


def true(made: Program, path: str, index: int | None = None) -> float:
    """A true value [SI]."""
    return value_of(made.context, made.context.loaded.true_task, path, index)
