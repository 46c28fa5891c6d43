"""Section 4.2: parallel control reaches its force, and what it costs where that is not possible."""

from __future__ import annotations

import arm as plant
import numpy as np
import pytest
import sampled
from identify import poles, rate
from presses import ARMS, SQUARE

SECTION = "4.2 Parallel control"

T = 1e-3

# ---- equilibria

FORCE, K_E = 12.0, 10e3
DECAYED = "the slowest mode, at -2.8 1/s or quicker, leaves less than 1e-7 of the press"
LAWS = {
    "parallel": "{kind: parallel, stiffness: {linear: 500 N/m, angular: 60 N*m/rad}, "
    "force: {integral: 3 /s}}",
    "parallel-pid": "{kind: parallel-pid, stiffness: {linear: 500 N/m, angular: 60 N*m/rad}, "
    "force: {integral: 3 /s}}",
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", ARMS)
def test_equilibrium(simulate, prediction, name, law):
    """(4.40), (4.41): the force wins along the normal, the position across it."""
    arm = ARMS[name]
    n = arm.normal
    # An arm that cannot keep its tool straight would roll the ball, off the tip that is logged.
    across = ", y: {move: 20 mm}" if "r" in arm.axes else ""
    press = f"press: {{axes: {{N: {{position: {arm.depth(5)}, force: +12 N}}{across}}}, time: 6 s}}"
    run = simulate(arm.task(LAWS[law], press))
    case = f"{law}, {name}, 12 N on 10 kN/m, x_d 5 mm below the surface"
    prediction(
        "f_E [N]", "(4.41)", case, FORCE, arm.into * run[f"force.{n}"][-1],
        rtol=1e-6, because=DECAYED,
    )  # fmt: skip
    prediction(
        "deformation a^T (x_e - x_E) [mm]", "(4.40)", case,
        1e3 * FORCE / K_E, -1e3 * run["gap"][-1],
        rtol=1e-6, because=DECAYED,
    )  # fmt: skip
    prediction(
        "error across the normal [mm]", "(4.40)", case, 0.0, 1e3 * run["error.y"][-1],
        atol=1e-5, because="1e-6 of the 10 mm between x_d and x_E and of the way",
    )  # fmt: skip


def test_it_is_the_impedance_law_with_unit_force_gain(simulate, prediction):
    """(4.16) is K_F = I, K_I = 0, f_d = 0; with K_F = 0 the contact would be invisible: 100 N."""
    press = f"press: {{axes: {{N: {{position: {SQUARE.depth(20)}}}}}, time: 6 s}}"
    law = "{kind: parallel, stiffness: 500 N/m}"
    run = simulate(SQUARE.task(law, press, contact="stiffness: 5 kN/m"))
    prediction(
        "f_E of a motion along the normal [N]", "(4.16), (4.36)",
        "parallel, planar2, 20 mm into 5 kN/m at 500 N/m",
        500 * 5e3 / 5.5e3 * 0.02, run["force.x"][-1], rtol=1e-6, because=DECAYED,
    )  # fmt: skip


# ---- force regulation

#: arm, h_m [kg], d_m [N s/m], k_m [N/m], k_F, k_I [1/s], k_e [kN/m], d_e [N s/m]
REGULATION = [
    ("planar2", 2, 100, 500, 1.0, 5, 10, 0),
    ("planar2", 2, 100, 500, 0.5, 10, 10, 20),
    ("planar2", 3, 60, 800, 2.0, 4, 5, 0),
    ("panda", 5, 150, 500, 1.0, 6, 10, 0),
]


@pytest.mark.parametrize(("name", "h", "d", "k", "k_F", "k_I", "k_e", "d_e"), REGULATION)
def test_force_regulation(simulate, prediction, name, h, d, k, k_F, k_I, k_e, d_e):
    """(4.44)-(4.46): one slow pole of the integral, and a pair that rings."""
    arm = ARMS[name]
    n = arm.normal
    law = (
        f"{{kind: parallel, mass: {h} kg, damping: {d} N*s/m, stiffness: {k} N/m, "
        f"force: {{proportional: {k_F}, integral: {k_I} /s}}}}"
    )
    run = simulate(
        arm.task(
            law,
            "press: {axes: {N: {force: +10 N}}, time: 2 s}",
            "step: {axes: {N: {force: +11 N, ramp: 0}}, time: 2 s}",
            contact=f"stiffness: {k_e} kN/m, damping: {d_e} N*s/m",
        )
    )
    case = (
        f"parallel, {name}, {h} kg, {d} N·s/m, {k} N/m, k_F {k_F}, k_I {k_I} 1/s on {k_e} kN/m, "
        f"{d_e} N·s/m"
    )
    loop = plant.loop(run, arm.axes, n, -1).core()
    model = loop.poles(sampled.parallel(loop, h, d, k, k_F, k_I))
    ringing = sampled.omega_zeta(model)
    stride = max(1, round(2 * np.pi / ringing[0] / T / 12))
    seen = poles(run.during("step", f"position.{n}", 0.01, 1.0), 3, T, stride)
    limit = loop.towards_continuous()
    reached = limit.poles(sampled.parallel(limit, h, d, k, k_F, k_I))
    k_e *= 1e3
    chapter = np.roots([h, d + k_F * d_e, k + k_F * k_e + k_I * d_e, k_I * k_e])
    chapter = chapter[np.argsort(-chapter.real)]
    numbers = [_slow_and_ringing(s) for s in (model, seen, chapter, reached)]
    names = ("time constant of the force [ms]", "ω of the force [rad/s]", "ζ of the force")
    for what, sample, measured, formula, fast in zip(names, *numbers, strict=True):
        prediction(
            what, "(4.36), sampled", case, sample, measured, rtol=2e-3,
            because="the model is exact but for the arm's curvature over 0.2 mm",
        )  # fmt: skip
        prediction(
            f"limit T → 0: {what.split()[0]}", "(4.44), (4.46)", case, formula, fast, rtol=1e-3,
            because="first order in T = 1 us",
        )  # fmt: skip


def _slow_and_ringing(s):
    """Time constant of the slowest real pole [ms], frequency and damping ratio of the pair."""
    slow = max(pole.real for pole in s if abs(pole.imag) < 1e-6 * abs(pole))
    return (-1e3 / slow, *sampled.omega_zeta(s))


# ---- where the force cannot win

LAW = (
    "{kind: parallel, mass: 2 kg, damping: 100 N*s/m, stiffness: 500 N/m, "
    "force: {proportional: 1, integral: 4 /s}}"
)


@pytest.mark.parametrize("degrees", [5, 0])
def test_a_tilted_force_drifts(simulate, prediction, degrees):
    """(4.47)-(4.49): f_E = a a^T f_d, and the tool drifts along the rest at k_I/k_m."""
    frame = (
        f"frames: {{felt: {{xyz: [300 mm, 300 mm, 0], rpy: [0, 0, {degrees} deg]}}}}\nframe: felt\n"
    )
    sideways = 0 if degrees else 1
    hold = "position: 0"
    run = simulate(
        SQUARE.task(
            LAW,
            # The normal force is there before, as far as it can be without a drift of its own.
            "touch: {frame: world, axes: {x: {force: 10 N}}, time: 1.5 s}",
            f"drift: {{axes: {{x: {{force: 10 N, ramp: 0, {hold}}}, "
            f"y: {{force: {sideways} N, ramp: 0, {hold}}}}}, time: 3 s}}",
            rest=frame,
        )
    )
    tilt = np.deg2rad(degrees)
    R = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    f_d = R @ np.array([10.0, sideways])
    case = (
        f"parallel, planar2, f_d tilted by {degrees}°"
        if degrees
        else "parallel, planar2, 1 N along the plane"
    )
    f = R @ np.array([run.during("drift", f"force.{a}", 2.5) for a in "xy"])
    x = R @ np.array([run.during("drift", f"position.{a}", 2.5) for a in "xy"])
    t = run.during("drift", "t", 2.5)
    prediction(
        "f_E along a [N]", "(4.48)", case, f_d[0], f[0, -1], rtol=1e-4,
        because="the normal force's slowest mode, -3.8 1/s, leaves e^-11 of the 0.04 N that the "
        "tilt changed",
    )  # fmt: skip
    prediction(
        "drift velocity [mm/s]", "(4.49)", case, 1e3 * 4 / 500 * f_d[1], 1e3 * rate(x[1], T),
        rtol=1e-3, because="tangential modes of 2 kg, 100 N s/m, 500 N/m are over: e^-16",
    )  # fmt: skip
    offset = f_d[1] * (4 * t[-1] / 500 + 1 / 500 - 100 * 4 / 500**2)
    prediction(
        "offset x - x_d after 3 s [mm]", "(4.49)", case, 1e3 * offset, 1e3 * x[1, -1],
        rtol=1e-3, because="the same; a ramp is exact under semi-implicit Euler",
    )  # fmt: skip


def test_a_reference_that_moves_along_the_normal(simulate, prediction):
    """a . (f - f_d) = -(k_m/k_I) a . x'_d."""
    run = simulate(
        SQUARE.task(LAW, "press: {axes: {x: {force: 10 N, velocity: 5 mm/s}}, time: 6 s}")
    )
    prediction(
        "force error f - f_d, as applied [N]", "(4.39)",
        "parallel, planar2, x_d into the wall at 5 mm/s",
        500 / 4 * 0.005, run["force.x"][-1] - 10, rtol=1e-5,
        because="the slowest mode, -3.8 1/s, leaves e^-20",
    )  # fmt: skip


@pytest.mark.parametrize("isotropic", [True, False])
def test_friction_is_integrated(simulate, prediction, isotropic):
    """With an isotropic K_I a sliding tool lags by (k_I/k_m) mu f_n more every second."""
    tangential = "velocity: 20 mm/s" + (", force: 0" if isotropic else "")
    run = simulate(
        SQUARE.task(
            LAW,
            "touch: {axes: {x: {force: 10 N}}, time: 1.5 s}",
            f"slide: {{axes: {{x: {{force: 10 N}}, y: {{{tangential}}}}}, time: 2.5 s}}",
            contact="stiffness: 10 kN/m, friction: 0.2",
        )
    )
    predicted = 4 / 500 * 0.2 * 10 if isotropic else 0.0
    measured = rate(run.during("slide", "error.y", 1.8), T)
    case = "parallel, planar2, 10 N, μ = 0.2, K_I " + ("isotropic" if isotropic else "a aᵀ")
    if isotropic:
        prediction(
            "growth of the lag [mm/s]", "(4.36), friction", case, 1e3 * predicted, 1e3 * measured,
            rtol=1e-2, because="friction is Coulomb's within 1 % (docs/conventions.md)",
        )  # fmt: skip
    else:
        prediction(
            "growth of the lag [mm/s]", "(4.36), friction", case, 0.0, 1e3 * measured,
            atol=0.01, because="the core cancels friction but for one tick; 1/1600 of 16 mm/s",
        )  # fmt: skip
