"""An arm of one joint: a slide that presses, as a testing machine does."""

from pathlib import Path

import numpy as np
import pytest

from taskspec.spec import load_task
from taskspec_runner import run

MACHINE = """<mujoco model="press">
  <worldbody>
    <body name="crosshead" pos="0 0 0.02">
      <inertial pos="0 0 0" mass="1" diaginertia="0.001 0.001 0.001"/>
      <joint name="height" type="slide" axis="0 0 1" range="0.05 0.25"/>
      <site name="flange" quat="0 1 0 0"/>
    </body>
  </worldbody>
  <actuator><motor joint="height" ctrlrange="-200 200"/></actuator>
</mujoco>
"""
TASK = """taskspec: 1
name: press
robot:
  model: press.xml
  flange: flange
  tool: {shape: sphere, radius: 10 mm, length: 20 mm, mass: 100 g}
  start: {joints: [146 mm]}
world: {pad: {shape: plane, xyz: [0, 0, 144 mm], stiffness: 1 kN/m, damping: 50 N*s/m}}
frames: {task: {surface: pad}}
frame: task
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -1 N, within: 2 s}
  press: {axes: {z: {force: -8 N}}, time: 4 s}
expect:
  - press.force.z within -8 N +- 0.1 N for 50 %
"""


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """The file of the task."""
    (tmp_path / "press.xml").write_text(MACHINE)
    (tmp_path / "press.yaml").write_text(TASK)
    return tmp_path / "press.yaml"


def test_it_presses_the_same_in_both_loops(task: Path, tmp_path: Path) -> None:
    logs = []
    for loop in ("python", "native"):
        found = run(load_task(task), tmp_path / loop, report=False, loop=loop)
        assert found.passed
        logs.append((tmp_path / loop / "log.arrow").read_bytes())
    assert logs[0] == logs[1]


def test_columns_of_a_slide_are_lengths_and_forces(task: Path, tmp_path: Path) -> None:
    found = run(load_task(task), tmp_path / "run", report=False)
    units = {n: u for n, u in found.units.items() if n.startswith("joint.1.")}
    assert units == {"joint.1.position": "m", "joint.1.velocity": "m/s", "joint.1.torque": "N"}
    # The tip is 20 mm below the crosshead, whose zero is 20 mm above the world's.
    position = found.columns["joint.1.position"]
    assert np.allclose(found.columns["position.z"], position - 0.144, atol=1e-12)
    # At rest the drive carries the 1.1 kg, less the 8 N that the pad does.
    assert found.columns["joint.1.torque"][-1] == pytest.approx(1.1 * 9.81 - 8.0, abs=0.01)
