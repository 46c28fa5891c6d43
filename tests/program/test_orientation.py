"""`orientation: rpy` and `zyz`: runs, and what is said where the angles do not exist."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from measures import rms
from taskspec.control.representation import REPRESENTATIONS
from taskspec.examination import check_task
from taskspec.program.reference.orientation import angles_of
from taskspec.spec import load_text

TASK = """
taskspec: 1
name: angles
robot: {{model: {model}, start: {start}}}
{extra}
law: {{kind: {law}, orientation: {orientation}}}
stages:
{stages}
"""
TILTED = "{xyz: [450 mm, 0, 400 mm], rpy: [150 deg, 10 deg, 20 deg]}"
DOWN = "{xyz: [450 mm, 0, 400 mm], rpy: [180 deg, 0, 0]}"
REST = "  go: {axes: {rz: {move: 10 deg}}}"


def task(orientation, stages=REST, start=TILTED, extra="", law="impedance", model="panda"):
    return TASK.format(
        orientation=orientation, stages=stages, start=start, extra=extra, law=law, model=model
    )


def findings(*args, **keys):
    return check_task(load_text(task(*args, **keys), "task.yaml"))


@pytest.mark.parametrize("orientation", ["so3", "rpy", "zyz"])
def test_one_word_changes_the_error_and_not_where_the_tool_goes(simulate, orientation):
    """With the model known and no contact, inverse dynamics tracks the same reference exactly in
    every form; what is left is the torque held for one period of 1 ms."""
    stages = (
        "  go: {axes: {rx: {position: 15 deg * sin(2*pi*t/(3 s))}, rz: {move: 20 deg}}, time: 3 s}"
    )
    run = simulate(task(orientation, stages))
    for axis in ("rx", "ry", "rz"):
        assert rms(run.during("go", f"error.{axis}")) < np.deg2rad(0.02)
    reference = run.during("go", "position.rz.ref")
    assert reference[-1] - reference[0] == pytest.approx(np.deg2rad(20), abs=1e-6)


@pytest.mark.parametrize("orientation", ["rpy", "zyz"])
def test_the_reference_is_carried_on_through_the_angles(simulate, orientation):
    """A stage under the other error goes on from the same orientation reference.

    A soft PD lags behind a moving reference, so the error that is carried is several degrees.
    """
    stages = (
        "  spin: {axes: {rx: {velocity: 30 deg/s}, ry: {velocity: -20 deg/s}}, time: 0.7 s,\n"
        f"         law: {{kind: pd, orientation: {orientation}, stiffness: {{angular: 20 N*m/rad}},"
        " damping: {angular: 4 N*m*s/rad}}}\n"
        "  after: {axes: {rx: {velocity: 30 deg/s}}, time: 0.2 s, law: pd}"
    )
    run = simulate(task(orientation, stages))
    error = np.array([run.during("spin", f"error.{a}")[-1] for a in ("rx", "ry", "rz")])
    assert np.linalg.norm(error) > np.deg2rad(2)
    first = int(np.argmax(run.history.window("after")))
    representation = REPRESENTATIONS[orientation]
    before, after = _tip(run, first - 1), _tip(run, first)
    wanted = _matrix(representation, angles_of(representation, before) + error)
    so3 = np.array([run[f"error.{a}"][first] for a in ("rx", "ry", "rz")])
    # Between the two rows the reference turned for one tick of 36 deg/s.
    turned = pin.exp3(so3) @ after @ wanted.T
    assert np.arccos((np.trace(turned) - 1) / 2) < np.deg2rad(1.5 * 0.036)


@pytest.mark.parametrize(
    ("orientation", "start", "stages"),
    [
        ("rpy", "{xyz: [450 mm, 0, 400 mm], rpy: [180 deg, 60 deg, 0]}",
         "  go: {axes: {ry: {velocity: 20 deg/s}}, time: 4 s}"),
        ("zyz", "{xyz: [450 mm, 0, 400 mm], rpy: [160 deg, 0, 0]}",
         "  go: {axes: {rx: {velocity: 20 deg/s}}, time: 4 s}"),
    ],
)  # fmt: skip
def test_a_run_stops_at_the_singularity_of_its_angles(simulate, orientation, start, stages):
    run = simulate(task(orientation, stages, start))
    assert run.transitions[-1].kind == "limit"
    assert run.transitions[-1].name == "representation_singularity"
    middle = abs(angles_of(REPRESENTATIONS[orientation], _tip(run, -1))[1])
    away = abs(np.pi / 2 - middle) if orientation == "rpy" else np.pi - middle
    # The reference leads the tool; it is 1 deg away, the tool by less than the lag of a tick.
    assert away == pytest.approx(np.deg2rad(1.0), abs=np.deg2rad(0.1))


def test_a_tool_that_points_down_is_singular_for_zyz_alone():
    (found,) = findings("zyz", start=DOWN)
    assert found.code == "TS229"
    assert "theta is 180 deg" in found.message
    assert "rpy" in found.hint
    assert findings("rpy", start=DOWN) == ()


def test_a_pitch_of_90_deg_is_singular_for_rpy_alone():
    start = "{xyz: [450 mm, 0, 500 mm], rpy: [0, 89.5 deg, 0]}"
    (found,) = findings("rpy", start=start)
    assert found.code == "TS229"
    assert "pitch is 89.5 deg" in found.message
    assert findings("zyz", start=start) == ()


DRUM = (
    "world: {drum: {shape: cylinder, xyz: [450 mm, 0, 100 mm], rpy: [0, 90 deg, 0], "
    "radius: 200 mm, length: 400 mm}, table: {shape: plane}}\n"
    "frames: {skin: {surface: SURFACE}}\nframe: skin"
)


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"model": "planar3", "start": "{xyz: [450 mm, 100 mm, 0]}"}, "about rz only"),
        ({"model": "planar2", "start": "{xyz: [350 mm, 100 mm, 0]}",
          "stages": "  go: {axes: {x: {move: 10 mm}}}"}, "does not turn"),
        ({"extra": DRUM.replace("SURFACE", "drum")}, "'skin' turns"),
        ({"extra": "frame: tool"}, "'tool' turns"),
        ({"law": "hybrid", "stages": "  go: {axes: {rx: {torque: 0}}, time: 1 s}"}, "torque"),
    ],
)  # fmt: skip
def test_where_angles_are_not_to_be_had(keys, reason):
    codes = {d.code: d for d in findings("rpy", **keys)}
    assert reason in codes["TS228"].message
    assert "so3" in codes["TS228"].hint


def test_a_frame_that_follows_a_plane_does_not_turn():
    assert findings("rpy", extra=DRUM.replace("SURFACE", "table")) == ()


@pytest.mark.parametrize("law", ["impedance", "pd", "hybrid", "parallel", "hybrid-multipliers"])
def test_a_press_is_the_same_press(simulate, law):
    """The translations do not know how orientation is measured."""
    stages = "  press: {axes: {z: {force: -10 N}}, time: 3 s}"
    world = "world: {table: {shape: plane, xyz: [0, 0, 399 mm], stiffness: 20 kN/m}}"
    runs = [simulate(task(o, stages, DOWN, world, law)) for o in ("so3", "rpy")]
    ends = [run["force.z"][-1] for run in runs]
    # At rest the contact force follows from translations alone, but for the drift that is left
    # after 3 s.
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)


def _tip(run, row):
    robot = run.program.context.robot
    n = robot.pin.nv
    q = np.array([run[f"joint.{i + 1}.position"][row] for i in range(n)])
    data = robot.pin.createData()
    pin.forwardKinematics(robot.pin, data, q)
    return np.array((data.oMi[robot.tip_joint] * robot.tip).rotation)


def _matrix(representation, angles):
    return np.array(ca.evalf(representation.matrix(ca.SX(angles))))
