"""Objects that move by themselves: the tool's kinematics against them, and frames that ride along.

Tolerances of finite differences as in test_program_mechanisms.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from arms import MovingArm
from taskspec.compiler import compile_task
from taskspec.program.world.moving_base import moving_bases
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError

MOTIONS = {
    "shaking": "z: 2 mm * sin(2*pi*clock*2 Hz), x: 10 mm * cos(3*clock/(1 s))",
    "turning": "rz: 40 deg * sin(clock/(1 s)), y: 30 mm/s * clock",
    "tipping": "rx: 0.3 rad/s * clock, z: 5 mm * sin(4*clock/(1 s))",
}

RIDE = """
taskspec: 1
name: ride
robot: {model: panda, start: {xyz: [500 mm, 0, 400 mm]}}
world:
  table:
    shape: box
    xyz: [480 mm, 30 mm, 250 mm]
    rpy: [0, 0, 20 deg]
    size: [1 m, 1 m, 100 mm]
    motion: {MOTION}
frame: table
stages:
STAGES
"""


def ride(motion, stages):
    return RIDE.replace("MOTION", motion).replace("STAGES", stages.strip("\n"))


def base_of(motion):
    task = load_text(ride(motion, "  wait: {axes: {}, time: 1 s}"), "task.yaml").task
    return moving_bases(task)["table"]


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())
def test_relative_kinematics_by_finite_differences(motion):
    arm, base = MovingArm("panda", 3), base_of(motion)
    now = base.at(arm.clock.clock)
    terms = now.relative(arm.terms)
    for _ in range(20):
        here = arm.random()
        v, t = here[1:]
        p, R, J, drift, twist, world_p, world_R, world_twist = arm(
            [terms.p, terms.R, terms.J, terms.drift, terms.twist,
             arm.terms.p, arm.terms.R, arm.terms.twist],
            here,
        )  # fmt: skip
        p_fd, R_fd, twist_fd = arm.rate([terms.p, terms.R, terms.twist], here)
        np.testing.assert_allclose(p_fd, twist[:3], atol=1e-6)
        np.testing.assert_allclose(pin.unSkew(R_fd @ R.T), twist[3:], atol=1e-6)
        # v is constant on the way, so the twist changes by the drift alone.
        np.testing.assert_allclose(twist_fd, drift, atol=1e-5)
        A, a = base.pose(t)
        np.testing.assert_allclose(A @ p + a, world_p, atol=1e-12)
        np.testing.assert_allclose(A @ R, world_R, atol=1e-12)
        own = base.twist(t, world_p)
        np.testing.assert_allclose(
            np.concatenate([A @ twist[:3], A @ twist[3:]]), world_twist - own, atol=1e-10
        )
        # Without the joints' part, the twist is the moving base's own, whatever the joints do.
        np.testing.assert_allclose(twist - J @ v, np.kron(np.eye(2), A.T) @ -own, atol=1e-10)


def test_total_rates_of_what_is_relative_count_the_clock():
    arm, base = MovingArm("panda", 5), base_of(MOTIONS["turning"])
    terms = base.at(arm.clock.clock).relative(arm.terms)
    expression = ca.vertcat(ca.sin(terms.p), terms.R[:, 0] * arm.clock.t)
    rate = arm.clock.total_rate(expression, terms)
    for _ in range(5):
        here = arm.random()
        np.testing.assert_allclose(arm([rate], here)[0], arm.rate([expression], here)[0], atol=1e-6)


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())
def test_a_held_pose_rides_along(simulate, motion):
    """From rest in the world the tool joins the table and then stays where it is on it."""
    run = simulate(ride(motion, "  wait: {axes: {}, time: 2 s}"))
    assert run.outcome.status == "done"
    base = run.program.context.moving_bases["table"]
    rows = range(600, 2000, 100)
    poses = []
    for k in rows:
        (p, R), (A, a) = _tip(run, k), base.pose(float(run["clock"][k]))
        poses.append((A.T @ (p - a), A.T @ R))
    for p, R in poses:
        # The plant's steps take the velocity at their end, T/2 of the acceleration late, and the
        # loop turns that into T/2 (K_D a + a') / K_P: with the 2 Hz shake's a = 0.32 m/s^2 and
        # a' = 4 m/s^3 an amplitude of 12 um, so 24 um between two places.
        np.testing.assert_allclose(p, poses[-1][0], atol=2.5e-5)
        np.testing.assert_allclose(R, poses[-1][1], atol=1e-4)


def test_references_go_on_from_the_world_to_the_table_and_back(simulate):
    run = simulate(
        ride(
            "x: 100 mm/s * clock, rz: 0.3 rad/s * clock",
            """
  off: {frame: world, axes: {}, time: 0.3 s}
  on: {axes: {x: {velocity: 20 mm/s}}, time: 1 s}
  again: {frame: world, axes: {}, time: 0.5 s}
""",
        )
    )
    assert run.outcome.status == "done"
    p = np.array([_tip(run, k)[0] for k in range(1795)])
    for k in (300, 1300):
        # Joining takes 0.2 s: at most 1.875 * 0.15 m/s / 0.2 s = 1.4 m/s^2, and a third more for
        # the loop that follows.
        assert np.abs(np.diff(p[k - 3 : k + 4], n=2, axis=0)).max() < 2e-6
    speed = np.diff(p, axis=0) / 1e-3
    base = run.program.context.moving_bases["table"]
    for k in (700, 1200):
        A, _ = base.pose(float(run["clock"][k]))
        along = A @ run.program.context.frames["table"].rotation[:, 0]
        riding = base.twist(float(run["clock"][k]), p[k])[:3]
        np.testing.assert_allclose(speed[k], riding + 0.02 * along, atol=1e-4)
    np.testing.assert_allclose(speed[1790], 0.0, atol=1e-4)


def test_velocity_is_against_what_the_frame_is_mounted_on(simulate):
    run = simulate(
        ride(
            "x: 100 mm/s * clock",
            """
  wait: {axes: {}, until: velocity.x in world > 93 mm/s for 0.5 s, within: {time: 1 s}}
""",
        )
    )
    # The world's x sees cos 20 deg of it, 94 mm/s; the loop's rest has decayed to some um/s.
    assert run.transitions[-1].kind == "until"
    assert abs(run["velocity.x"][-1]) < 1e-4
    assert run["speed"][-1] == pytest.approx(0.1, abs=1e-4)


def test_a_turning_object_cannot_hold_the_worlds_orientation():
    text = ride("rz: 0.1 rad/s * clock", "  wait: {axes: {rz: {hold: world}}, time: 1 s}")
    with pytest.raises(SpecError) as caught:
        compile_task(load_text(text, "task.yaml"))
    assert [d.code for d in caught.value.diagnostics] == ["TS232"]


def _tip(run, row):
    robot = run.program.context.robot
    data = robot.pin.createData()
    q = np.array([run[f"joint.{i + 1}.position"][row] for i in range(robot.pin.nv)])
    pin.forwardKinematics(robot.pin, data, q)
    pose = data.oMi[robot.tip_joint] * robot.tip
    return pose.translation, pose.rotation
