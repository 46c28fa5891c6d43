"""The laws' functions against the chapter's equations, on random states of built-in robots.

Tolerances: double precision through matrices whose condition is below 1e5, so 1e-9 relative.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from law_cases import as_reference, command_of, gains_on

from taskspec.control import linear, resolution, state
from taskspec.control.command import Command
from taskspec.geometry.axis import PAIRS
from taskspec.laws.gains import Gain
from taskspec.program.clock import Clock
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.world import kinematics
from taskspec.program.world.frames import FrameModel
from taskspec.robot import load_robot, model_terms
from taskspec.shapes import SHAPES
from taskspec.spec.robot import Robot, Tool

RNG = np.random.default_rng(4)
TOOL = Tool(shape="sphere", radius=0.01, length=0.12, mass=0.3)
AXES = {"planar3": ("x", "y", "rz"), "ur5e": state.AXES, "panda": state.AXES}


def load(name):
    return load_robot(Robot(model=name, tool=TOOL))


class Arm:
    """A robot with its symbols, and numbers for them at a random state."""

    def __init__(self, name):
        self.robot = load(name)
        n = self.n = self.robot.pin.nv
        self.q, self.v, self.wrench = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("w", 6)
        self.terms = model_terms.symbols(self.robot, self.v)
        self.numeric = CompiledTerms(self.robot)
        self.data = self.robot.pin.createData()

    def random(self):
        q = self.robot.home + RNG.uniform(-0.4, 0.4, self.n)
        return q, RNG.normal(size=self.n), RNG.normal(size=6) * 10

    def __call__(self, expressions, values, extra=()):
        q, v, w = values
        symbols = [self.q, self.v, *self.terms.inputs, self.wrench, *(s for s, _ in extra)]
        function = ca.Function("f", symbols, list(expressions))
        self.numeric.at(q, v)
        found = function(q, v, *self.numeric.arrays, w, *(x for _, x in extra))
        found = found if isinstance(found, (tuple, list)) else (found,)
        return [np.array(x).squeeze() for x in found]


@pytest.fixture(params=["planar3", "ur5e", "panda"])
def arm(request):
    return Arm(request.param)


def test_cholesky_and_solves():
    A = RNG.normal(size=(6, 6))
    A = A @ A.T + np.eye(6)
    B = RNG.normal(size=(6, 2))
    L = linear.cholesky(ca.SX(np.triu(A)))
    np.testing.assert_allclose(ca.evalf(L), np.linalg.cholesky(A), atol=1e-12)
    np.testing.assert_allclose(
        ca.evalf(linear.solve(L, ca.SX(B))), np.linalg.solve(A, B), atol=1e-10
    )


def test_tip_kinematics_are_pinocchios(arm):
    robot = arm.robot
    for _ in range(20):
        values = q, v, _ = arm.random()
        p, R, J, drift, twist = arm(
            [arm.terms.p, arm.terms.R, arm.terms.J, arm.terms.drift, arm.terms.twist], values
        )
        pin.forwardKinematics(robot.pin, arm.data, q, v, np.zeros(arm.n))
        tip = arm.data.oMi[robot.tip_joint] * robot.tip
        np.testing.assert_allclose(p, tip.translation, atol=1e-12)
        np.testing.assert_allclose(R, tip.rotation, atol=1e-12)
        frame = robot.pin.getFrameId("tip")
        world = pin.LOCAL_WORLD_ALIGNED
        expected = pin.computeFrameJacobian(robot.pin, arm.data, q, frame, world)
        np.testing.assert_allclose(J, expected, atol=1e-12)
        np.testing.assert_allclose(twist, expected @ v, atol=1e-12)
        pin.forwardKinematics(robot.pin, arm.data, q, v, np.zeros(arm.n))
        pin.updateFramePlacements(robot.pin, arm.data)
        acceleration = pin.getFrameClassicalAcceleration(robot.pin, arm.data, frame, world)
        np.testing.assert_allclose(drift, acceleration.vector, atol=1e-10)


def test_control_point_by_finite_differences(arm):
    offset = np.array([0.02, -0.05, 0.1])
    point = kinematics.control_point(arm.terms, arm.wrench, ca.SX(offset))
    h = 1e-6
    for _ in range(5):
        q, v, w = arm.random()
        J, drift, twist, wrench = arm([point.J, point.drift, point.twist, point.wrench], (q, v, w))
        p = [arm([point.p], (q + s * h * v, v, w))[0] for s in (-1, 1)]
        np.testing.assert_allclose((p[1] - p[0]) / (2 * h), twist[:3], atol=1e-7)
        moved = [arm([point.J], (q + s * h * v, v, w))[0] for s in (-1, 1)]
        np.testing.assert_allclose((moved[1] - moved[0]) / (2 * h) @ v, drift, atol=1e-5)
        # The same force through the shifted Jacobian gives the same joint torques.
        tip_J = arm([arm.terms.J], (q, v, w))[0]
        np.testing.assert_allclose(J.T @ wrench, tip_J.T @ w, atol=1e-10)


@pytest.mark.parametrize("kind", ["cylinder", "sphere"])
def test_following_frame_by_finite_differences(kind):
    arm = Arm("panda")
    sizes = {"radius": 0.2, "length": 0.8} if kind == "cylinder" else {"radius": 0.2}
    R = np.eye(3)[:, [2, 1, 0]] * [1, 1, -1]
    surface = SHAPES[kind](np.array([0.5, 0.0, 0.1]), R, **sizes)
    frame = FrameModel("f", "following", np.eye(3), np.zeros(3), surface=surface,
                       heading=np.array([0.3, 1.0, 0.2]))  # fmt: skip
    tool = kinematics.tool_point(arm.robot, arm.terms)
    at = kinematics.frame_state(frame, arm.terms, tool, None)
    h = 1e-6
    for _ in range(10):
        q, v, w = arm.random()
        R, rate, foot_map, body = arm(
            [at.R, at.R_rate, at.foot_map, at.turning(tool.velocity)], (q, v, w)
        )
        near = [arm([at.R, at.foot], (q + s * h * v, v, w)) for s in (-1, 1)]
        np.testing.assert_allclose((near[1][0] - near[0][0]) / (2 * h), rate, atol=1e-6)
        np.testing.assert_allclose(pin.unSkew(R.T @ rate), body, atol=1e-9)
        velocity = arm([tool.velocity], (q, v, w))[0]
        foot_rate = (near[1][1] - near[0][1]) / (2 * h)
        np.testing.assert_allclose(
            (R.T @ foot_rate)[:2], foot_map @ (R.T @ velocity)[:2], atol=1e-6
        )


def test_total_rate_by_finite_differences():
    arm = Arm("panda")
    clock = Clock(ca.SX.sym("t"), ca.SX.sym("clock"))
    expression = ca.vertcat(ca.sin(3 * clock.t) * arm.terms.p[0], arm.terms.R[:, 2] * clock.clock)
    rate = clock.total_rate(expression, arm.terms)
    q, v, w = arm.random()
    h, t = 1e-6, 0.7

    def at(s, what):
        extra = [(clock.t, t + s), (clock.clock, t + s)]
        return arm([what], (q + s * v, v, w), extra)[0]

    np.testing.assert_allclose(
        (at(h, expression) - at(-h, expression)) / (2 * h), at(0, rate), atol=1e-7
    )


def task_state(arm, axes, R=None, R_rate=None):
    R = ca.SX.eye(3) if R is None else R
    return state.task_state(
        axes=axes,
        H=arm.terms.H,
        J=arm.terms.J,
        drift=arm.terms.drift,
        twist=arm.terms.twist,
        wrench=arm.wrench,
        R=R,
        R_rate=ca.SX.zeros(3, 3) if R_rate is None else R_rate,
    )


def closed_loop(arm, axes, u, values, true_wrench):
    """Acceleration on the task axes when the arm moves by Pinocchio's own dynamics."""
    q, v, _ = values
    rows = [state.AXES.index(a) for a in axes]
    J, drift = arm([arm.terms.J, arm.terms.drift], values)
    qdd = pin.aba(arm.robot.pin, arm.data, q, v, u + J.T @ true_wrench)
    return (J @ qdd + drift)[rows], qdd


