"""The nearest forces that contacts return, against projections worked out another way."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from random_states import States
from scipy.optimize import linprog, nnls

from taskspec.control.state import ARM_LENGTH
from taskspec.program.limits.consistency import FRICTION_SHARE, SET_POINT_SHARE, STATIC_SHARE

#: Sizes of generators have a weight of 1e-8 of their own, and the solver 1e-9 of the rows' length.
NEAR = 1e-5


def text(ways, world, *, tool="shape: sphere, radius: 10 mm", limits="", law="hybrid", robot=""):
    wanted = ", ".join(
        f"{a}: {{{'torque' if a[0] == 'r' else 'force'}: {size} * sin({rate}/(1 s) * clock)}}"
        for a, (size, rate) in ways.items()
    )
    start = robot or "start: {xyz: [450 mm, 0, 300 mm]}"
    return (
        "taskspec: 1\nname: ask\n"
        f"robot: {{model: panda, tool: {{{tool}, length: 100 mm}}, {start}}}\n"
        f"world:\n  {world}\nlaw: {{kind: {law}, solve: qp}}\n"
        + (f"limits: {{{limits}}}\n" if limits else "")
        + f"stages: {{ask: {{axes: {{{wanted}}}, time: 10 s}}}}\n"
    )


TABLE = "table: {shape: plane, xyz: [0, 0, 300 mm], friction: %s}"
WALL = "\n  wall: {shape: plane, xyz: [460 mm, 0, 0], rpy: [0, -90 deg, 0], friction: %s}"
THREE = {"x": ("25 N", 1.0), "y": ("25 N", 1.7), "z": ("40 N", 2.3)}


class Asked(States):
    """A stage whose force set points are anything, depending on the clock."""

    def ask(self) -> tuple[np.ndarray, np.ndarray]:
        """(r,) what is commanded, and what cannot be returned of it."""
        self.machine.now[:2] = 5.0, self.rng.uniform(0, 100)
        self.machine.update_terms()
        nearest = self.solver.nearest
        left = nearest.find()
        assert left is not None
        return nearest.values.copy(), left.copy()

    def told(self) -> float:
        """|what is taken from the set points| as the next tick takes it."""
        self.solver.unreachable[:] = 0.0
        self.evaluate()
        self.solver.settle()
        return float(np.linalg.norm(self.solver.unreachable))


def cone(f, normal, mu):
    """The point of the cone |t| <= mu n about a unit normal (3,) that is nearest to f (3,)."""
    n = f @ normal
    t = f - n * normal
    size = np.linalg.norm(t)
    if size <= mu * n:
        return f
    along = (n + mu * size) / (1 + mu * mu)
    if along <= 0:
        return np.zeros(3)
    return along * (normal + mu * t / size)


@pytest.mark.parametrize("mu", [0.0, 0.05, 0.3, 0.8])
def test_one_contact_returns_the_projection_on_its_round_cone(mu):
    """The pyramid has an edge in the plane of normal and request, so for one contact it is exact.

    By brute force as well: no point of a fine sampling of the round cone is nearer.
    """
    states = Asked(text(THREE, TABLE % mu))
    down = np.array([0.0, 0.0, -1.0])
    rng = np.random.default_rng(1)
    turns, sizes = rng.uniform(0, 2 * np.pi, 4000), rng.uniform(0, 80, 4000)
    slopes = FRICTION_SHARE * mu * np.sqrt(rng.uniform(0, 1, 4000))
    sampled = sizes[:, None] * np.c_[slopes * np.cos(turns), slopes * np.sin(turns), -np.ones(4000)]
    left_out = 0
    for _ in range(200):
        f, left = states.ask()
        nearest = cone(f, down, FRICTION_SHARE * mu)
        np.testing.assert_allclose(f - left, nearest, atol=NEAR)
        assert np.linalg.norm(left) <= np.linalg.norm(sampled - f, axis=1).min() + NEAR
        left_out += np.linalg.norm(left) > 1
    assert left_out > 50


def test_what_a_contact_returns_is_left_alone():
    """Inside the cone and below the cap the residual is 0, not merely small."""
    ways = {"x": ("2 N", 1.0), "y": ("2 N", 1.7), "z": ("-20 N - 0 N", 1.0)}
    states = Asked(
        text(ways, TABLE % 0.3, limits="force: 60 N").replace(
            "-20 N - 0 N * sin(1.0/(1 s) * clock)", "-20 N"
        )
    )
    for _ in range(100):
        f, left = states.ask()
        assert f[2] == -20.0
        assert np.hypot(f[0], f[1]) <= 2 * np.sqrt(2)
        np.testing.assert_array_equal(left, 0.0)
        assert states.told() == 0.0


def test_what_a_contact_does_not_return_reaches_the_next_tick():
    states = Asked(text(THREE, TABLE % 0.0))
    for _ in range(20):
        f, left = states.ask()
        expected = np.array([f[0], f[1], max(f[2], 0.0)])
        np.testing.assert_allclose(left, expected, atol=NEAR)
        assert states.told() == pytest.approx(np.linalg.norm(expected), abs=NEAR)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_cap_is_one_on_the_push_with_its_friction(mu):
    """n sqrt(1 + mu^2) <= cap: what slides adds friction that nobody asked for."""
    states = Asked(text({"z": ("90 N", 2.3)}, TABLE % mu, limits="force: 30 N"))
    most = SET_POINT_SHARE * 30 / np.hypot(1, mu)
    for _ in range(100):
        f, left = states.ask()
        assert (f - left)[0] == pytest.approx(np.clip(f[0], -most, 0), abs=NEAR)


def distance(f, normals, mu):
    """Distance of f (3,) from what contacts return whose cones have 200 edges, by NNLS."""
    edges: list[np.ndarray] = []
    turns = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    for normal in normals:
        first = np.cross(normal, [0.0, 1.0, 0.0])
        second = np.cross(normal, first)
        edges += [normal + mu * (np.cos(a) * first + np.sin(a) * second) for a in turns]
    return float(nnls(np.array(edges).T, f)[1])


def test_a_corner_without_friction_returns_what_both_normals_do():
    """Two contacts: the quadrant of their normals, exactly."""
    states = Asked(text(THREE, TABLE % 0.0 + WALL % 0.0))
    for _ in range(200):
        f, left = states.ask()
        expected = np.array([max(f[0], 0.0), 0.0, min(f[2], 0.0)])
        np.testing.assert_allclose(f - left, expected, atol=NEAR)


def test_a_corner_with_friction_is_between_round_cones_of_mu_and_of_its_worst_pyramid():
    """With two contacts an edge cannot be along both shares: at worst faces allow mu / sqrt(2)."""
    mu = 0.4
    states = Asked(text(THREE, TABLE % mu + WALL % mu))
    normals = [np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])]
    tight = 0
    for _ in range(40):
        f, left = states.ask()
        ours = np.linalg.norm(left)
        best = distance(f, normals, FRICTION_SHARE * mu)
        worst = distance(f, normals, FRICTION_SHARE * mu / np.sqrt(2))
        # Between two of 200 edges a cone is lower by 1 - cos(pi / 200) = 1.2e-4 of mu n, n < 70 N.
        assert best - 5e-3 <= ours <= worst + NEAR
        tight += ours < best + 5e-3
    assert tight > 15


def test_a_flat_tool_returns_moments_within_its_face():
    """Pushes at the points of the face are not negative: against non-negative least squares."""
    ways = {"z": ("40 N", 2.3), "rx": ("1 N*m", 1.3), "ry": ("1 N*m", 3.1)}
    states = Asked(text(ways, TABLE % 0.0, tool="shape: cylinder, radius: 20 mm"))
    robot = states.robot
    data = robot.pin.createData()
    pin.framesForwardKinematics(robot.pin, data, states.machine.q)
    tip = data.oMf[robot.pin.getFrameId("tip")]
    arms = [tip.rotation @ np.array(center) for center in robot.tool.centers]
    scale = np.array([1.0, 1 / ARM_LENGTH, 1 / ARM_LENGTH])
    E = np.array([[-1.0, *np.cross(r, [0, 0, -1.0])[:2]] for r in arms]).T
    missed = 0
    for _ in range(200):
        f, left = states.ask()
        s, distance = nnls(scale[:, None] * E, scale * f)
        assert np.linalg.norm(scale * left) == pytest.approx(distance, abs=NEAR)
        np.testing.assert_allclose(f - left, E @ s, atol=1e-3 * ARM_LENGTH)
        missed += 0.1 < distance < 0.99 * np.linalg.norm(scale * f)
    assert missed > 20


CRANK = (
    "crank: {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0], knob: free, "
    "inertia: 0.05 kg*m^2}"
)


def test_a_grip_returns_forces_of_either_sign_up_to_the_cap():
    """A limit on force is none on moments."""
    ways = {**THREE, "rx": ("2 N*m", 0.9)}
    states = Asked(text(ways, CRANK, limits="force: 10 N", robot="grasp: crank.handle"))
    most = SET_POINT_SHARE * 10
    robot, tried = states.robot, 0
    torques = STATIC_SHARE * robot.torque_limit
    gravity = pin.computeGeneralizedGravity(robot.pin, robot.pin.createData(), states.machine.q)
    for _ in range(200):
        f, left = states.ask()
        expected = np.r_[np.clip(f[:3], -most, most), f[3]]
        if np.any(abs(tip_jacobian(states)[:4].T @ expected + gravity) > torques):
            continue
        tried += 1
        np.testing.assert_allclose(f - left, expected, atol=NEAR)
    assert tried > 50


def tip_jacobian(states):
    """(6, n) at the tip, world axes."""
    robot = states.robot
    data = robot.pin.createData()
    frame = robot.pin.getFrameId("tip")
    return pin.computeFrameJacobian(
        robot.pin, data, states.machine.q, frame, pin.LOCAL_WORLD_ALIGNED
    )


def test_a_push_is_what_the_motors_carry():
    """|J' n s + g| <= nine tenths of the motors' torque: the largest s by linear programming."""
    states = Asked(text({"z": ("2000 N", 2.3)}, TABLE % 0.0))
    robot = states.robot
    data = robot.pin.createData()
    gravity = pin.computeGeneralizedGravity(robot.pin, data, states.machine.q)
    # At the centre of the sphere, above the tip.
    J = tip_jacobian(states)
    pin.framesForwardKinematics(robot.pin, data, states.machine.q)
    tip = data.oMf[robot.pin.getFrameId("tip")]
    arm = tip.rotation @ np.array(robot.tool.centers[0])
    column = (J[:3] - pin.skew(arm) @ J[3:]).T @ np.array([0.0, 0.0, -1.0])
    most = STATIC_SHARE * robot.torque_limit
    limits = np.r_[np.maximum(most - gravity, 0), np.maximum(most + gravity, 0)]
    found = linprog([-1.0], A_ub=np.r_[column, -column][:, None], b_ub=limits, bounds=[(0, None)])
    capped = 0
    for _ in range(50):
        f, left = states.ask()
        assert (f - left)[0] == pytest.approx(-min(max(-f[0], 0.0), found.x[0]), abs=1e-4)
        capped += -f[0] > found.x[0]
    assert capped > 5


def test_a_drag_is_returned_by_friction_alone():
    """With friction whatever push it takes; without, nothing of it."""
    states = Asked(text({"x": ("10 N", 1.0)}, TABLE % 0.3))
    for _ in range(20):
        f, left = states.ask()
        # z is not asked for, so a push that holds the drag costs nothing but the motors.
        np.testing.assert_allclose(left, 0.0, atol=NEAR)
    states = Asked(text({"x": ("25 N", 1.0)}, TABLE % 0.0))
    for _ in range(20):
        f, left = states.ask()
        np.testing.assert_allclose(left, f, atol=NEAR)
