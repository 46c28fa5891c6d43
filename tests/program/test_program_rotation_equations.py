"""Equations on the tip's rotation: gradients, drifts, and which length the unit gradient has."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import pose_spring
from taskspec.program.world import tip_pose
from taskspec.program.world.equations import equation_models
from taskspec.spec import load_text

TASK = """
taskspec: 1
robot: {{model: panda}}
frames: {{jig: {{xyz: [450 mm, 20 mm, 300 mm], rpy: [170 deg, 10 deg, 30 deg]}}}}
world: {{guide: {{equation: "{text}"{more}}}}}
stages: {{wait: {{time: 1 s}}}}
"""
STILL = np.zeros(6)
P_J = np.array([0.45, 0.02, 0.3])
#: Each with its residual, of the place x and the rotation vector w in the jig, and the axes R.
TURNS = {
    "rx = 0 deg": lambda **at: at["w"][0],
    "rz + 2 rad/m * x = 1 rad": lambda **at: at["w"][2] + 2 * at["x"][0] - 1,
    "z = 30 mm * sin(ry) + 20 mm/rad * rx": lambda **at: (
        at["x"][2] - 0.03 * np.sin(at["w"][1]) - 0.02 * at["w"][0]
    ),
    "norm(rx, ry, rz) <= 40 deg": lambda **at: np.linalg.norm(at["w"]) - np.deg2rad(40),
    "angle(tool.z, -world.z) = 10 deg": lambda **at: np.arccos(-at["R"][2, 2]) - np.deg2rad(10),
    "angle(tool.x, jig.y) >= 80 deg": lambda **at: (
        np.arccos(at["R"][:, 0] @ jig_axes()[:, 1]) - np.deg2rad(80)
    ),
}


def jig_axes() -> np.ndarray:
    rpy = np.deg2rad([170.0, 10.0, 30.0])
    return np.linalg.multi_dot([pose_spring.turned(rpy[i] * np.eye(3)[i]) for i in (2, 1, 0)])


def model(text: str, more: str = ", frame: jig"):
    return equation_models(load_text(TASK.format(text=text, more=more), "t.yaml").task)["guide"]


def terms(of):
    """Distance, normal (1, 6), drift and scale, by pose and twist."""
    x, twist = ca.SX.sym("x", 12), ca.SX.sym("twist", 6)
    found = of.terms(x, ca.SX(0), twist)
    outputs = [found.distance, found.normal, found.drift, found.scale]
    function = ca.Function("terms", [x, twist], outputs)

    def at(p, R, rate=STILL):
        return [np.array(v).ravel() for v in function(tip_pose.pose(ca.DM(p), ca.DM(R)), rate)]

    return at


def poses():
    rng = np.random.default_rng(5)
    for _ in range(4):
        w = 0.6 * rng.standard_normal(3)
        yield P_J + 0.1 * rng.standard_normal(3), jig_axes() @ pose_spring.turned(w), rng


@pytest.mark.parametrize("text", TURNS)
def test_the_gradient_is_that_along_twists(text):
    at, residual, count = terms(model(text)), TURNS[text], 0
    F = jig_axes()

    def value(p, R):
        return residual(x=F.T @ (p - P_J), w=pose_spring.vector(F.T @ R), R=R)

    for p, R, rng in poses():
        distance, normal, _, (scale,) = at(p, R)
        np.testing.assert_allclose(distance * scale, value(p, R), atol=1e-12)
        h = 1e-5
        numeric = [
            (value(p + d[:3], pose_spring.turned(d[3:]) @ R)
             - value(p - d[:3], pose_spring.turned(-d[3:]) @ R)) / (2 * h)
            for d in h * np.eye(6)
        ]  # fmt: skip
        np.testing.assert_allclose(normal * scale, numeric, atol=1e-8)
        # Along a constant twist r'' is the drift alone.
        twist, h = rng.standard_normal(6), 1e-4
        along = [
            value(p + s * twist[:3], pose_spring.turned(s * twist[3:]) @ R) for s in (-h, 0, h)
        ]
        drift = at(p, R, twist)[2] * scale
        np.testing.assert_allclose(drift, np.diff(along, 2) / h**2, atol=2e-6)
        count += 1
    assert count == 4


@pytest.mark.parametrize("text", TURNS)
def test_the_unit_is_along_the_place_where_that_is_in_it(text):
    of = model(text)
    p, R, _ = next(poses())
    _, normal, _, _ = terms(of)(p, R)
    part = normal[:3] if of.constraint.moves else normal[3:]
    assert np.linalg.norm(part) == pytest.approx(1.0, abs=1e-12)
    assert of.angular == (not of.constraint.moves)


@pytest.mark.parametrize("scale", ["7", "250", "1 N"])
def test_the_scale_of_a_mixed_equation_does_not_matter(scale):
    plain, scaled = (
        terms(model(f"{factor} * (rz + 2 rad/m * x) = {factor} * 1 rad")) for factor in ("1", scale)
    )
    for p, R, _ in poses():
        for one, other in zip(plain(p, R)[:2], scaled(p, R)[:2], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15)


def test_a_place_alone_is_as_it_was():
    of = model("x^2 + y^2 = (300 mm)^2")
    assert not of.turns
    assert of.terms(ca.SX.sym("p", 3), ca.SX(0)).normal.shape == (1, 3)
