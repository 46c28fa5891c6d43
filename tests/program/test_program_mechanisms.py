"""Nominal mechanisms: frames, coordinates and forces against kinematics.

Central differences with h = 1e-6 leave an error of h^2/6 times a third derivative (below 1e3 here)
and rounding of 1e-16/h: below 1e-9 and 1e-10. Comparisons at 1e-6 are far above both.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from arms import MovingArm
from taskspec.control.state import task_state
from taskspec.geometry import rotation
from taskspec.geometry.axis import AXES
from taskspec.program.world import kinematics
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.mechanisms import MechanismModel

CLOSE = {"atol": 1e-6, "rtol": 0}


def mechanism(kind="hinge", handle=(0.15, 0.08, 0.03), lead=0.0, free=False):
    return MechanismModel(
        name="crank",
        kind=kind,
        rotation=rotation.from_rpy((0.4, -0.3, 0.8)),
        origin=np.array([0.5, 0.1, 0.35]),
        handle=np.array(handle, dtype=float),
        lead=lead,
        angular=kind != "slide",
        free=free,
    )


def turning_frame(model, rpy=(0.0, 0.0, 0.0), xyz=(0.0, 0.0, 0.0)):
    return FrameModel(
        "handle", "turning", rotation.from_rpy(rpy), np.array(xyz), mechanism=model, owner="crank"
    )


def pose_at(model, s):
    """Where the mechanism takes its handle, from its geometry alone."""
    turn = pin.exp3(np.array([0, 0, s if model.angular else 0.0]))
    way = model.lead * s if model.angular else s
    place = model.origin + model.rotation @ (turn @ model.handle + [0, 0, way])
    return place, model.rotation @ turn @ model.rotation.T


def number(expression):
    return np.array(ca.evalf(ca.SX(expression))).squeeze()


@pytest.mark.parametrize("handle", [(0.15, 0.08, 0.03), (0.0, 0.0, 0.05)])
def test_whole_turns_are_counted_both_ways(handle):
    """Ten turns forth and twelve back, in steps just below half a turn, where it is hardest."""
    model = mechanism("screw", handle=handle, lead=0.002)
    seen = 0.0
    for angle in [*np.arange(0, 20 * np.pi, 3.1), *np.arange(20 * np.pi, -4 * np.pi, -3.1)]:
        p, turned = pose_at(model, angle)
        seen = float(number(model.angle(ca.SX(p), ca.SX(turned), ca.SX(seen))))
        assert seen == pytest.approx(angle, abs=1e-10)
        assert number(model.travel(ca.SX(p))) == pytest.approx(0.002 * angle, abs=1e-12)


def test_a_tilted_tool_on_the_axis_tells_the_turn_about_it():
    """What is left of the tool's rotation, about a direction across z, does not count."""
    model = mechanism("screw", handle=(0.0, 0.0, 0.0), lead=0.001)
    across = model.rotation @ np.array([np.cos(0.7), np.sin(0.7), 0.0])
    _, turned = pose_at(model, 1.2)
    angle = model.angle(ca.SX(model.origin), ca.SX(pin.exp3(0.3 * across) @ turned), ca.SX(0))
    assert number(angle) == pytest.approx(1.2, abs=1e-12)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.09, -0.2, 0.5)])
@pytest.mark.parametrize("lead", [0.0, 0.02])
def test_handle_frame_and_its_coordinates_by_finite_differences(rpy, lead):
    arm, model = MovingArm("panda", 7), mechanism("screw", lead=lead)
    frame = turning_frame(model, rpy, (0.01, 0.0, -0.02))
    tool = kinematics.tool_point(arm.robot, arm.terms)
    at = kinematics.frame_state(frame, arm.terms, tool, None)
    angle = model.angle(arm.terms.p, arm.terms.R, ca.SX(0.3))
    away = model.deviation(arm.terms.p, angle, ca.SX(0.1))
    local = ca.DM(frame.rotation.T) @ (away - ca.DM(frame.origin))
    state = task_state(
        axes=AXES,
        H=arm.terms.H,
        J=arm.terms.J,
        drift=arm.terms.drift,
        twist=arm.terms.twist,
        wrench=ca.SX.zeros(6),
        R=at.R,
        R_rate=at.R_rate,
    )
    turning = at.turning(arm.terms.twist[:3])
    total = arm.clock.total_rate(angle, arm.terms)
    back = ca.DM(frame.rotation.T) @ model.velocity_map(arm.terms.p) @ ca.DM(frame.rotation)
    for _ in range(20):
        here = arm.random()
        R, R_rate, spin, J, drift, velocity, rates, angle_rate, both = arm(
            [at.R, at.R_rate, turning, state.J, state.drift, state.velocity,
             at.rate_map @ state.velocity[:3], total, back @ at.rate_map],
            here,
        )  # fmt: skip
        R_fd, J_fd, angle_fd, local_fd = arm.rate([at.R, state.J, angle, local], here)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(R @ frame.rotation.T @ [0, 0, 1], model.rotation[:, 2], **CLOSE)
        np.testing.assert_allclose(R_rate, R_fd, **CLOSE)
        np.testing.assert_allclose(pin.unSkew(R.T @ R_rate), spin, **CLOSE)
        np.testing.assert_allclose(J @ here[1], velocity, **CLOSE)
        np.testing.assert_allclose(drift, J_fd @ here[1], **CLOSE)
        np.testing.assert_allclose(rates, local_fd, **CLOSE)
        np.testing.assert_allclose(angle_rate, angle_fd, **CLOSE)
        np.testing.assert_allclose(both, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "lead", "handle"),
    [
        ("hinge", 0.0, (0.2, 0.0, 0.0)),
        ("slide", 0.0, (0.1, 0.0, 0.0)),
        ("screw", 0.003, (0.0, 0.0, 0.1)),
    ],
)
def test_effort_is_the_work_along_the_coordinate(kind, lead, handle):
    """F s' = f . v + m . w at the handle, for a handle that moves by the geometry (fixed knob)."""
    model = mechanism(kind, handle=handle, lead=lead)
    rng = np.random.default_rng(2)
    h = 1e-6
    for s in (-0.3, 0.0, 1.1):
        force, moment = rng.normal(size=3), rng.normal(size=3)
        p = pose_at(model, s)[0]
        (low, R_low), (high, R_high) = pose_at(model, s - h), pose_at(model, s + h)
        spin = pin.log3(R_high @ R_low.T) / (2 * h)
        work = force @ (high - low) / (2 * h) + moment @ spin
        effort = number(model.effort(ca.SX(p), ca.SX(force), ca.SX(moment)))
        assert effort == pytest.approx(work, abs=1e-8)


