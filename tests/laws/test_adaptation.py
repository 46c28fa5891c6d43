"""Adaptation to a payload: its equations by a second implementation, and what they promise."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.geometry.axis import AXES
from taskspec.laws.adaptation import FILTER, LEVER, SCALES, Adaptation, regressor
from taskspec.program.execution.payload_estimate import KEPT
from taskspec.spec import load_text

GRAVITY = np.array([0.0, 0.0, -9.81])
PERIOD = 1e-3
LOAD = 0.3

TASK = """\
taskspec: 1
name: load
robot:
  model: ur5e
  tool: {{shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}}
  sensor: {sensor}
world: {{table: {{shape: plane, xyz: [0, 0, -300 mm], stiffness: 5 kN/m}}}}
law: {{kind: {law}, adapt: {adapt}}}
stages:
  hang: {{time: {time}}}
  sway: {{axes: {{rx: {{position: 20 deg * sin(2*pi*t/(0.4 s))}}}}, time: 100 ms}}
truth:
  robot.payload: {{mass: 300 g, xyz: [20 mm, -30 mm, 40 mm]}}
"""


def text(law="pd", adapt="payload", sensor="{at: contact}", time="300 ms"):
    return TASK.format(law=law, adapt=adapt, sensor=sensor, time=time)


def adaptation(**facts):
    usual = {
        "low": 0.0,
        "high": 1.0,
        "reach": 0.2,
        "w": np.pi,
        "dead_zone": 0.0,
        "inertia": True,
        "gravity": tuple(GRAVITY),
        "period": PERIOD,
    }
    return Adaptation(**usual | facts)


def test_the_regressor_is_the_wrench_of_a_rigid_body():
    """Y theta, against Pinocchio's force of a body whose second moments are none."""
    rng = np.random.default_rng(48)
    symbols = [ca.SX.sym("a", 3), ca.SX.sym("w", 3), ca.SX.sym("dw", 3), ca.SX.sym("R", 3, 3)]
    Y = ca.Function("Y", symbols, [regressor(*symbols)])
    for _ in range(10):
        m, c = rng.uniform(0.1, 2), rng.uniform(-0.1, 0.1, 3)
        R = pin.exp3(rng.normal(size=3))
        a, w, dw = rng.normal(size=(3, 3))
        body, motion = pin.Inertia(m, c, np.zeros((3, 3))), pin.Motion(np.zeros(3), R.T @ w)
        # Of a body whose origin rests but for its acceleration a: I a + v x* (I v), v = (0, w).
        force = body * pin.Motion(R.T @ a, R.T @ dw) + motion.cross(body * motion)
        # A point's second moments m c c^T are no base parameters here.
        lever, spin = R @ c, pin.skew(dw) + pin.skew(w) @ pin.skew(w)
        moment = R @ force.angular - m * pin.skew(lever) @ spin @ lever
        wrench = -np.concatenate([R @ force.linear, moment])
        found = np.array(Y(a, w, dw, R)) @ np.concatenate([[m], m * c])
        np.testing.assert_allclose(found, wrench, atol=1e-12)


def test_an_error_at_rest_falls_as_predicted(simulate):
    """At rest in the air, of two laws, with and without a dead zone, to 2 % of what is left."""
    for law, zone in (("pd", 0.0), ("hybrid", 0.5)):
        adapt = f"{{payload: {{bandwidth: 1 Hz, dead_zone: {zone} N}}}}"
        made = simulate(text(law, adapt, time="800 ms"))
        rows = made.history.window("hang")
        mass = made["payload.mass"][rows]
        model = adaptation(w=2 * np.pi, dead_zone=zone)
        t = np.arange(len(mass)) * PERIOD
        bound = model.bound(t, LOAD)
        # Two ticks pass before the first change: velocities of two are needed, and it counts in
        # the next.
        left = LOAD - mass
        assert np.all(left[300:] <= 1.02 * bound[298:-2])
        # Once the arm rests the rate is w: to 2 %, as what its swing has changed is behind it.
        rest = zone / 9.81
        rate = -np.polyfit(t[400:700], np.log(left[400:700] - rest), 1)[0]
        assert rate == pytest.approx(2 * np.pi, rel=0.02)