def test_the_core_gives_the_wanted_acceleration_whatever_the_posture(arm):
    """(4.12)-(4.14): x'' = a*, also for n > m, where the posture stays in the null space."""
    axes = AXES[arm.robot.name]
    m = len(axes)
    task = task_state(arm, axes)
    wanted = RNG.normal(size=m)
    command = Command(acceleration=ca.SX(wanted), wrench=-task.f)
    redundant = arm.n > m
    for _ in range(10):
        values = arm.random()
        if arm.robot.name == "planar3":
            values[2][[2, 3, 4]] = 0.0
        for pull in (RNG.normal(size=arm.n), RNG.normal(size=arm.n)):
            posture = ca.SX(pull) if redundant else None
            u = arm(
                [
                    resolution.torque(
                        command, task, arm.terms.H, arm.terms.bias, arm.terms.gravity, posture
                    )
                ],
                values,
            )[0]
            got, _ = closed_loop(arm, axes, u, values, values[2])
            np.testing.assert_allclose(got, wanted, atol=1e-8)


def test_for_n_equal_m_it_is_the_chapters_form():
    """(4.14): u = H J^-1 (u_0 - J' q') + C q' + g - J^T f, written out with NumPy."""
    arm = Arm("ur5e")
    task = task_state(arm, state.AXES)
    wanted = RNG.normal(size=6)
    command = Command(acceleration=ca.SX(wanted), wrench=-task.f)
    for _ in range(10):
        values = _, _, w = arm.random()
        u, H, bias, J, drift = arm(
            [
                resolution.torque(
                    command, task, arm.terms.H, arm.terms.bias, arm.terms.gravity, None
                ),
                ca.triu2symm(ca.triu(arm.terms.H)),
                arm.terms.bias,
                arm.terms.J,
                arm.terms.drift,
            ],
            values,
        )  # fmt: skip
        expected = H @ np.linalg.solve(J, wanted - drift) + bias - J.T @ w
        np.testing.assert_allclose(u, expected, rtol=1e-9, atol=1e-8)


