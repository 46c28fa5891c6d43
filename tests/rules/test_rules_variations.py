"""Worlds under `vary` that the file itself could not state."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 340 mm]}, sensor: {filter: 60 Hz, delay: 1 ms}}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.1}
  ball: {shape: sphere, radius: 20 mm, xyz: [900 mm, 0, 0], stiffness: rigid}
  rail: {equation: x = 500 mm}
  bar: {equation: q7 = 0}
  door: {mechanism: hinge, xyz: [2 m, 0, 0], handle: [1 m, 0, 0], friction: 0.1 N*m}
law: LAW
frame: table
stages:
  go: {axes: {z: {velocity: -20 mm/s}}, until: touching, within: {time: 3 s}}
  press: {axes: {z: {force: -5 N}}, time: 1 s}
vary: {PATH: VALUE}
"""


@pytest.mark.parametrize(
    ("path", "possible", "impossible"),
    [
        ("world.table.stiffness", "+- 10 kN/m", "+- 20 kN/m"),
        ("world.table.damping", "0..10 N*s/m", "-1..10 N*s/m"),
        ("world.table.friction", "+- 0.1", "+- 0.11"),
        ("world.table.xyz", "[0, 0, +- 5 mm]", ""),
        ("world.ball.radius", "+- 19 mm", "+- 21 mm"),
        ("world.ball.stiffness", "+- 1 kN/m", "-1..1 kN/m"),
        ("world.rail.stiffness", "+- 10 kN/m", "+- 30 kN/m"),
        ("world.bar.stiffness", "+- 1 kN*m/rad", "+- 3 kN*m/rad"),
        ("world.door.friction", "+- 0.1 N*m", "+- 0.2 N*m"),
        ("world.door.inertia", "+- 0.005 kg*m^2", "+- 0.01 kg*m^2"),
        ("robot.tool.mass", "0..1 kg", "+- 1 g"),
        ("robot.sensor.filter", "+- 20 Hz", "+- 60 Hz"),
        ("robot.sensor.delay", "+- 1 ms", "+- 2 ms"),
        ("robot.sensor.noise.force", "0..1 N", "+- 1 N"),
        ("robot.sensor.bias", "[+- 1 N, 0, 0, 0, 0, 0]", ""),
        ("robot.joint_damping", "0..1 N*m*s/rad", "+- 1 N*m*s/rad"),
    ],
)
@pytest.mark.parametrize("law", ["hybrid", "impedance"])
def test_ends_are_values_that_a_file_may_have(
    path: str, possible: str, impossible: str, law: str
) -> None:
    task = TASK.replace("LAW", law).replace("PATH", path)
    assert not any(
        d.code == "TS118" for d in check_task(load_text(task.replace("VALUE", possible), "t"))
    )
    if impossible:
        found = check_task(load_text(task.replace("VALUE", impossible), "t"))
        (finding,) = (d for d in found if d.code == "TS118")
        assert path in finding.message
        # What else is wrong is told in the same pass.
        rest = {d.code for d in found} - {"TS118"}
        assert all(not code.startswith("TS50") for code in rest)
