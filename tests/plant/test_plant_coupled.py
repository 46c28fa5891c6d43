"""An arm with joints that follow others, in the plant: it moves as its controller's model does.

MuJoCo has all joints and holds those that follow by constraints; the model has the coordinates that
are left. Both are stepped alike here, semi-implicitly, under torques that shake the arm: what they
differ by is how far the constraints give way. Measured are 8e-8 rad where they bear 100 N m.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from taskspec import load
from taskspec.robot import RobotModel, load_robot, solve_start
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.spec import LoadedTask, load_text
from taskspec_runner import run
from taskspec_runner.plant.plant import Plant
from taskspec_runner.runs import Run

DATA = Path(__file__).parents[1] / "robot" / "data"
FREE = """
taskspec: 1
robot: {{model: ./{model}, start: {{joints: [{start}]}}}}
control: {{rate: 4 kHz, plant_rate: 4 kHz}}
stages: {{wait: {{time: 1 s}}}}
"""
PRESS = """
taskspec: 1
name: palletizer
robot: {model: ./palletizer.urdf, start: {xyz: [600 mm, 100 mm, 560 mm]}}
world: {bench: {shape: plane, xyz: [0, 0, 500 mm], stiffness: 30 kN/m, friction: 0.3}}
frames: {task: {surface: bench}}
frame: task
limits: {force: 60 N}
stages:
  approach:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -3 N for 10 ms
    within: {time: 5 s}
  press: {axes: {z: {force: -20 N}, y: {move: 50 mm}}, time: 2 s}
  leave: {axes: {z: {move: 40 mm}}}
expect:
  - press.force.z within -20 N +- 2 N for 70 %
  - max(abs(joint.4.velocity)) < 60 deg/s
"""
TENDON = """
<tendon><fixed name='level'><joint joint='j2' coef='1'/><joint joint='j3' coef='1'/>
<joint joint='j5' coef='1'/></fixed></tendon>
<equality><tendon tendon1='level' polycoef='1.2 0 0 0 0'/></equality></mujoco>
"""
STARTS = {
    "palletizer.urdf": "20 deg, 10 deg, 15 deg, 30 deg",
    "tendon.xml": "20 deg, 20 deg, 30 deg, 40 deg, 0 deg",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(DATA / "palletizer.urdf", tmp_path)
    text = (DATA / "six.xml").read_text()
    (tmp_path / "tendon.xml").write_text(text.replace("</mujoco>", TENDON))
    return tmp_path


def loaded(text: str, folder: Path) -> LoadedTask:
    return load_text(text, str(folder / "task.yaml"))


@pytest.mark.parametrize("model", STARTS)
def test_the_plant_moves_as_the_model(folder: Path, model: str) -> None:
    task = loaded(FREE.format(model=model, start=STARTS[model]), folder).task
    robot = load_robot(task.robot, folder)
    assert task.robot.start is not None
    start = solve_start(robot, joints=task.robot.start.joints)
    plant, terms, h = Plant(robot, task, start), PinocchioTerms(robot), 1 / 4000
    q, v = start.copy(), np.zeros(robot.n)
    terms.at(q, v)
    shaken = 4.0 * np.diag(terms.inertia) * np.random.default_rng(1).choice([-1, 1], robot.n)
    for tick in range(2000):
        terms.at(q, v)
        torque = terms.gravity + shaken * np.cos(20.0 * tick * h)
        assert (np.abs(torque) < robot.torque_limit).all()
        plant.step(torque)
        v = v + h * np.linalg.solve(terms.inertia, torque - terms.bias)
        q = q + h * v
    assert np.abs(q - start).max() > 0.01
    np.testing.assert_allclose(plant.arm.q, q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(plant.arm.v, v, rtol=0, atol=1e-6)
    joints = plant.data.qpos[: len(robot.coupling.names)]
    np.testing.assert_allclose(joints, robot.coupling.joints(plant.arm.q), rtol=0, atol=3e-7)
    assert plant.alarm() is None


def test_the_plants_acceleration_is_the_models(folder: Path) -> None:
    """Against MuJoCo's own acceleration at a moving state: its constraints give way by 1e-4."""
    task = loaded(FREE.format(model="tendon.xml", start=STARTS["tendon.xml"]), folder).task
    robot = load_robot(task.robot, folder)
    rng, terms = np.random.default_rng(2), PinocchioTerms(robot)
    plant = Plant(robot, task, robot.home)
    for _ in range(10):
        q, v = rng.uniform(-0.5, 0.5, robot.n), 0.3 * rng.normal(size=robot.n)
        terms.at(q, v)
        torque = terms.gravity + np.diag(terms.inertia) * rng.normal(size=robot.n)
        plant.arm.put(q, v)
        plant.arm.torque[:] = torque
        mujoco.mj_forward(plant.model, plant.data)
        expected = np.linalg.solve(terms.inertia, torque - terms.bias)
        found = plant.data.qacc[list(robot.coupling.free)]
        np.testing.assert_allclose(found, expected, rtol=0, atol=3e-3 * np.abs(expected).max())


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    """A press of the palletizer by each loop."""
    here = tmp_path_factory.mktemp("press")
    shutil.copy(DATA / "palletizer.urdf", here)
    (here / "task.yaml").write_text(PRESS)
    return {
        loop: run(load(here / "task.yaml"), here / loop, loop=loop)  # type: ignore[arg-type]
        for loop in ("native", "python")
    }


def test_a_palletizer_presses(press: dict[str, Run]) -> None:
    """Two joints mimic others: what is left moves along x, y, z and about z, the tool level."""
    found = press["native"]
    assert found.passed, found.reason
    robot: RobotModel = found.program.context.robot
    assert robot.axes == ("x", "y", "z", "rz")
    assert found.history.columns["joint.4.position"].size
    assert "joint.5.position" not in found.history.columns


def test_either_loop_runs_it_alike(press: dict[str, Run]) -> None:
    native, python = (press[loop].history.columns for loop in ("native", "python"))
    assert len(list(native))
    for name in native:
        np.testing.assert_array_equal(native[name], python[name], err_msg=name)


def test_the_log_is_of_the_joints_that_move_by_themselves(press: dict[str, Run]) -> None:
    """The height of the log is where its coordinates put the tip, by MuJoCo with all joints."""
    found = press["native"]
    robot: RobotModel = found.program.context.robot
    m, columns = robot.model, found.history.columns
    d = mujoco.MjData(m)
    for row in np.linspace(0, len(columns["clock"]) - 1, 7).astype(int):
        q = np.array([columns[f"joint.{i + 1}.position"][row] for i in range(4)])
        d.qpos[:] = [q[0], q[1], -q[1], q[2], -q[2], q[3]]
        mujoco.mj_kinematics(m, d)
        tip = d.xpos[m.body(robot.tip_body).id]
        np.testing.assert_allclose(tip[2] - 0.5, columns["bench.gap"][row], atol=1e-9)