def test_time_to_an_error_is_that_of_the_bound():
    model = adaptation(dead_zone=0.1)
    t = model.time_to(0.03, 0.3)
    assert model.bound(np.array([t]), 0.3)[0] == pytest.approx(0.03, rel=0.01)
    assert model.time_to(0.005, 0.3) == np.inf
    assert model.time_to(0.4, 0.3) == 0.0


def test_the_error_never_grows_whatever_the_motion_and_disturbances_within_the_zone():
    """V of 200 random courses of A and of disturbances that stay within the dead zone."""
    rng = np.random.default_rng(4801)
    theta, y, A = ca.SX.sym("theta", 4), ca.SX.sym("y", 6), ca.SX.sym("A", 6, 4)
    fell = 0
    for _ in range(200):
        zone = rng.uniform(0, 1)
        model = adaptation(w=2 * np.pi * 10 ** rng.uniform(-1, 1), dead_zone=zone)
        step = ca.Function("step", [theta, y, A], [model.step(theta, y, A, [*range(6)])])
        reach = rng.uniform(-0.1, 0.1, 3)
        true = rng.uniform(0.0, 1.0) * np.concatenate([[1.0], reach])
        estimate = np.array(model.start)
        errors = [np.sum(((estimate - true) / SCALES) ** 2)]
        most = zone * np.array([1, 1, 1, LEVER, LEVER, LEVER])
        for _ in range(40):
            R = pin.exp3(rng.normal(size=3))
            a = -GRAVITY + rng.normal(size=3)
            Y = np.array(ca.DM(regressor(*map(ca.SX, map(ca.DM, (a, rng.normal(size=3),
                         rng.normal(size=3), R))))))  # fmt: skip
            measured = Y @ true + rng.uniform(-most, most)
            estimate = np.array(step(estimate, measured, Y)).ravel()
            errors.append(np.sum(((estimate - true) / SCALES) ** 2))
        assert np.all(np.diff(errors) <= 1e-15)
        fell += errors[-1] < errors[0]
    assert fell > 150


def test_the_torque_of_a_run_is_the_laws_with_the_payload_that_its_log_has(simulate):
    """pd: u = J^T (K e - D x') + g - m J_c^T g_0, by Pinocchio and NumPy, to 1e-10."""
    made = simulate(text(time="100 ms"))
    plan = made.program.stages[0].plan
    robot = made.program.context.robot
    data = robot.pin.createData()
    checked = 0
    for row in range(0, 100, 7):
        q, v = (np.array([made[f"joint.{i}.{w}"][row] for i in range(1, 7)])
                for w in ("position", "velocity"))  # fmt: skip
        pin.computeAllTerms(robot.pin, data, q, v)
        tip = data.oMi[robot.tip_joint] * robot.tip
        J = pin.getJointJacobian(robot.pin, data, robot.tip_joint, pin.WORLD)
        J[:3] -= pin.skew(tip.translation) @ J[3:]
        mass, centre = made["payload.mass"][row], [made[f"payload.{a}"][row] for a in "xyz"]
        lever = tip.rotation @ np.array(centre)
        weight = -mass * (J[:3] - pin.skew(lever) @ J[3:]).T @ GRAVITY
        error = np.array([made[f"error.{a}"][row] for a in AXES])
        gains = {
            name: np.array([plan.gains[name][a].value for a in plan.axes])
            for name in ("stiffness", "damping")
        }
        pull = gains["stiffness"] * error - gains["damping"] * (J @ v)
        torque = [made[f"joint.{i}.torque"][row] for i in range(1, 7)]
        np.testing.assert_allclose(torque, J.T @ pull + data.g + weight, atol=1e-10)
        checked += mass > 0
    assert checked > 10


