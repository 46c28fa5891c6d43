"""Section 4.3.2: motion and multipliers of an arm on ideal constraints, each after its own law.

The controller is the compiled one at 1 kHz; the arm and its rigid constraints are integrated by
`rigid.py`. A constraint's multiplier is what the environment exerts along the unit normal.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest
from rigid import Arm, run_rigid
from sampled import critical

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text

SECTION = "4.3.2 Hybrid control of multipliers"
T = 1e-3

WALL = """taskspec: 1
robot: {{model: planar2, start: {{xyz: [350 mm, 200 mm, 0]}}}}
world: {{wall: {{equation: "0.8*x + 0.6*y = 400 mm"}}}}
law: {law}
stages:
  press: {{constraints: {{wall: {{force: 20 N, ramp: 0}}}}, time: 2 s}}
"""
RING = """taskspec: 1
robot: {model: planar2, start: {xyz: [300 mm, 0, 0]}}
world: {rim: {equation: "x^2 + y^2 = (300 mm)^2"}}
law: hybrid-multipliers
stages:
  slide:
    constraints: {rim: {force: 20 N}}
    path: {arc: {center: [0, 0], turns: 1}, time: 4 s}
"""


@lru_cache
def compiled(text):
    return compile_unchecked(load_text(text, "task.yaml"))


def press(law, time, disturbance=None):
    return run_rigid(compiled(WALL.format(law=law)), time, disturbance=disturbance)


def multiplier_law(proportional, integral):
    return (
        "{kind: hybrid-multipliers, force: "
        f"{{proportional: {proportional}, integral: {integral} /s}}}}"
    )


def along_normal(size, begin=0.0):
    """-J_phi^T delta from `begin` on: what a motion of the multiplier by delta would look like."""
    arm = Arm(compiled(WALL.format(law="hybrid-multipliers")))
    q, v = arm.onto(arm.program.context.start.copy(), np.zeros(2), 0.0)
    J = arm.constraint(q, v, 0.0)[1]
    # In the theory's sign the multiplier of the wall is minus what the robot applies.
    return lambda t: J[0] * size if t >= begin else np.zeros(2)


def recursion(K, K_I, delta, first):
    """e[k] = -K e[k-1] - K_I s[k] + delta[k], s[k] = s[k-1] + T e[k-1] (theory: sampling).

    Args:
        K, K_I: gains. delta: (ticks,) the disturbance. first: e before the first tick.
    """
    e, s = [first], 0.0
    for disturbance in delta:
        s += T * e[-1]
        e.append(-K * e[-1] - K_I * s + disturbance)
    return np.array(e[1:])


def test_nominally_the_multiplier_is_right_at_once(prediction):
    """e_lambda = 0 with K_lambda = K_I = 0 too: pure feed-forward."""
    run = press(multiplier_law(0, 0), 0.05)
    prediction(
        "greatest force error [N]", "(4.112)", "planar2 on a wall, K_λ = K_I = 0", 0.0,
        np.abs(run.force[:, 0] - 20.0).max(), atol=1e-9,
        because="the model is exact; double precision",
    )  # fmt: skip


@pytest.mark.parametrize(("K", "K_I"), [(0.0, 12.0), (0.5, 12.0), (0.9, 40.0)])
def test_a_disturbance_is_rejected(prediction, K, K_I):
    """A disturbance torque -J_phi^T delta leaves the sampled recursion's error."""
    delta = 3.0
    run = press(multiplier_law(K, K_I), 0.4, along_normal(delta, begin=0.05))
    e = run.force[:, 0] - 20.0
    begin = 50
    # Nothing is felt before the first tick: the run begins with the error of the set point.
    on = np.where(np.arange(len(e)) >= begin, delta, 0.0)
    predicted = recursion(K, K_I, on, -20.0)
    case = f"planar2 on a wall, K_λ = {K:g}, K_I = {K_I:g} 1/s, δ = 3 N"
    prediction(
        "greatest difference of e_λ from the sampled recursion [N]", "(4.112), sampled", case, 0.0,
        np.abs(e - predicted).max(), atol=1e-8, because="one linear recursion, exactly",
    )  # fmt: skip
    t = 0.1
    alone = e - recursion(K, K_I, 0 * on, -20.0)
    rate = K_I / (1 + K)
    prediction(
        "e_λ 0.1 s after the disturbance [N]", "(4.112)", case,
        delta / (1 + K) * np.exp(-rate * t), float(alone[begin + round(t / T)]),
        rtol=2 * rate * T + rate**2 * T * t,
        because="a delay of one tick: the recursion to first order in T against the continuous law",
    )  # fmt: skip


