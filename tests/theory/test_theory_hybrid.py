"""Section 4.3.3: hybrid control in a task frame, one loop for each axis."""

from __future__ import annotations

import arm as plant
import numpy as np
import pytest
import sampled
from identify import poles
from presses import ARMS, SQUARE

SECTION = "4.3.3 Hybrid force/velocity control in a task frame"

T = 1e-3

# ---- the force axis

#: arm, p, i [1/s], d [N s/m], k_e [kN/m], d_e [N s/m]
FORCE_LOOPS = [
    ("planar2", 0.0, 5, 120, 10, 0),
    ("planar2", 0.3, 5, 100, 5, 20),
    ("planar3", 0.2, 6, 120, 10, 0),
    ("ur5e", 0.0, 5, 150, 5, 0),
    ("panda", 0.0, 6, 150, 10, 0),
    ("panda", 0.4, 4, 100, 5, 0),
]


@pytest.mark.parametrize(("name", "p", "i", "d", "k_e", "d_e"), FORCE_LOOPS)
def test_force_axis(simulate, prediction, name, p, i, d, k_e, d_e):
    """h z'' = u + f: f'' + (d + d_e)/h f' + k_e/h ((1 + p)(f - f_d) + i int (f - f_d)) = 0."""
    arm = ARMS[name]
    n = arm.normal
    law = (
        f"{{kind: hybrid, force: {{proportional: {{{n}: {p}}}, integral: {{{n}: {i} /s}}, "
        f"damping: {{{n}: {d} N*s/m}}}}}}"
    )
    run = simulate(
        arm.task(
            law,
            "press: {axes: {N: {force: +10 N}}, time: 2 s}",
            "step: {axes: {N: {force: +11 N, ramp: 0}}, time: 6 s}",
            contact=f"stiffness: {k_e} kN/m, damping: {d_e} N*s/m",
        )
    )
    case = f"hybrid, {name}, p {p}, i {i} 1/s, d {d} N·s/m on {k_e} kN/m, {d_e} N·s/m"
    loop = plant.loop(run, arm.axes, n, -1).core()
    law_of = sampled.hybrid(p, i, d)
    model = loop.poles(law_of)
    stride = max(1, round(2 * np.pi / sampled.omega_zeta(model)[0] / T / 12))
    seen = poles(run.during("step", f"position.{n}", 0.01, 1.5), 3, T, stride)
    h, k = loop.felt, 1e3 * k_e
    # d_e counts in the force that is measured: u answers k_e x + d_e x' with p and i.
    chapter = np.roots([h, d + (1 + p) * d_e, (1 + p) * k + i * d_e, i * k])
    reached = loop.towards_continuous().poles(law_of)
    names = ("time constant of the force [ms]", "ω of the force [rad/s]", "ζ of the force")
    numbers = [_slow_and_ringing(s) for s in (model, seen, chapter, reached)]
    for what, sample, measured, formula, fast in zip(names, *numbers, strict=True):
        prediction(
            what, "(4.123), sampled", case, sample, measured, rtol=5e-3,
            because="the model is exact but for the arm's curvature over 0.2 mm",
        )  # fmt: skip
        prediction(
            f"limit T → 0: {what.split()[0]}", "(4.123), force axis", case, formula, fast,
            rtol=1e-3, because="first order in T = 1 us",
        )  # fmt: skip
    prediction(
        "f_E [N]", "(4.123), force axis", case, 11.0, arm.into * run[f"force.{n}"][-1],
        rtol=1e-6, because="the slowest mode, -2.8 1/s or quicker, leaves e^-17 of 1 N",
    )  # fmt: skip


def _slow_and_ringing(s):
    """Time constant of the slowest real pole [ms], frequency and damping ratio of the pair."""
    slow = max(pole.real for pole in s if abs(pole.imag) < 1e-6 * abs(pole))
    ringing = sorted(s, key=lambda pole: -pole.real)
    return (-1e3 / slow, *sampled.omega_zeta(np.array(ringing)))


# ---- the motion axes

#: arm, axis that moves, bandwidth [Hz], damping ratio
MOTIONS = [("planar2", "y", 4, 0.5), ("panda", "x", 5, 0.7), ("ur5e", "y", 3, 0.3)]


