"""Tasks that run in a moment."""

from __future__ import annotations

#: Touches a wall and presses on it: 0.4 s of simulated time.
TAP = """\
taskspec: 1
name: tap
about: Touch a wall and press on it for a moment.
robot: {model: planar2, start: {xyz: [400 mm, 100 mm, 0]}}
world:
  wall:
    {shape: plane, xyz: [402 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 10 kN/m, damping: 30 N*s/m}
params: {press: 5 N}
stages:
  approach:
    axes: {x: {velocity: 20 mm/s}}
    until: force.x > 1 N
    within: {time: 0.4 s}
  hold:
    axes: {x: {force: press, ramp: 50 ms}}
    time: 0.3 s
expect:
  - last(hold.force.x) within press +- 0.5 N
  - hold.force.x within 0..7 N for 99 %
  - max(abs(hold.error.y)) < 1 mm
  - approach.visits <= 1
"""

#: Rolls over a drum in a frame that turns with it, on an arm with all six axes.
DRUM = """\
taskspec: 1
name: drum
robot: {model: panda, start: {xyz: [500 mm, 20 mm, 402 mm]}}
world:
  drum:
    shape: cylinder
    xyz: [500 mm, 0, 250 mm]
    rpy: [0, 90 deg, 0]
    radius: 150 mm
    length: 400 mm
    stiffness: 10 kN/m
frames:
  skin: {surface: drum}
  bench: {xyz: [400 mm, 50 mm, 0], rpy: [0, 0, 30 deg]}
stages:
  fixed:
    axes: {x: {velocity: 20 mm/s}, y: {velocity: 30 mm/s}}
    time: 0.15 s
  follow:
    frame: skin
    axes: {x: {velocity: 20 mm/s}, y: {velocity: -40 mm/s}, z: {force: -5 N}}
    time: 0.4 s
  carried:
    frame: tool
    axes: {z: {move: -10 mm, speed: 50 mm/s}}
"""

#: Goes along a path of joints, then moves the tip.
UNFOLD = """\
taskspec: 1
name: unfold
robot: {model: planar2, start: {joints: [20 deg, 60 deg]}}
world: {}
stages:
  unfold:
    path: {joints: [[40 deg, 40 deg]], speed: 60 deg/s}
  move:
    axes: {x: {move: 20 mm, speed: 50 mm/s}}
"""