def test_the_recursion_tends_to_the_continuous_law(prediction):
    """The sampled recursion's slow pole for T -> 0 is K_I / (1 + K_lambda)."""
    K, K_I, T = 0.5, 12.0, 1e-6
    z = np.roots([1.0, -1.0 + K + K_I * T, -K])
    slow = max(z.real)
    prediction(
        "rate of e_λ, limit T → 0 [1/s]", "(4.112), sampled", "K_λ = 0.5, K_I = 12 1/s",
        K_I / (1 + K), -np.log(slow) / T, rtol=1e-4, because="first order in T = 1 µs",
    )  # fmt: skip


def test_without_an_integral_it_stays(prediction):
    """K_I = 0 leaves delta / (1 + K_lambda) for good."""
    run = press(multiplier_law(0.5, 0), 0.2, along_normal(3.0))
    prediction(
        "force error that stays [N]", "(4.112)", "planar2 on a wall, K_λ = 0.5, K_I = 0, δ = 3 N",
        3.0 / 1.5, float(run.force[-1, 0] - 20.0), rtol=1e-6,
        because="the recursion has settled: 0.5^200",
    )  # fmt: skip


@pytest.mark.parametrize("K", [0.97, 1.03])
def test_the_proportional_gain_on_both_sides_of_one(prediction, K):
    """e[k] = -K_lambda e[k-1]: it decays below 1 and grows above."""
    run = press(multiplier_law(K, 0), 0.05)
    e = np.abs(run.force[:, 0] - 20.0)
    rate = np.polyfit(np.arange(25), np.log(e[:25]), 1)[0]
    prediction(
        "growth of the error in a tick", "(4.106), sampled", f"planar2 on a wall, K_λ = {K}",
        K, float(np.exp(rate)), rtol=1e-6, because="one linear recursion, exactly",
    )  # fmt: skip


BOUNDARIES = [
    (1, 0.0, 0.0, "2"),
    (1, 0.5, 0.0, "2 (1 − K_λ)"),
    (2, 0.0, 0.0, "2 sin(π/6)"),
    (3, 0.0, 0.0, "2 sin(π/10)"),
    (1, 0.0, 0.5, "2 (1 + b)/(1 − b)"),
    (1, 1.5, 0.5, "2 ((1 + b)/(1 − b) − K_λ)"),
]


def excited(K, K_I, time, **sensing):
    """|e| [N] of a press whose set point rises in 50 ms, so that nothing saturates."""
    text = WALL.format(law=multiplier_law(K, round(K_I, 6))).replace("ramp: 0", "ramp: 50 ms")
    run = run_rigid(compiled(text), time, substeps=1, **sensing)
    return np.abs(run.force[:, 0] - 20.0)


def settles(K, K_I, delay, pole):
    """Whether the force error decays once the set point stands still.

    One that has grown beyond the set point of 20 N may be held there by the motors.
    """
    e = excited(K, K_I, 0.2, delay=delay, pole=pole)
    return e[160:].max() < min(e[80:120].max(), 20.0)


@pytest.mark.parametrize(("delay", "K", "pole", "formula"), BOUNDARIES)
def test_the_largest_integral_gain(prediction, delay, K, pole, formula):
    """Largest K_I T on a rigid contact, with a force that comes late or is filtered."""
    if pole:
        predicted = 2 * ((1 + pole) / (1 - pole) - K)
    else:
        predicted = 2 * (1 - K) if delay == 1 else 2 * np.sin(np.pi / (2 * (2 * delay - 1)))
    measured = critical(
        lambda x: settles(K, x / T, delay, pole), 0.9 * predicted, 1.1 * predicted, 0.005
    )
    filtered = f", low-pass b = {pole:g}" if pole else ""
    case = f"planar2 on a wall, K_λ = {K:g}, d = {delay}{filtered}: K_I T < {formula}"
    prediction(
        "critical K_I T", "(4.106), sampled", case, predicted, measured, rtol=0.02,
        because="bisection to 0.5 % of runs; at 1 % beyond, the error grows by half in 80 ticks",
    )  # fmt: skip


@pytest.mark.parametrize(("pole", "K"), [(0.5, 2.9), (0.5, 3.1)])
def test_a_low_pass_allows_a_larger_proportional_gain(prediction, pole, K):
    """K_lambda < (1 + b)/(1 - b): on both sides of it the error changes by the root's size."""
    e = excited(K, 0, 0.1, pole=pole)
    # y = b y + (1 - b) e, e = -K y: the root is b - K (1 - b).
    rate = np.polyfit(np.arange(55, 75), np.log(e[55:75]), 1)[0]
    prediction(
        "growth of the error in a tick", "(4.106), sampled",
        f"planar2 on a wall, K_λ = {K}, low-pass b = {pole:g}, bound 3", abs(pole - K * (1 - pole)),
        float(np.exp(rate)), rtol=1e-4, because="one linear recursion, exactly",
    )  # fmt: skip


