"""Frames, control points and axes: what they mean, on runs."""

from __future__ import annotations

import numpy as np
import pytest

from measures import rms
from taskspec.program.axes import SkewedAxisError, existing_axes

PANDA = """
taskspec: 1
name: forms
robot: {{model: panda, start: {{xyz: [500 mm, 0, 400 mm]}}}}
{extra}
stages:
{stages}
"""


def panda(stages: str, extra: str = "") -> str:
    return PANDA.format(stages=stages.strip("\n"), extra=extra)


def test_axes_that_exist_on_planar_arms():
    wall = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    assert existing_axes(("x", "y"), np.eye(3)) == ("x", "y")
    assert existing_axes(("x", "y", "rz"), wall) == ("y", "z", "rx")
    tilted = np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]])
    with pytest.raises(SkewedAxisError):
        existing_axes(("x", "y", "rz"), tilted)


def test_a_fixed_frame_resolves_positions_and_motion(simulate):
    run = simulate(
        panda(
            "  go: {axes: {x: {position: 20 mm}, y: {position: 0}}, time: 2 s}",
            "frames: {jig: {xyz: [500 mm, 0, 400 mm], rpy: [0, 0, 90 deg]}}\nframe: jig",
        )
    )
    assert run["position.x"][-1] == pytest.approx(0.02, abs=1e-5)
    # The jig's x is the world's y.
    tip = _tip(run, -1)
    np.testing.assert_allclose(tip, [0.5, 0.02, 0.4], atol=1e-5)


def test_the_tools_frame_turns_with_the_tool(simulate):
    """Turning about the tool's x while moving along its z draws a circle in the world."""
    run = simulate(
        panda(
            "  rotate: {axes: {rx: {velocity: 20 deg/s}, z: {velocity: 40 mm/s}}, time: 2 s}",
            "frame: tool",
        )
    )
    p = np.array([_tip(run, k) for k in range(600, 2000, 100)])
    radius = 0.04 / np.deg2rad(20)
    # The circle through three points of the way, and the others on it.
    a, b, c = p[0], p[6], p[12]
    center = _center(a, b, c)
    np.testing.assert_allclose(np.linalg.norm(p - center, axis=1), radius, rtol=2e-3)
    assert rms(run.during("rotate", "error.z", 0.5)) < 1e-4


def test_point_origin_moves_the_control_point(simulate):
    """Turning about a point 200 mm beside the tool leaves that point where it is."""
    run = simulate(
        panda(
            "  rotate: {axes: {rz: {move: 20 deg}}}",
            "frames: {pivot: {xyz: [500 mm, 200 mm, 400 mm], point: origin}}\nframe: pivot",
        )
    )
    turned = np.deg2rad(20)
    expected = np.array([0.5, 0.2, 0.4]) + 0.2 * np.array([np.sin(turned), -np.cos(turned), 0])
    np.testing.assert_allclose(_tip(run, -1), expected, atol=2e-5)
    np.testing.assert_allclose(run["position.x"], 0.0, atol=1e-4)


def test_a_tool_centre_point_offset_is_a_frame_on_the_tool(simulate):
    """A frame on the tool with `point: origin` is another tool centre point."""
    run = simulate(
        panda(
            "  rotate: {axes: {ry: {move: 15 deg}}}",
            "frames: {tcp: {parent: tool, xyz: [0, 0, 50 mm], point: origin}}\nframe: tcp",
        )
    )
    R = _tip_rotation(run, -1)
    np.testing.assert_allclose(_tip(run, -1) + 0.05 * R[:, 2], [0.5, 0, 0.35], atol=2e-5)


def test_hold_world_keeps_the_orientation_on_a_turning_frame(simulate):
    drum = (
        "world: {drum: {shape: cylinder, xyz: [500 mm, 0, 198 mm], rpy: [0, 90 deg, 0], "
        "radius: 200 mm, length: 400 mm}}\nframes: {skin: {surface: drum}}\nframe: skin"
    )
    axes = "y: {position: 60 mm * sin(2*pi*t/(4 s))}, z: {force: -10 N}"
    held = simulate(panda(f"  go: {{axes: {{{axes}, rx: {{hold: world}}}}, time: 4 s}}", drum))
    tilt = np.pi - held.during("go", "tilt", 1.0)
    # The frame turns by 60/200 rad under a tool that does not.
    assert np.max(np.abs(np.pi - tilt)) == pytest.approx(0.3, abs=0.01)
    down = [_tip_rotation(held, k)[:, 2] for k in (1500, 2500, 3900)]
    np.testing.assert_allclose(down, [[0, 0, -1]] * 3, atol=2e-3)
    assert rms(held.during("go", "error.y", 1.0)) < 2e-4
    assert rms(held.during("go", "force.z", 1.0) + 10) < 0.2


def test_a_soft_axis_is_a_spring_in_a_hybrid_task(simulate):
    """A table 5 mm higher than a soft z axis aims at is pressed with k times what is missing."""
    run = simulate(
        panda(
            "  lean: {axes: {z: {position: 380 mm, stiffness: 800 N/m, damping: 60 N*s/m}}, "
            "time: 3 s}",
            "world: {table: {shape: plane, xyz: [0, 0, 385 mm], stiffness: 50 kN/m}}",
        )
    )
    k, k_e = 800.0, 50_000.0
    assert -run["force.z"][-1] == pytest.approx(k * k_e / (k + k_e) * 0.005, rel=1e-4)