ORBIT = """
taskspec: 1
name: orbit
robot: {model: panda, start: {xyz: [620 mm, 0, 350 mm]}}
world:
  crank: {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0]}
frame: crank.handle
stages:
STAGES
"""


def orbit(stages):
    return ORBIT.replace("STAGES", stages.strip("\n"))


def test_a_tangential_velocity_draws_the_circle(simulate):
    """In free space, through more than a whole turn.

    The law is exact in continuous time. The plant's steps take the velocity at their end, T/2 of
    the acceleration a = v^2/r late, which the loop turns into T/2 K_D a / K_P = 2.7 um; the arm's
    own terms change as well. Without feed-forward of the centripetal acceleration the error would
    be a / K_P = 84 um.
    """
    run = simulate(orbit("  go: {axes: {y: {velocity: 100 mm/s}, rz: {hold: world}}, time: 9 s}"))
    assert run.outcome.status == "done"
    p = np.array([_tip(run, k)[0] for k in range(500, 9000, 250)])
    radius = np.linalg.norm(p[:, :2] - [0.5, 0.0], axis=1)
    np.testing.assert_allclose(radius, 0.12, atol=5e-6)
    np.testing.assert_allclose(p[:, 2], 0.35, atol=5e-6)
    for axis in "xyz":
        assert np.abs(run.during("go", f"error.{axis}", 0.3)).max() < 5e-6
    # 0.2 s of blending cost half of their way, and the tick at 9 s is not recorded.
    assert run["position.y"][-1] == pytest.approx(0.1 * (9.0 - 0.1 - 1e-3), abs=1e-5)


def test_a_held_rotation_turns_with_the_handle(simulate):
    run = simulate(orbit("  go: {axes: {y: {velocity: 100 mm/s}}, time: 3 s}"))
    assert run.outcome.status == "done"
    (p, R), (_, R0) = _tip(run, -1), _tip(run, 0)
    turned = pin.exp3(np.array([0, 0, np.arctan2(p[1], p[0] - 0.5)]))
    np.testing.assert_allclose(R, turned @ R0, atol=2e-4)
    assert np.abs(run.during("go", "error.rz", 0.5)).max() < 1e-4


def test_references_go_on_across_frames(simulate):
    """From the handle's frame to the world and back: the reference neither jumps nor stops.

    In a tick of 1 ms at 0.1 m/s it moves 0.1 mm, and blending adds less than that again.
    """
    run = simulate(
        orbit(
            """
  go: {axes: {y: {velocity: 100 mm/s}}, time: 1 s}
  stay: {frame: world, axes: {}, time: 0.5 s}
  back: {axes: {y: {velocity: -100 mm/s}}, time: 1 s}
"""
        )
    )
    assert run.outcome.status == "done"
    p = np.array([_tip(run, k)[0] for k in range(0, len(run.history), 1)])
    torque = np.array([run[f"joint.{i + 1}.torque"] for i in range(7)])
    for k in (1000, 1500):
        # A velocity is continuous, so the tip's second difference stays that of an acceleration
        # of 10 m/s^2 at most, and the torque changes by no more than it does elsewhere.
        assert np.abs(np.diff(p[k - 3 : k + 4], n=2, axis=0)).max() < 10 * 1e-6
        assert np.abs(torque[:, k] - torque[:, k - 1]).max() < 1.5
    assert abs(run.during("stay", "error.x")).max() < 2e-4


def _tip(run, row):
    robot = run.program.context.robot
    data = robot.pin.createData()
    q = np.array([run[f"joint.{i + 1}.position"][row] for i in range(robot.pin.nv)])
    pin.forwardKinematics(robot.pin, data, q)
    pose = data.oMi[robot.tip_joint] * robot.tip
    return pose.translation, pose.rotation


@pytest.mark.parametrize(("kind", "lead"), [("hinge", 0.0), ("screw", 0.004), ("slide", 0.0)])
def test_a_mechanism_that_has_moved_has_its_handle_there(kind, lead):
    model = mechanism(kind, lead=lead)
    place, turned = pose_at(model, 0.7)
    moved = model.moved(0.7)
    np.testing.assert_allclose(moved.grip, place, atol=1e-12)
    np.testing.assert_allclose(moved.rotation, turned @ model.rotation, atol=1e-12)
    for mine, own in zip(
        moved.open_ways(place), model.open_ways(place), strict=True
    ):  # Its axis stays where it is.
        np.testing.assert_allclose(mine, own, atol=1e-12)
