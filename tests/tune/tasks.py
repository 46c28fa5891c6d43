"""Tasks that tuning is tried on."""

#: A short press whose gains reach the force too late on a soft table, and ring on a hard one.
PRESS = """\
taskspec: 1
name: press
robot:
  model: ur5e
  tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}
  start: {xyz: [500 mm, 0, 303 mm]}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}
frames: {task: {surface: table}}
frame: task
law: hybrid   # the usual one
stages:
  approach:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -2 N for 5 ms
    within: {time: 1 s, travel: 12 mm}
  press:
    axes: {z: {force: -10 N}}
    time: 0.3 s
expect:
  - last(press.force.z) within -10 N +- 0.5 N
  - max(norm(force)) < 13 N
vary:
  world.table.stiffness: 8..60 kN/m
  world.table.xyz: [0, 0, +- 1 mm]
"""
