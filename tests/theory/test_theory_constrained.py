"""Section 4.3.1: an arm under constraints, along motions that really keep them."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from rigid import Arm, run_rigid

import constrained_forms
from taskspec.compiler import compile_unchecked
from taskspec.control import constrained, linear
from taskspec.spec import load_text

SECTION = "4.3.1 Constrained dynamics"

RING = """taskspec: 1
robot: {model: planar2, start: {xyz: [300 mm, 0, 0]}}
world: {rim: {equation: "x^2 + y^2 = (300 mm)^2"}}
law: hybrid-multipliers
stages:
  slide: {constraints: {rim: {force: 20 N}}, path: {arc: {center: [0, 0], turns: 0.5}, time: 1 s}}
"""
ROUND = "planar2 on a circle, 20 N outward, half a turn in 1 s"
LIFT = """taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}
world: {lift: {equation: "z = 300 mm + 20 mm * (1 - cos(2*pi*clock*1 Hz))"}}
law: {kind: hybrid-multipliers, force: {integral: 0 /s}}
stages:
  ride: {constraints: {lift: {force: -15 N, ramp: 0}}, axes: {x: {move: 60 mm}}, time: 1 s}
"""
RIDE = "panda on a plane that rises and falls 40 mm at 1 Hz, pressing with 15 N"


@lru_cache
def ran(text, time):
    program = compile_unchecked(load_text(text, "task.yaml"))
    return Arm(program), run_rigid(program, time)


def sx(array):
    return ca.SX(ca.DM(np.asarray(array, dtype=float)))


def value(expression):
    return np.array(ca.evalf(expression))


@pytest.mark.parametrize(("text", "case"), [(RING, ROUND), (LIFT, RIDE)], ids=["ring", "lift"])
def test_identities_along_a_run(prediction, text, case):
    """P and both forms of the multipliers, at twenty states of a run."""
    arm, run = ran(text, 0.8)
    worst = dict.fromkeys(("idempotent", "annihilates", "forms", "kept"), 0.0)
    for k in range(0, len(run.t), len(run.t) // 20):
        q, v, u, t = run.q[k], run.v[k], run.u[k], run.t[k]
        H, bias = arm.dynamics(q, v)
        _, J, gamma, r_t = arm.constraint(q, v, t)
        factor = linear.cholesky(sx(H))
        P = value(constrained_forms.projector(factor, sx(J)))
        first = [int(np.argmax(np.abs(J[0])))]
        reduced = constrained_forms.reduction(sx(J), sx(gamma), first)
        dynamics = constrained_forms.reduced_dynamics(reduced, sx(H), sx(bias))
        one = value(constrained.multipliers(factor, sx(bias), sx(u), sx(J), sx(gamma)))
        other = value(constrained_forms.reduced_multipliers(reduced, dynamics, sx(u), sx(J)))
        found = {
            "idempotent": np.abs(P @ P - P).max(),
            "annihilates": np.abs(P @ J.T).max(),
            "forms": np.abs(one - other).max(),
            "kept": np.abs(J @ v + r_t).max(),
        }
        worst = {name: max(worst[name], found[name]) for name in worst}
    double = "products of matrices of condition 1e3 in double precision"
    for what, equation, key in (
        ("largest entry of P² − P", "(4.79)", "idempotent"),
        ("largest entry of P J_φᵀ", "(4.79)", "annihilates"),
        ("difference of λ between its two forms [N]", "(4.77), (4.96)", "forms"),
        ("J_φ q̇ + ∂r/∂t [m/s]", "(4.73), (4.126)", "kept"),
    ):
        prediction(what, equation, case, 0.0, worst[key], atol=1e-9, because=double)


def test_no_power_through_a_scleronomic_constraint(prediction):
    """The reaction does no work on an arm that a fixed, frictionless constraint holds."""
    arm, run = ran(RING, 0.8)
    power = [
        float(run.force[k] @ (arm.constraint(run.q[k], run.v[k], run.t[k])[1] @ run.v[k]))
        for k in range(len(run.t))
    ]
    prediction(
        "greatest power of the reaction [W]", "J_φ q̇ = 0", ROUND, 0.0, np.abs(power).max(),
        atol=1e-10, because="20 N times the 1e-13 m/s to which the state is kept on the constraint",
    )  # fmt: skip


def test_power_through_a_rheonomic_constraint(prediction):
    """It is -lambda^T r_t, and over a run it is the energy that the arm has gained or given."""
    arm, run = ran(LIFT, 0.8)
    k = 200  # a fifth of a period: the plane rises at its fastest
    _, J, _, r_t = arm.constraint(run.q[k], run.v[k], run.t[k])
    prediction(
        "power of the reaction on the arm at 0.2 s [W]", "−λᵀ ∂r/∂t", RIDE,
        float(run.force[k] @ r_t), float(-run.force[k] @ (J @ run.v[k])),
        rtol=1e-9, because="one identity in double precision",
    )  # fmt: skip
    speed = 0.02 * 2 * np.pi * np.sin(2 * np.pi * 0.2)
    prediction(
        "the same from the plane's speed and the set point [W]", "−λᵀ ∂r/∂t", RIDE,
        15.0 * speed, float(-run.force[k] @ (J @ run.v[k])),
        rtol=1e-9, because="without an integral the multiplier is the set point at once",
    )  # fmt: skip


def test_an_error_of_the_rate_grows_linearly(prediction):
    """(4.78) keeps phi'' = 0 only: phi grows with the phi' that it begins with."""
    arm, _ = ran(RING, 0.8)
    q, v = arm.onto(arm.program.context.start.copy(), np.zeros(2), 0.0)
    _, J, _, _ = arm.constraint(q, v, 0.0)
    slip = 1e-3
    v = J[0] * slip / (J[0] @ J[0])
    h, time = 1e-4, 0.2
    for k in range(round(time / h)):
        _, bias = arm.dynamics(q, v)
        half = v + h / 2 * arm.acceleration(q, v, bias, k * h)
        middle = q + h / 2 * v
        a = arm.acceleration(middle, half, arm.dynamics(middle, half)[1], k * h)
        q, v = q + h * half, v + h * a
    prediction(
        "φ after 0.2 s [mm]", "(4.78)", "planar2 beside a circle, φ̇ = 1 mm/s at the start",
        1e3 * slip * time, 1e3 * arm.constraint(q, v, 0.0)[0][0],
        rtol=2e-3,
        because="φ counts here as r/|r_x|, whose second derivative is not that of r: φ̇ t / 300 mm",
    )  # fmt: skip