@pytest.mark.parametrize(("name", "axis", "bandwidth", "ratio"), MOTIONS)
def test_motion_axis_beside_a_force(simulate, prediction, name, axis, bandwidth, ratio):
    """e'' + K_D e' + K_P e = 0 while the other axis presses, and the press does not feel it."""
    arm = ARMS[name]
    n = arm.normal
    law = (
        f"{{kind: hybrid, bandwidth: {bandwidth} Hz, damping_ratio: {ratio}, "
        f"force: {{integral: 5 /s, damping: 120 N*s/m}}}}"
    )
    lagging = "{kind: parallel-pid, stiffness: {linear: 500 N/m, angular: 60 N*m/rad}}"
    both = f"axes: {{N: {{force: +10 N}}, {axis}: {{velocity: 10 mm/s}}}}"
    run = simulate(
        arm.task(
            law,
            # This law damps the velocity itself, so it lags; the error is carried on.
            f"lag: {{law: {lagging}, {both}, time: 3 s}}",
            f"free: {{{both}, time: 2 s}}",
        )
    )
    w = 2 * np.pi * bandwidth
    loop = sampled.Loop(np.eye(1), 0, 0.0, 0.0, 0.0)
    law_of = sampled.motion(loop, w**2, 2 * ratio * w)
    predicted = sampled.omega_zeta(loop.poles(law_of))
    error = run.during("free", f"error.{axis}")
    stride = round(2 * np.pi / w / T / 10)
    measured = sampled.omega_zeta(poles(error[:400], 2, T, stride))
    case = f"hybrid, {name}, {axis} at {bandwidth} Hz, ζ {ratio}, beside a press of 10 N"
    limit = loop.towards_continuous()
    reached = sampled.omega_zeta(limit.poles(law_of))
    for i, what in enumerate(("ω of the motion error [rad/s]", "ζ of the motion error")):
        prediction(
            what, "(4.109), (4.123), sampled", case, predicted[i], measured[i], rtol=5e-3,
            because="semi-implicit steps in the joints, not in the task: first order in T v/L",
        )  # fmt: skip
        prediction(
            f"limit T → 0: {what[0]}", "(4.109), (4.123)", case, (w, ratio)[i], reached[i],
            rtol=1e-3, because="first order in T = 1 us",
        )  # fmt: skip
    force = run.during("free", f"force.{n}")
    prediction(
        "force's deviation while the motion error decays [N]", "(4.123), no coupling", case,
        0.0, np.max(np.abs(arm.into * force - 10)), atol=1e-3,
        because="a step made in the joints is off the plane by T^2 v^2/(2 L), which the damper "
        "feels as d T v^2/(2 L) = 0.2 mN at 30 mm/s",
    )  # fmt: skip
    assert abs(error[0]) > 5e-4


@pytest.mark.parametrize("name", ["planar3", "ur5e", "panda"])
def test_a_force_step_does_not_shake_the_motion(simulate, prediction, name):
    """The core moves the normal alone; what the motion axes feel is one tick of its force.

    (f[k] - f[k-1]) / m across the normal, and nothing else: zero as T goes to zero.
    """
    arm = ARMS[name]
    n = arm.normal
    law = "{kind: hybrid, force: {integral: 5 /s, damping: 120 N*s/m}}"
    run = simulate(
        arm.task(
            law,
            "press: {axes: {N: {force: +10 N}}, time: 1 s}",
            "step: {axes: {N: {force: +20 N, ramp: 0}}, time: 1 s}",
        )
    )
    loop = plant.loop(run, arm.axes, n, -1)
    mobility = np.linalg.inv(loop.inertia)[loop.normal]
    first = int(np.argmax(run.history.window("step")))
    # What the tool feels is cancelled one tick late.
    late = -np.diff(run[f"force.{n}"][first - 1 :])
    w = 2 * np.pi * 5
    for axis in sorted({"x", "y"} - {n}):
        across = mobility[arm.axes.split().index(axis)]
        x, v, expected = 0.0, 0.0, []
        for kick in late:
            expected.append(-x)
            v += T * (across * kick - 2 * w * v - w**2 * x)
            x += T * v
        moved = run.during("step", f"error.{axis}")
        extreme = int(np.argmax(np.abs(expected)))
        prediction(
            f"greatest error along {axis} after a step of 10 N [mm]", "(4.123), one tick late",
            f"hybrid, {name}, 10 kN/m", 1e3 * expected[extreme], 1e3 * moved[extreme], rtol=2e-2,
            because="the mobility across the normal is taken where the run ends, 2 mm on",
        )  # fmt: skip


def test_motion_along_the_normal_meets_a_surface_as_the_arm_itself(simulate, prediction):
    """A motion axis along the nominal normal leaves f uncancelled: K_P Lambda_n is its spring."""
    run = simulate(
        SQUARE.task(
            "{kind: hybrid, bandwidth: 3 Hz}",
            f"go: {{axes: {{x: {{position: {SQUARE.depth(10)}}}}}, time: 4 s}}",
        )
    )
    loop = plant.loop(run, "x y", "x", -1)
    k = loop.felt * (2 * np.pi * 3) ** 2
    prediction(
        "f_E 10 mm into 10 kN/m [N]", "(4.27), K_m = Λₙ K_P", "hybrid, planar2, x at 3 Hz",
        k * 10e3 / (k + 10e3) * 0.01, run["force.x"][-1],
        rtol=1e-6, because="Λ is taken where the run ends; the mode of 19 rad/s is over: e^-30",
    )  # fmt: skip