def test_p_on_the_reaction_leaves_its_share(prediction):
    """(4.121): (I + K_F) e = delta."""
    law = "{kind: hybrid-reaction, force: {proportional: 0.6}}"
    run = press(law, 0.2, along_normal(3.0))
    prediction(
        "force error that stays [N]", "(4.121)", "planar2 on a wall, K_F = 0.6, δ = 3 N",
        3.0 / 1.6, float(run.force[-1, 0] - 20.0), rtol=1e-6,
        because="e[k] = −K_F e[k−1] + δ has settled: 0.6^200",
    )  # fmt: skip


def sampled_motion(K_P, K_D, x, v, ticks):
    """x'' = -K_D v - K_P x with the acceleration held for a period."""
    found = []
    for _ in range(ticks):
        found.append(x)
        a = -K_D * v - K_P * x
        x, v = x + T * v + T**2 / 2 * a, v + T * a
    return np.array(found)


def test_motion_and_multiplier_do_not_couple(prediction):
    """(4.109): a slip along the wall decays after K_D, K_P; the multiplier does not see it."""
    arm = Arm(compiled(WALL.format(law="hybrid-multipliers")))
    q, _ = arm.onto(arm.program.context.start.copy(), np.zeros(2), 0.0)
    model = arm.program.context.robot.pin
    world, tip = pin.LOCAL_WORLD_ALIGNED, model.getFrameId("tip")
    J = pin.computeFrameJacobian(model, model.createData(), q, tip, world)[:2]
    tangent = np.array([-0.6, 0.8])
    speed = 0.02
    text = WALL.format(law=multiplier_law(0, 0))
    run = run_rigid(compiled(text), 0.4, velocity=np.linalg.solve(J, tangent * speed))
    error = run.outputs["error"][:, :2] @ tangent
    w = 2 * np.pi * 5.0
    predicted = sampled_motion(w**2, 2 * w, 0.0, -speed, len(error))
    case = "planar2 on a wall, slipping along it at 20 mm/s; 5 Hz, ζ = 1"
    k = int(np.argmax(np.abs(predicted)))
    for what, i in (("greatest e₂ [µm]", k), ("e₂ 0.1 s after the start [µm]", 100)):
        prediction(
            what, "(4.109), sampled", case, 1e6 * predicted[i], 1e6 * float(error[i]), rtol=1e-3,
            because="the torque of the tick is held while the arm moves on by 1e-3 of its length",
        )  # fmt: skip
    prediction(
        "greatest force error meanwhile [N]", "(4.112)", case, 0.0,
        np.abs(run.force[:, 0] - 20.0).max(), atol=1e-9, because="double precision",
    )  # fmt: skip


def test_a_force_disturbance_does_not_move_the_tool(prediction):
    """A disturbance -J_phi^T delta reaches the multiplier alone."""
    run = press(multiplier_law(0.5, 12), 0.3, along_normal(3.0, begin=0.05))
    prediction(
        "greatest e₂ [m]", "(4.109)", "planar2 on a wall, δ = 3 N along the normal", 0.0,
        float(np.nanmax(np.abs(run.outputs["error"][:, :2]))), atol=1e-9,
        because="the wall takes all of it; double precision",
    )  # fmt: skip


def test_a_full_turn(prediction):
    """No fixed split survives a circle: it is chosen anew, and the torque does not jump."""
    run = run_rigid(compiled(RING), 4.0)
    chosen = np.where(np.diff(run.outputs["conditioning"][:, 0]) > 0.2)[0]
    steps = np.abs(np.diff(run.u, axis=0)).max(axis=1)
    case = "planar2, a full turn on a circle in 4 s, 20 N outward"
    prediction(
        "times that the coordinates are chosen anew", "(4.80)", case, 4, len(chosen), atol=0.5,
        because="each of x and y gives way twice",
    )  # fmt: skip
    usual = [np.median(steps[k - 20 : k + 20]) for k in chosen]
    prediction(
        "step of the torque there beyond its usual one [N·m]", "(4.80)", case, 0.0,
        float(max(steps[k : k + 2].max() - u for k, u in zip(chosen, usual, strict=True))),
        atol=1e-6, because="the acceleration of the old choice is held and fades",
    )  # fmt: skip
    late = slice(1000, None)
    prediction(
        "greatest force error after 1 s [N]", "(4.112)", case, 0.0,
        float(np.abs(run.force[late, 0] - 20.0).max()), atol=1e-4,
        because="K_I T 20 N that the integral took for an error during the ramp, faded at 2 Hz",
    )  # fmt: skip
