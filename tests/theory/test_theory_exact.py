"""Sections 4.3.1 and 4.3.2 on equations that hold exactly: task files, run on the plant."""

from __future__ import annotations

import numpy as np
import pytest
from sampled import critical

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text
from taskspec.stability.margin import Search
from taskspec.stability.sampled_stage import analyse

SECTION = "4.3.2 Equations that hold exactly"
T = 1e-3

WALL = """taskspec: 1
robot: {{model: planar2, start: {{xyz: [350 mm, 200 mm, 0]}}{sensor}}}
world: {{wall: {{equation: "0.8*x + 0.6*y = 400 mm", stiffness: exact}}}}
law: {law}
truth: {{faults: {faults}}}
stages:
  press: {{constraints: {{wall: {{force: 20 N, ramp: {ramp}}}}}, time: {time} s}}
"""


def law(proportional, integral):
    force = f"{{proportional: {proportional!r}, integral: {integral!r} /s}}"
    return f"{{kind: hybrid-multipliers, force: {force}}}"


def wall(proportional, integral, *, faults="[]", ramp="0", time=0.4, sensor=""):
    return WALL.format(
        law=law(proportional, integral), faults=faults, ramp=ramp, time=time, sensor=sensor
    )


def recursion(K, K_I, delta, first):
    """e[k] = -K e[k-1] - K_I s[k] + delta[k], s[k] = s[k-1] + T e[k-1] (theory: sampling)."""
    e, s = [first], 0.0
    for disturbance in delta:
        s += T * e[-1]
        e.append(-K * e[-1] - K_I * s + disturbance)
    return np.array(e[1:])


@pytest.mark.parametrize(("K", "K_I"), [(0.0, 12.0), (0.5, 12.0), (0.9, 40.0)])
def test_a_disturbance_is_rejected(simulate, prediction, K, K_I):
    """A disturbance torque -J_phi^T delta by `truth` leaves delta/(1 + K) exp(-K_I t/(1 + K))."""
    delta, begin = 3.0, 50
    J = compile_unchecked(load_text(wall(K, K_I), "t.yaml")).context.start_equations["wall"].normal
    faults = ", ".join(
        f"{{torque: bias {float(delta * J[i])!r} N*m, joint: {i + 1}, at: 50 ms}}" for i in (0, 1)
    )
    run = simulate(wall(K, K_I, faults=f"[{faults}]"))
    e = run["wall.lambda"] - 20.0
    on = np.where(np.arange(len(e)) >= begin, delta, 0.0)
    case = f"planar2 on an exact wall, K_λ = {K:g}, K_I = {K_I:g} 1/s, δ = 3 N"
    prediction(
        "greatest difference of e_λ from the sampled recursion [N]", "(4.112), sampled", case, 0.0,
        np.abs(e - recursion(K, K_I, on, -20.0)).max(), atol=1e-6,
        because="one linear recursion; the arm rests to 1e-12 m",
    )  # fmt: skip
    t, rate = 0.1, K_I / (1 + K)
    alone = e - recursion(K, K_I, 0 * on, -20.0)
    prediction(
        "e_λ 0.1 s after the disturbance [N]", "(4.112)", case,
        delta / (1 + K) * np.exp(-rate * t), float(alone[begin + round(t / T)]),
        rtol=2 * rate * T + rate**2 * T * t,
        because="a delay of one tick: the recursion to first order in T against the continuous law",
    )  # fmt: skip


BOUNDARIES = [
    (0.0, "", 2.0, "2"),
    (0.5, "", 1.0, "2 (1 − K_λ)"),
    (0.0, ", sensor: {delay: 1 ms}", float(2 * np.sin(np.pi / 6)), "2 sin(π/6), d = 2"),
]


@pytest.mark.parametrize(("K", "sensor", "bound", "formula"), BOUNDARIES)
def test_the_largest_integral_gain(simulate, prediction, K, sensor, bound, formula):
    """What TS501 goes by, and what a run does, is the boundary of a rigid contact."""
    text = wall(K, round(float(0.5 * bound / T), 6), sensor=sensor)
    program = compile_unchecked(load_text(text, "task.yaml"))
    stage = analyse(program.stages[0])
    limit = Search(program.context, stage).gain("force.integral", ["wall"])
    case = f"planar2 on an exact wall, K_λ = {K:g}: K_I T < {formula}"
    prediction(
        "critical K_I T by the sampled plant", "(4.106), sampled", case, bound, limit.value * T,
        rtol=2e-3, because="found to 5e-4 of its value",
    )  # fmt: skip

    def settles(x):
        text = wall(K, round(float(x / T), 6), ramp="50 ms", time=0.2, sensor=sensor)
        e = np.abs(simulate(text)["wall.lambda"] - 20.0)
        # One that has grown beyond the set point may be held there by the motors.
        return e[160:].max() < min(e[80:120].max(), 20.0)

    prediction(
        "critical K_I T in runs", "(4.106), sampled", case, bound,
        critical(settles, 0.9 * bound, 1.1 * bound, 0.005), rtol=0.02,
        because="bisection to 0.5 % of runs",
    )  # fmt: skip
