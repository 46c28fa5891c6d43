"""The model terms as expressions are Pinocchio's, on whatever arm the loader admits."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from test_robot_agreement import CASES

from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.robot.coupling import JointCoupling
from taskspec.robot.model_terms import symbols
from taskspec.robot.rigid_body import RigidBody
from term_differences import TOLERANCE, differences

STATES = 20
CHAINS = 60

SHIPPED = {
    **CASES,
    "panda, hanging": {"model": "panda", "base_rpy": (np.pi, 0.0, 0.0)},
    "panda, balanced": {"model": "panda", "balanced": True},
}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robots(name, load):
    found = differences(load(**SHIPPED[name]), 1)
    assert max(found.values()) < TOLERANCE, found


@pytest.mark.parametrize("seed", range(CHAINS))
def test_random_chains(seed):
    pin.seed(seed)
    found = differences(chain(np.random.default_rng(seed)), seed, 5)
    assert max(found.values()) < TOLERANCE, found


def chain(rng):
    """An arm of 3 to 9 hinges and slides with all that makes frames special."""
    model = pin.Model()
    model.gravity = pin.Motion(_gravity(rng), np.zeros(3))
    joint, n = 0, int(rng.integers(3, 10))
    for i in range(n):
        kind = pin.JointModelPrismaticUnaligned if rng.random() < 0.3 else None
        kind = kind or pin.JointModelRevoluteUnaligned
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        if rng.random() < 0.4:
            axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        joint = model.addJoint(joint, kind(axis), pin.SE3(_turn(rng), _shift(rng)), f"j{i}")
        for _ in range(rng.integers(3)):
            model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    model.armature = rng.uniform(0, 0.2, n)
    tip = pin.SE3(_turn(rng), _shift(rng))
    return Arm(pin=model, tip_joint=joint, tip=tip, coupling=_coupling(rng, n))


class Arm(SimpleNamespace):
    """The part of a robot that its equations follow from; as a robot, the same only as itself."""

    __hash__ = object.__hash__

    @property
    def n(self):
        return self.coupling.n


def _coupling(rng, k):
    """None, or one of some joints that follow one or two of the others, or stand still."""
    follow = sorted(rng.permutation(k)[: rng.integers(k - 1)].tolist())
    free = [j for j in range(k) if j not in follow]
    A, b = np.eye(k)[:, free], np.zeros(k)
    for j in follow:
        moved = rng.permutation(len(free))[: rng.integers(3)]
        A[j, moved], b[j] = rng.choice([-1.0, 1.0, 0.5, -2.3], len(moved)), rng.normal()
    return JointCoupling(tuple(f"j{i}" for i in range(k)), (True,) * k, tuple(free), A, b)


def _gravity(rng):
    return [np.zeros(3), np.array([0, 0, -9.81]), rng.normal(size=3)][rng.integers(3)]


def _turn(rng):
    """None, by quarters, by angles near to none, or any."""
    kind = rng.integers(4)
    if kind == 0:
        return np.eye(3)
    axis = np.eye(3)[rng.integers(3)]
    if kind == 1:
        return pin.exp3(axis * rng.integers(1, 4) * np.pi / 2)
    if kind == 2:
        return pin.exp3(axis * 10.0 ** rng.uniform(-17, -1))
    return pin.SE3.Random().rotation


def _shift(rng):
    """None, along an axis, or any."""
    return [np.zeros(3), np.eye(3)[rng.integers(3)] * 0.3, rng.uniform(-1, 1, 3)][rng.integers(3)]


def test_expressions_fill_the_inputs_of_a_tick(load):
    """What a function of symbols makes of the expressions is what it makes of the arrays."""
    robot = load("panda")
    q, v = ca.SX.sym("q", 7), ca.SX.sym("v", 7)
    named = symbols(robot, v)
    outputs = [named.H @ v + named.bias, named.J.T @ named.drift, named.R @ named.p]
    tick = ca.Function("tick", [v, *named.inputs], outputs)
    fused = ca.Function("fused", [q, v], tick.call([v, *RigidBody(robot).terms(q, v).vectors()]))
    rng, terms = np.random.default_rng(2), CompiledTerms(robot)
    for _ in range(STATES):
        terms.at(rng.uniform(-3, 3, 7), rng.normal(size=7))
        apart = tick.call([terms.v, *terms.arrays])
        for a, b in zip(apart, fused.call([terms.q, terms.v]), strict=True):
            np.testing.assert_array_equal(np.array(a), np.array(b))


def test_views_of_the_vectors(load):
    robot = load("panda")
    terms = CompiledTerms(robot)
    q, v = np.linspace(-1, 1, 7), np.linspace(1, 2, 7)
    terms.at(q, v)
    data = robot.pin.createData()
    upper = np.triu(pin.crba(robot.pin, data, q))
    H = upper + np.triu(upper, 1).T
    np.testing.assert_allclose(terms.inertia, H, rtol=0, atol=1e-12)
    bias = pin.rnea(robot.pin, data, q, v, np.zeros(7))
    np.testing.assert_allclose(terms.bias, bias, rtol=0, atol=1e-12)
    p, R = terms.tip()
    pin.computeJointJacobians(robot.pin, data, q)
    tip = pin.updateFramePlacement(robot.pin, data, robot.pin.getFrameId("tip"))
    assert tip.isApprox(pin.SE3(R, p), 1e-12)
    J = pin.getFrameJacobian(
        robot.pin, data, robot.pin.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED
    )  # fmt: skip
    np.testing.assert_allclose(terms.jacobian, J, rtol=0, atol=1e-12)


def test_short_expressions(load):
    """Frames and base parameters keep them short: 1 600 are 10 % more than now, 2 100 without."""
    assert RigidBody(load("panda")).function.n_instructions() < 1600


def test_alike_arms_share_a_function(load):
    one, other = (RigidBody(load("own.urdf", flange="palm")) for _ in range(2))
    assert one == other
    assert one.function is other.function
    heavier = RigidBody(load("own.urdf", flange="palm", tool_mass=0.31))
    assert heavier != one
    assert heavier.function is not one.function


def test_what_is_no_chain():
    model = pin.Model()
    z = np.array([0.0, 0.0, 1.0])
    first = model.addJoint(0, pin.JointModelRevoluteUnaligned(z), pin.SE3.Identity(), "a")
    for name in "bc":
        model.addJoint(first, pin.JointModelRevoluteUnaligned(z), pin.SE3.Identity(), name)
    with pytest.raises(ValueError, match="no chain"):
        RigidBody(SimpleNamespace(pin=model, tip_joint=3, tip=pin.SE3.Identity()))
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    with pytest.raises(ValueError, match="'ball' is neither a hinge nor a slide"):
        RigidBody(SimpleNamespace(pin=model, tip_joint=1, tip=pin.SE3.Identity()))