def test_inertia_joins_under_payload_and_not_under_gravity():
    """H, C q' + g and g of the arm that carries a point, against Pinocchio's of such an arm."""
    program = compile_unchecked(load_text(text("hybrid"), "load.yaml"))
    robot = program.context.robot
    for moves in (True, False):
        machine = program.machine()
        estimate = machine.payload
        rng = np.random.default_rng(3)
        q, v = program.context.start, rng.normal(size=robot.n)
        machine.q[:], machine.v[:] = q, v
        mass, centre = 0.7, np.array([0.03, -0.02, 0.05])
        estimate.memory[:KEPT] = [mass, *(mass * centre)]
        if not moves:
            machine = compile_unchecked(load_text(text("hybrid", "gravity"), "load.yaml")).machine()
            machine.q[:], machine.v[:] = q, v
            machine.payload.memory[:KEPT] = [mass, *(mass * centre)]
        machine.update_terms()
        model = robot.pin.copy()
        bare = model.createData()
        pin.computeAllTerms(model, bare, q, v)
        placed = robot.tip.act(pin.Inertia(mass, centre, np.zeros((3, 3))))
        model.inertias[robot.tip_joint] += placed
        data = model.createData()
        pin.computeAllTerms(model, data, q, v)
        M, M_bare = (np.triu(x.M) + np.triu(x.M, 1).T for x in (data, bare))
        np.testing.assert_allclose(machine.terms.gravity, data.g, atol=1e-10)
        np.testing.assert_allclose(machine.terms.inertia, M if moves else M_bare, atol=1e-10)
        bias = data.nle if moves else bare.nle - bare.g + data.g
        np.testing.assert_allclose(machine.terms.bias, bias, atol=1e-9)


def test_a_delayed_integral_is_unstable_where_the_theory_has_it():
    """z - 1 + s z^-d: 2 sin(pi / (2 (2 d + 1))) is the boundary; with the low-pass, near it."""
    for delay in (5, 20):
        edge = 2 * np.sin(np.pi / (2 * (2 * delay + 1)))
        steps = np.linspace(0.3, 1.5, 200) * edge
        rates = -np.log1p(-steps) / PERIOD
        grows = [adaptation(w=w).growth(delay, 0.0) >= 1 for w in rates]
        first = steps[int(np.argmax(grows))]
        assert any(grows)
        assert not grows[0]
        # The low-pass at 5 times the bandwidth takes a part of what comes back.
        assert 1 <= first / edge < 1.45
    assert adaptation(w=2 * np.pi * 100).growth(0, 0.0) < 1
    assert FILTER == 5.0


#: Falls on a table that hardly gives way, with a sensor of 20 ms, and stays there.
LATE = """\
taskspec: 1
name: late
control: {{plant_rate: 10 kHz}}
robot:
  model: ur5e
  tool: {{shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}}
  start: {{xyz: [450 mm, 0, 300.2 mm]}}
  sensor: {{delay: 20 ms}}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 1000 kN/m, damping: 3 kN*s/m}}}}
law: {{kind: pd, adapt: {{payload: {{bandwidth: {bandwidth} Hz, dead_zone: 0 N}}}}}}
stages:
  press: {{axes: {{z: {{move: -20 mm}}}}, time: 1200 ms}}
truth: {{robot.payload: 300 g}}
"""


@pytest.mark.parametrize("bandwidth", [10, 16])
def test_on_a_stiff_contact_a_late_force_has_the_estimate_swing_as_predicted(simulate, bandwidth):
    """On either side of TS513: it dies away at the predicted rate, or goes from bound to bound."""
    made = simulate(LATE.format(bandwidth=bandwidth))
    mass = made["payload.mass"]
    growth = adaptation(w=2 * np.pi * bandwidth).growth(20, 0.0)
    assert (growth >= 1) == (bandwidth > 14)
    spans = [np.ptp(mass[first : first + 200]) for first in range(600, 1200, 200)]
    if growth >= 1:
        assert min(spans) > 0.3
    else:
        # The table gives way by a little: its rate is that of one which does not, to 10 %.
        rate = np.log(spans[0] / spans[-1]) / 400
        assert rate == pytest.approx(-np.log(growth), rel=0.1)