def reference(m, seed):
    rng = np.random.default_rng(seed)
    return [rng.normal(size=m) * s for s in (1e-2, 0.1, 0.5, 10.0, 1.0)]


@pytest.mark.parametrize(
    "law", ["impedance", "impedance-natural", "pd", "parallel", "parallel-pid"]
)
def test_laws_written_out(arm, law):
    """Closed-loop accelerations of (4.15), (4.20), (4.39); torques of (4.21), (4.50)."""
    axes = AXES[arm.robot.name]
    m = len(axes)
    rows = [state.AXES.index(a) for a in axes]
    task = task_state(arm, axes)
    e, rate, acceleration, f_d, integral = reference(m, 7)
    M, K, D = (RNG.uniform(1, 5, m) * s for s in (1, 200, 30))
    K_F, K_I = RNG.uniform(0.5, 2, m), RNG.uniform(0.5, 5, m)
    ref = as_reference(e, rate, acceleration, f_d, integral)
    gains = gains_on(
        axes, mass=M, stiffness=K, damping=D, force__proportional=K_F, force__integral=K_I
    )
    wanted = command_of(law, task, ref, gains)
    posture = ca.SX.zeros(arm.n) if arm.n > m else None
    u_symbol = resolution.torque(
        wanted, task, arm.terms.H, arm.terms.bias, arm.terms.gravity, posture
    )
    for _ in range(5):
        values = _, _, w = arm.random()
        u, twist, mobility = arm([u_symbol, arm.terms.twist, task.mobility], values)
        x_rate, f = twist[rows], w[rows]
        if arm.robot.name == "planar3":
            w[[2, 3, 4]] = 0.0
        got, _ = closed_loop(arm, axes, u, values, w)
        spring = D * (rate - x_rate) + K * e
        if law == "impedance":
            expected = acceleration + (spring + f) / M
        elif law == "impedance-natural":
            expected = acceleration + mobility @ (spring + f)
        elif law == "parallel":
            expected = acceleration + (spring - K_F * (f_d - f) - K_I * integral) / M
        else:
            # PD leaves C q' uncompensated: compare torques instead.
            J, g = arm([task.J, arm.terms.gravity], values)
            pull = K * e - D * x_rate
            if law == "parallel-pid":
                pull -= f_d + K_F * (f_d - f) + K_I * integral
            np.testing.assert_allclose(u, J.T @ pull + g, rtol=1e-9, atol=1e-8)
            continue
        np.testing.assert_allclose(got, expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(
    "law",
    ["impedance", "impedance-natural", "pd", "pd-joint", "stiffness", "parallel", "parallel-pid"],
)
def test_laws_written_out_with_matrices(arm, law):
    """The same with full M, D, K, K_F and K_I; (4.31) and (4.33) as torques, too."""
    axes = AXES[arm.robot.name]
    m = len(axes)
    rows = [state.AXES.index(a) for a in axes]
    task = task_state(arm, axes)
    e, rate, acceleration, f_d, integral = reference(m, 8)
    M, D, K = (positive_definite(m) * s for s in (1, 30, 200))
    K_F, K_I, D_q = positive_definite(m), positive_definite(m), RNG.uniform(1, 5, arm.n)
    ref = as_reference(e, rate, acceleration, f_d, integral)
    gains = matrices_on(
        axes, mass=M, damping=D, stiffness=K, force__proportional=K_F, force__integral=K_I
    )
    gains |= gains_on([f"joint.{i + 1}" for i in range(arm.n)], joint_damping=D_q)
    wanted = command_of(law, task, ref, gains, joint_velocity=arm.v)
    posture = ca.SX.zeros(arm.n) if arm.n > m and law not in ("pd-joint", "stiffness") else None
    u_symbol = resolution.torque(
        wanted, task, arm.terms.H, arm.terms.bias, arm.terms.gravity, posture
    )
    for _ in range(5):
        values = _, v, w = arm.random()
        if arm.robot.name == "planar3":
            w[[2, 3, 4]] = 0.0
        u, twist, mobility = arm([u_symbol, arm.terms.twist, task.mobility], values)
        x_rate, f = twist[rows], w[rows]
        got, _ = closed_loop(arm, axes, u, values, w)
        spring = D @ (rate - x_rate) + K @ e
        if law == "impedance":
            expected = acceleration + np.linalg.solve(M, spring + f)
        elif law == "impedance-natural":
            expected = acceleration + mobility @ (spring + f)
        elif law == "parallel":
            force = K_F @ (f_d - f) + K_I @ integral
            expected = acceleration + np.linalg.solve(M, spring - force)
        else:
            J, g = arm([task.J, arm.terms.gravity], values)
            torques = {
                "pd": J.T @ (K @ e - D @ x_rate) + g,
                "pd-joint": J.T @ K @ e - D_q * v + g,
                "stiffness": J.T @ K @ e,
                "parallel-pid": J.T @ (K @ e - D @ x_rate - f_d - K_F @ (f_d - f) - K_I @ integral)
                + g,
            }
            np.testing.assert_allclose(u, torques[law], rtol=1e-9, atol=1e-8)
            continue
        np.testing.assert_allclose(got, expected, rtol=1e-7, atol=1e-7)


def positive_definite(m):
    A = RNG.normal(size=(m, m))
    return A @ A.T / m + np.eye(m)


def matrices_on(axes, **values):
    """Gains by name (with __ for a dot) and entry, from symmetric matrices on the axes."""
    on = {axis: i for i, axis in enumerate(axes)}
    entries = {a: (i, i) for a, i in on.items()}
    entries |= {p: (on[a], on[b]) for p, (a, b) in PAIRS.items() if a in on and b in on}
    return {
        gain.replace("__", "."): {
            name: Gain(float(value[where]), "file") for name, where in entries.items()
        }
        for gain, value in values.items()
    }


def test_hybrid_axes_do_not_disturb_each_other():
    """Motion axes get their acceleration exactly; z yields as h z'' = u + f with h = Lambda_n.

    A wrong measurement of f on z changes the motion along z not at all.
    """
    arm = Arm("panda")
    task = task_state(arm, state.AXES)
    e, rate, acceleration, f_d, integral = reference(6, 9)
    acceleration[2] = 0.0
    drive = -12.3
    # The robot's force, so the opposite of the theory's f_d.
    f_d[2] = -drive
    ref = as_reference(e, rate, acceleration, f_d, integral)
    K = np.array([900.0, 900, 0, 900, 900, 900])
    D = np.array([60.0, 60, 0, 60, 60, 60])
    gains = gains_on(state.AXES, K_P=K, K_D=D)
    gains |= gains_on("z", force__proportional=0.0, force__integral=0.0, force__damping=0.0)
    wanted = command_of("hybrid", task, ref, gains, force=("z",))
    u_symbol = resolution.torque(
        wanted, task, arm.terms.H, arm.terms.bias, arm.terms.gravity, ca.SX.zeros(7)
    )
    for _ in range(10):
        values = _, _, w = arm.random()
        u, twist, mobility = arm([u_symbol, arm.terms.twist, task.mobility], values)
        got, _ = closed_loop(arm, state.AXES, u, values, w)
        expected = acceleration + D * (rate - twist) + K * e
        expected[2] = mobility[2, 2] * (drive + w[2])
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-8)
        other = w + np.array([0, 0, 5.0, 0, 0, 0])
        got_other, _ = closed_loop(arm, state.AXES, u, values, other)
        assert got_other[2] == pytest.approx(mobility[2, 2] * (drive + other[2]), rel=1e-8)


