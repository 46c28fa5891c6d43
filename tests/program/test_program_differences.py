"""Model terms and constraint Jacobians against central finite differences, on random states.

A central difference over a step h errs by h^2/6 of the third derivative and by 1e-16/h of rounding:
with h = 1e-5 and quantities of order one both stay below 1e-10; rates are up to 1 rad/s.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.reference.constraints import equation_rows
from taskspec.robot import load_robot, model_terms
from taskspec.spec import load_text

STATES = 1000
STEP = 1e-5
TOLERANCE = 1e-6

POSE = SimpleNamespace(xyz=(0.1, -0.2, 0.3), rpy=(0.2, 0.1, -0.3))
TOOL = SimpleNamespace(
    shape="sphere",
    radius=0.01,
    size=None,
    thickness=None,
    length=0.12,
    mass=0.3,
    com=None,
    inertia=None,
)
ROBOTS = ("planar2", "planar3", "ur5e", "panda")


class Numbers:
    """A function of joint state and time, evaluated with the model terms of a loop."""

    def __init__(self, robot, expressions):
        n = robot.pin.nv
        self.q, self.v, self.t = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("t")
        self.terms = model_terms.symbols(robot, self.v)
        out = expressions(self.terms, self.q, self.v, self.t)
        arguments = [self.q, self.v, self.t, *self.terms.inputs]
        self.function = ca.Function("f", arguments, list(out))
        self.values = CompiledTerms(robot)

    def __call__(self, q, v, t=0.0):
        self.values.at(q, v)
        found = self.function(q, v, t, *self.values.arrays)
        found = found if isinstance(found, tuple) else (found,)
        return [np.array(x) for x in found]


def along(function, q, v, t, rate):
    """d/ds of a function at (q + s v, t + s rate)."""
    after, before = (function(q + s * v, t + s * rate) for s in (STEP, -STEP))
    return (after - before) / (2 * STEP)


def rotation_rate(R_after, R_before, R):
    W = (R_after - R_before) / (2 * STEP) @ R.T
    return np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2


@pytest.mark.parametrize("name", ROBOTS)
def test_kinematics(name):
    """Twist J q' from the pose, drift J' q' from the Jacobian."""
    base = POSE if name in ("ur5e", "panda") else SimpleNamespace(xyz=(0, 0, 0), rpy=(0, 0, 0))
    robot = load_robot(
        SimpleNamespace(model=name, flange=None, base=base, tool=TOOL, balanced=False)
    )
    f = Numbers(robot, lambda k, q, v, t: (k.p, k.R, k.J, k.twist, k.drift, q, v, t))
    rng, n, worst = np.random.default_rng(1), robot.pin.nv, 0.0
    for _ in range(STATES // len(ROBOTS)):
        q, v = rng.uniform(-2, 2, n), rng.uniform(-1, 1, n)
        _, R, _, twist, drift = f(q, v)[:5]
        (p1, R1, J1), (p0, R0, J0) = (f(q + s * STEP * v, v)[:3] for s in (1, -1))
        moved = np.concatenate([((p1 - p0) / (2 * STEP)).ravel(), rotation_rate(R1, R0, R)])
        bent = (J1 - J0) / (2 * STEP) @ v
        worst = max(worst, np.abs(moved - twist.ravel()).max(), np.abs(bent - drift.ravel()).max())
    assert worst < TOLERANCE


@pytest.mark.parametrize("name", ROBOTS)
def test_dynamics(name):
    """H, C q' + g and g from the kinetic and the potential energy, by Lagrange's equations."""
    robot = load_robot(
        SimpleNamespace(
            model=name, flange=None, tool=TOOL, balanced=False,
            base=SimpleNamespace(xyz=(0, 0, 0), rpy=(0, 0, 0)),
        )
    )  # fmt: skip
    terms, n = CompiledTerms(robot), robot.pin.nv

    def numbers(q, v):
        terms.at(q, v)
        return terms.inertia, terms.bias.copy(), terms.gravity.copy()

    rng, worst = np.random.default_rng(2), 0.0
    for _ in range(STATES // len(ROBOTS)):
        q, v = rng.uniform(-2, 2, n), rng.uniform(-1, 1, n)
        _, bias, g = numbers(q, v)
        # d/dt (dT/dq') at q'' = 0 is H' q'; dT/dq is by each coordinate.
        rate = (numbers(q + STEP * v, v)[0] - numbers(q - STEP * v, v)[0]) / (2 * STEP) @ v
        kinetic = [
            v @ (numbers(q + STEP * e, v)[0] - numbers(q - STEP * e, v)[0]) @ v / (4 * STEP)
            for e in np.eye(n)
        ]
        worst = max(worst, np.abs(rate - kinetic + g - bias).max())
    assert worst < TOLERANCE


EQUATIONS = """
  ball: {equation: "x^2 + y^2 + z^2 = (0.7 m)^2"}
  wave: {equation: "z = 0.3 m + 50 mm * sin(x/(100 mm) + 2*clock/(1 s)) * cos(3*y/(1 m))"}
  tilted: {equation: "x*y = 0.1 m^2 * exp(-z/(1 m))", frame: askew}
  moving: {equation: "(x - 0.2 m/s * clock)^2 + 2*y*z = (0.5 m)^2"}
  bars: {equation: "q1 + 2*q2 = 0.3 rad * sin(clock*1 Hz)"}
  cam: {equation: "sin(q1) * cos(q2) + q2^2 / (1 rad)^2 = 0.4"}
"""
FLAT = """
  ball: {equation: "x^2 + y^2 = (0.4 m)^2"}
  moving: {equation: "(x - 0.2 m/s * clock)^2 + 2*y*x = (0.5 m)^2"}
  bars: {equation: "q1 + 2*q2 = 0.3 rad * sin(clock*1 Hz)"}
"""


@pytest.mark.parametrize("name", ROBOTS)
def test_constraints(name):
    """J_phi q' + r_t and gamma of Cartesian, joint-space and moving equations, not normalised."""
    world = EQUATIONS if name in ("ur5e", "panda") else FLAT
    text = f"""taskspec: 1
robot: {{model: {name}}}
frames: {{askew: {{xyz: [100 mm, 50 mm, 0], rpy: [10 deg, 20 deg, 30 deg]}}}}
world: {world}
stages: {{wait: {{time: 1 s}}}}
"""
    context = compile_task(load_text(text, "task.yaml")).context
    robot = context.robot

    def expressions(k, q, v, t):
        rows = equation_rows(context.equations, k, q, v, t).values()
        values = [r.model.residual(q if r.model.joints else k.p, t) for r in rows]
        scales = [r.terms.scale for r in rows]
        rates = [r.closing * s for r, s in zip(rows, scales, strict=True)]
        bends = [r.gamma * s for r, s in zip(rows, scales, strict=True)]
        return [ca.vertcat(*x) for x in (values, rates, bends, scales)]

    f = Numbers(robot, expressions)
    rng, n, worst = np.random.default_rng(3), robot.pin.nv, 0.0
    for _ in range(STATES // len(ROBOTS)):
        q, v, t = rng.uniform(-2, 2, n), rng.uniform(-1, 1, n), rng.uniform(0, 3)
        _, rate, bend, scale = f(q, v, t)
        first = along(lambda q, t: f(q, v, t)[0], q, v, t, 1.0)  # noqa: B023
        second = along(lambda q, t: f(q, v, t)[1], q, v, t, 1.0)  # noqa: B023
        size = np.maximum(scale, 1.0)
        worst = max(
            worst, np.abs((first - rate) / size).max(), np.abs((second - bend) / size).max()
        )
    assert worst < TOLERANCE