@pytest.mark.parametrize(
    ("path", "end"),
    [
        ("{to: [540 mm, 30 mm], speed: 100 mm/s}", (0.54, 0.03)),
        ("{line: {by: [-30 mm, 40 mm]}, time: 1 s}", (0.47, 0.04)),
        ("{arc: {center: [500 mm, 50 mm], turns: 0.25}, time: 1 s}", (0.55, 0.05)),
        ("{lissajous: {amplitude: [30 mm, 20 mm], turns: [1, 2]}, time: 2 s}", (0.5, 0.0)),
    ],
)
def test_paths_end_where_they_should(simulate, path, end):
    run = simulate(panda(f"  go: {{path: {path}}}\n  stay: {{time: 0.3 s}}"))
    np.testing.assert_allclose(_tip(run, -1)[:2], end, atol=2e-5)
    assert rms(run.during("go", "error.x")) < 1e-4


def test_a_soft_axis_lets_go_of_a_held_force_smoothly(simulate):
    run = simulate(
        panda(
            "  press: {axes: {z: {force: -20 N}}, time: 2 s}\n"
            "  lean: {axes: {z: {hold: start, stiffness: 800 N/m}}, time: 1 s}",
            "world: {table: {shape: plane, xyz: [0, 0, 399 mm], stiffness: 20 kN/m}}",
        )
    )
    first = int(np.argmax(run.history.window("lean")))
    for i in range(7):
        torque = run[f"joint.{i + 1}.torque"]
        assert abs(torque[first] - torque[first - 1]) < 0.01


def test_a_path_that_only_turns(simulate):
    run = simulate(
        panda(
            "  go: {path: {line: {by: [0, 0, 0, 0, 0, 20 deg]}, time: 2 s}}\n  stay: {time: 0.3 s}"
        )
    )
    assert run.during("go", "position.rz")[-1] == pytest.approx(np.deg2rad(20), abs=1e-4)
    assert run.during("go", "t")[-1] == pytest.approx(2.0, abs=2e-3)


def test_rotations_about_several_axes_of_the_tool(simulate):
    turns = "rx: {position: 30 deg * sin(t/(1 s))}, rz: {position: 20 deg * sin(3*t/(1 s))}"
    run = simulate(panda(f"  wave: {{axes: {{{turns}}}, time: 3 s}}", "frame: tool"))
    for axis in ("rx", "ry", "rz"):
        assert rms(run.during("wave", f"error.{axis}", 0.5)) < np.deg2rad(0.02)


def test_a_frame_on_an_object_touches_that_object(simulate):
    """Although the floor is nearer where the run starts."""
    world = (
        "world:\n"
        "  floor: {shape: plane, xyz: [0, 0, 375 mm], stiffness: 50 kN/m}\n"
        "  block: {shape: box, xyz: [560 mm, 0, 390 mm], size: [80 mm, 80 mm, 40 mm], "
        "stiffness: 10 kN/m}\n"
        "frames: {on: {parent: block}}\nframe: on\nlaw: impedance"
    )
    run = simulate(
        panda(
            "  up: {axes: {z: {move: 30 mm}}}\n"
            "  over: {axes: {x: {move: 60 mm}}}\n"
            "  press: {axes: {z: {force: -10 N, ramp: 1 s}}, time: 4 s}",
            world,
        )
    )
    assert run.program.stages[2].plan.contacts.main == "block"
    assert run["force.z"][-1] == pytest.approx(-10, rel=1e-3)


@pytest.mark.parametrize(("law", "force"), [("hybrid", 1), ("parallel", 1), ("parallel", 15)])
def test_a_force_finds_a_surface_that_is_away(simulate, law, force):
    """The integral is bounded, not stopped: it neither deadlocks below the touch threshold nor
    leaves a parallel law hanging on its spring."""
    run = simulate(
        panda(
            f"  press: {{axes: {{z: {{force: -{force} N}}}}, time: 25 s}}",
            f"world: {{table: {{shape: plane, xyz: [0, 0, 350 mm]}}}}\nlaw: {law}",
        )
    )
    assert run["force.z"][-1] == pytest.approx(-force, rel=1e-3)
    assert np.min(run["force.z"]) > -3 * force - 5


def _tip(run, row):
    return _pose(run, row)[0]


def _tip_rotation(run, row):
    return _pose(run, row)[1]


def _pose(run, row):
    import pinocchio as pin

    robot = run.program.context.robot
    n = robot.pin.nv
    q = np.array([run[f"joint.{i + 1}.position"][row] for i in range(n)])
    data = robot.pin.createData()
    pin.forwardKinematics(robot.pin, data, q)
    pose = data.oMi[robot.tip_joint] * robot.tip
    return np.array(pose.translation), np.array(pose.rotation)


def _center(a, b, c):
    """Centre of the circle through three points."""
    u, v = b - a, c - a
    n = np.cross(u, v)
    offset = np.dot(v, v) * np.cross(n, u) + np.dot(u, u) * np.cross(v, n)
    return a + offset / (2 * np.dot(n, n))