def test_a_motion_axis_of_hybrid_along_a_normal_yields_to_the_surface():
    """x'' = x''_d + K_D e' + K_P e + h^-1 (f - f_r), f_r what the last stage held there."""
    arm = Arm("panda")
    task = task_state(arm, state.AXES)
    e, rate, acceleration, released, _ = reference(6, 10)
    ref = as_reference(e, rate, acceleration, released=released)
    K, D = np.full(6, 900.0), np.full(6, 60.0)
    wanted = command_of("hybrid", task, ref, gains_on(state.AXES, K_P=K, K_D=D), normal=("z",))
    zero = ca.SX.zeros(7)
    u_symbol = resolution.torque(wanted, task, arm.terms.H, arm.terms.bias, arm.terms.gravity, zero)
    for _ in range(5):
        values = _, _, w = arm.random()
        u, twist, mobility = arm([u_symbol, arm.terms.twist, task.mobility], values)
        got, _ = closed_loop(arm, state.AXES, u, values, w)
        expected = acceleration + D * (rate - twist) + K * e
        expected[2] += mobility[2, 2] * (w[2] - released[2])
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-8)


def test_parallel_control_along_a_normal_is_impedance_control(arm):
    """(4.16) with the force that the last stage held as its f_d: K_F is 1 whatever is given."""
    axes = AXES[arm.robot.name]
    m = len(axes)
    task = task_state(arm, axes)
    e, rate, acceleration, released, _ = reference(m, 12)
    M, K, D = (RNG.uniform(1, 5, m) * s for s in (1, 200, 30))
    ref = as_reference(e, rate, acceleration, released=released)
    gains = gains_on(axes, mass=M, stiffness=K, damping=D)
    parallel = command_of("parallel", task, ref, gains, normal=axes)
    impedance = command_of("impedance", task, ref, gains)
    for _ in range(5):
        got, expected = arm([parallel.acceleration, impedance.acceleration], arm.random())
        np.testing.assert_allclose(got, expected - released / M, rtol=1e-12, atol=1e-12)


def test_laws_that_push_with_a_spring_alone(arm):
    """Torques of (4.31) and (4.33) written out."""
    axes = AXES[arm.robot.name]
    m = len(axes)
    task = task_state(arm, axes)
    e, *_ = numbers = reference(m, 11)
    ref = as_reference(*numbers)
    K, D_q = RNG.uniform(100, 500, m), RNG.uniform(1, 5, arm.n)
    joints = gains_on([f"joint.{i + 1}" for i in range(arm.n)], joint_damping=D_q)
    damped = command_of("pd-joint", task, ref, gains_on(axes, stiffness=K) | joints, arm.v)
    bare = command_of("stiffness", task, ref, gains_on(axes, stiffness=K))
    terms = arm.terms
    symbols = [
        resolution.torque(wanted, task, terms.H, terms.bias, terms.gravity, None)
        for wanted in (damped, bare)
    ]
    for _ in range(5):
        values = _, v, _ = arm.random()
        u, u_bare, J, g = arm([*symbols, task.J, terms.gravity], values)
        np.testing.assert_allclose(u, J.T @ (K * e) - D_q * v + g, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(u_bare, J.T @ (K * e), rtol=1e-9, atol=1e-8)
