"""The contact is what the file declares: stiffness, friction, and the shapes' gaps."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from taskspec.program.world.stiffness import normal_mass
from taskspec_runner.plant.contact import most_creep

PRESS = """
taskspec: 1
name: press
robot:
  model: panda
  tool: {tool}
  start: {{xyz: [500 mm, 0, {height} mm]}}
world:
  thing: {thing}
law: hybrid
stages:
  press:
    axes: {{z: {{force: -{force} N, ramp: 0.5 s}}}}
    time: 4 s
"""
SPHERE = "{shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}"
SURFACES = {
    "plane": ("{{shape: plane, xyz: [0, 0, 300 mm], {contact}}}", 301),
    "box": (
        "{{shape: box, xyz: [500 mm, 0, 250 mm], size: [200 mm, 200 mm, 100 mm], {contact}}}",
        301,
    ),
    "cylinder": (
        "{{shape: cylinder, xyz: [500 mm, 0, 200 mm], rpy: [90 deg, 0, 0], radius: 100 mm, "
        "length: 300 mm, {contact}}}",
        301,
    ),
    "sphere": ("{{shape: sphere, xyz: [500 mm, 0, 200 mm], radius: 100 mm, {contact}}}", 301),
}


def press(shape: str, contact: str, force: float = 20, tool: str = SPHERE) -> str:
    thing, height = SURFACES[shape]
    return PRESS.format(tool=tool, height=height, thing=thing.format(contact=contact), force=force)


@pytest.mark.parametrize("shape", list(SURFACES))
def test_declared_stiffness_is_what_a_press_measures(simulate, shape):
    run = simulate(press(shape, "stiffness: 20 kN/m"))
    depth = -run["gap"][-1]
    assert run["force.z"][-1] == pytest.approx(-20, rel=1e-3)
    # At rest the compliance is exact; what is left is the press's own settling.
    assert -run["force.z"][-1] / depth == pytest.approx(20_000, rel=1e-4)


@pytest.mark.parametrize("stiffness", ["1 kN/m", "5 kN/m", "100 kN/m", "200 kN/m"])
@pytest.mark.parametrize("friction", [0, 0.4])
def test_stiffness_over_its_range(simulate, stiffness, friction):
    contact = f"stiffness: {stiffness}, damping: 30 N*s/m, friction: {friction}"
    run = simulate(press("plane", contact))
    declared = float(stiffness.split()[0]) * 1000
    assert -run["force.z"][-1] / -run["gap"][-1] == pytest.approx(declared, rel=1e-4)


@pytest.mark.parametrize("true", ["robot.payload: 1 kg", "robot.tool.mass: 2 kg"])
def test_what_a_tool_really_weighs_leaves_the_stiffness_as_declared(simulate, true):
    text = press("plane", "stiffness: 20 kN/m") + f"truth: {{{true}}}\n"
    run = simulate(text)
    assert -run["force.z"][-1] / -run["gap"][-1] == pytest.approx(20_000, rel=1e-3)


@pytest.mark.parametrize(
    "tool",
    [
        "{shape: cylinder, radius: 20 mm, length: 100 mm, mass: 300 g}",
        "{shape: box, size: [30 mm, 40 mm, 20 mm], length: 100 mm, mass: 300 g}",
    ],
)
def test_a_flat_tool_shares_the_declared_stiffness(simulate, tool):
    run = simulate(press("plane", "stiffness: 20 kN/m", tool=tool))
    assert -run["force.z"][-1] / -run["gap"][-1] == pytest.approx(20_000, rel=1e-3)


@pytest.mark.parametrize("speed", [5, 50])
def test_sliding_friction_is_coulombs(simulate, speed):
    text = press("plane", "stiffness: 20 kN/m, friction: 0.3")
    slide = f"    axes: {{x: {{velocity: {speed} mm/s}}, z: {{force: -20 N, ramp: 0.5 s}}}}"
    text = text.replace("    axes: {z: {force: -20 N, ramp: 0.5 s}}", slide)
    run = simulate(text.replace("time: 4 s", "time: 2 s"))
    ratio = run.during("press", "force.x", 1.5) / -run.during("press", "force.z", 1.5)
    np.testing.assert_allclose(ratio, 0.3, rtol=0.01)


@pytest.mark.parametrize("damping", [10, 30])
def test_friction_creeps_below_its_limit(simulate, damping):
    """Force over slip: 100 times the damping, but at most what halves a slip in one step."""
    text = press("plane", f"stiffness: 20 kN/m, damping: {damping} N*s/m, friction: 0.9")
    slide = "    axes: {x: {velocity: 1 mm/s}, z: {force: -20 N, ramp: 0.5 s}}"
    text = text.replace("    axes: {z: {force: -20 N, ramp: 0.5 s}}", slide)
    run = simulate(text.replace("time: 4 s", "time: 2 s"))
    robot = run.program.context.robot
    expected = min(100.0 * damping, most_creep(robot, 1e-3))
    force, slip = (run.during("press", name, 1.5) for name in ("force.x", "velocity.x"))
    np.testing.assert_allclose(force / slip, expected, rtol=5e-3)


@pytest.mark.parametrize("times", [1, 4])
def test_a_force_is_seen_one_plant_step_late(simulate, times):
    """Driven into a spring at v, what is seen lacks k v T / N of the force of the present pose."""
    text = press("plane", "stiffness: 5 kN/m, damping: 0 N*s/m")
    drive = "    axes: {z: {velocity: -20 mm/s}}"
    text = text.replace("    axes: {z: {force: -20 N, ramp: 0.5 s}}", drive)
    text = text.replace("time: 4 s", f"time: 0.5 s\ncontrol: {{plant_rate: {times} kHz}}")
    run = simulate(text)
    deep = run["gap"] < -1e-3
    assert np.count_nonzero(deep) > 100
    lag = (-run["force.z.measured"] - 5e3 * -run["gap"])[deep] / (5e3 * run["velocity.z"][deep])
    # The contact's virtual mass, 0.05 kg braked at 0.022 m/s^2, makes 1.1 mN, and k v is 40 N/s.
    np.testing.assert_allclose(lag, 1e-3 / times, atol=5e-5)


def test_rigid_is_as_stiff_as_the_steps_allow(simulate):
    run = simulate(press("plane", "stiffness: rigid"))
    k = run.program.stages[0].plan.environment.stiffness
    robot, start = run.program.context.robot, run.program.context.start
    table = run.program.context.loaded.task.world["thing"]
    # Half a radian of the contact's oscillation in one step of 1 ms.
    assert 1e-3 * np.sqrt(k / normal_mass(robot, start, table)) == pytest.approx(0.5)
    assert -run["force.z"][-1] / -run["gap"][-1] == pytest.approx(k, rel=1e-3)


@pytest.mark.parametrize("shape", list(SURFACES))
def test_gap_is_mujocos_distance(simulate, shape):
    """The log's gap, from our geometry, against MuJoCo's own on the same poses."""
    from taskspec.spec import load_text
    from taskspec_runner.plant.arm import SceneArm
    from taskspec_runner.plant.scene import build_scene

    text = press(shape, "stiffness: 20 kN/m")
    run = simulate(text)
    robot = run.program.context.robot
    task = load_text(text, "t").task
    scene = build_scene(SceneArm(robot, task.robot, run.program.context.start), task)
    data = mujoco.MjData(scene.model)
    tool, thing = (scene.model.geom(name).id for name in (robot.tool_geoms[0], "world/thing"))
    for row in range(0, len(run.history), 400):
        data.qpos[:] = [run[f"joint.{i + 1}.position"][row] for i in range(7)]
        mujoco.mj_kinematics(scene.model, data)
        if shape == "plane":
            distance = data.geom_xpos[tool][2] - 0.3 - 0.01
        else:
            distance = mujoco.mj_geomDistance(scene.model, data, tool, thing, 1.0, None)
        assert run["gap"][row] == pytest.approx(distance, abs=1e-9)


@pytest.mark.parametrize(
    "contact",
    [
        "stiffness: rigid, friction: 0.2",
        "stiffness: 20 kN/m, damping: 200 N*s/m, friction: 0.2",
        "stiffness: 200 kN/m, friction: 0.6",
    ],
)
def test_friction_does_not_chatter(simulate, contact):
    """Friction settles a slip within a few steps; past one over the step it would flip for ever."""
    text = press("plane", contact)
    slide = "\n  slide: {axes: {x: {velocity: 30 mm/s}, z: {force: -20 N}}, time: 1 s}\n"
    run = simulate(text.rstrip() + slide)
    still = run.during("press", "force.x", 3.0)
    assert np.max(np.abs(np.diff(still))) < 1e-3
    assert np.std(run.during("press", "force.z", 3.0)) < 1e-3
    friction = float(contact.rsplit(" ", 1)[1])
    ratio = run.during("slide", "force.x", 0.7) / -run.during("slide", "force.z", 0.7)
    np.testing.assert_allclose(ratio, friction, rtol=0.01)
