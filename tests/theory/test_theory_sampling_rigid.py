"""What sampling does on a rigid contact: the force errors of one tick make those of the next.

The plant runs at 20 kHz and the controller at 1 kHz, so `rigid` is 300 MN/m here and settles within
a tick: of the tick before, 0.45 % is left, the sampled model's smallest pole.
"""

from __future__ import annotations

import arm as plant
import numpy as np
import pytest
import sampled
from identify import grows, ratios
from presses import SQUARE

SECTION = "What sampling does, on a rigid contact"

T = 1e-3
SETTLED = "the contact keeps 0.45 % of the tick before, which shifts the ratio by about as much"
EXACT_MODEL = "the model is exact but for the arm's curvature, over less than 1 um"
BISECTED = "bisected to 0.2 %; within another 0.2 % of the boundary growth does not show in the run"
RIGID = "stiffness: rigid"
RATES = "control: {rate: 1 kHz, plant_rate: 20 kHz}\n"

STEP = "x: {{force: {f} N, ramp: 0}}"
# The expression starts from rest: after 0.2 s its own time is t - 0.1 s.
CLAMP = '"305 mm + clamp((t - 200.5 ms) * 10 mm/s, 0, 10 um)"'


def law_text(kind, k_F, k_I, h):
    force = f"force: {{proportional: {k_F:.9g}, integral: {k_I:.9g} /s"
    if kind == "hybrid":
        return f"{{kind: hybrid, {force}, damping: 30 N*s/m}}}}"
    if kind == "parallel-pid":
        return f"{{kind: parallel-pid, stiffness: 200 N/m, damping: 30 N*s/m, {force}}}}}"
    mass = f"mass: {h:.9g} kg, stiffness: 2 kN/m, damping: {{x: 20 N*s/m, y: 40 N*s/m}}"
    if kind == "impedance":
        return f"{{kind: impedance, {mass}}}"
    return f"{{kind: parallel, {mass}, {force}}}}}"


def ringing(simulate, kind, k_F, k_I, h, seconds=0.1, step=0.1):
    """Force after a kick, with gains that settle before it."""
    settled = law_text(kind, 0.0 if kind != "parallel" else 1.0, 10, 3)
    if kind == "impedance":
        first = "x: {position: 305 mm}"
        second = f"x: {{position: {CLAMP}}}"
        seconds += 0.3
    else:
        first, second = "x: {force: 20 N}", STEP.format(f=20 + step)
    run = simulate(
        SQUARE.task(
            settled,
            f"press: {{axes: {{{first}}}, time: 0.6 s}}",
            f"ring: {{law: {law_text(kind, k_F, k_I, h)}, axes: {{{second}}}, time: {seconds} s}}",
            contact=RIGID,
            rest=RATES,
        )
    )
    return run, run.during("ring", "force.x", 0.3035 if kind == "impedance" else 0.0015)


@pytest.fixture
def loop(simulate):
    """The sampled model of planar2 at its right angle on the rigid wall."""
    run, _ = ringing(simulate, "hybrid", 0.0, 10, 3, seconds=0.01)
    return plant.loop(run, "x y", "x", -1).core()


def model(loop, kind, k_F, k_I, h):
    """The law's linear map, with the gains of `law_text`."""
    if kind == "hybrid":
        return sampled.hybrid(k_F, k_I, 30.0)
    if kind == "parallel-pid":
        return sampled.parallel_pid(np.array([200.0]), np.array([30.0]), k_F, k_I)
    return sampled.parallel(loop, h, 20.0, 2e3, 1.0 if kind == "impedance" else k_F, k_I)


CASES = [
    ("impedance", 0.7), ("impedance", 1.1), ("parallel", 0.6), ("parallel", 1.1),
    ("parallel-pid", 0.9), ("parallel-pid", 1.1), ("hybrid", 0.9), ("hybrid", 1.1),
]  # fmt: skip


def gains_for(kind, K, felt):
    """(k_F, h_m) that make K_lambda."""
    if kind == "impedance":
        return 1.0, felt / (1 + K)
    if kind == "parallel":
        return 3.0 * (1 + K) / felt, 3.0
    return K, 3.0


FORMULA = {
    "impedance": ("(4.17)", "K = Λₙ/h_m - 1"),
    "parallel": ("(4.36)", "K = k_F Λₙ/h_m - 1"),
    "parallel-pid": ("(4.50)", "K = k_F"),
    "hybrid": ("(4.123)", "K = p"),
}


@pytest.mark.parametrize(("kind", "K"), CASES)
def test_the_force_error_alternates(simulate, prediction, loop, kind, K):
    """e[k] = -K e[k-1]: it rings down below K = 1 and up above."""
    k_F, h = gains_for(kind, K, loop.felt)
    _, force = ringing(simulate, kind, k_F, 0.0, h)
    equation, rule = FORMULA[kind]
    case, what = f"{kind}, planar2, {rule} = {K}", "force error of a tick over the one before"
    measured = ratios(force[:20], 1)[0].real
    z = np.linalg.eigvals(loop.matrix(model(loop, kind, k_F, 0.0, h)))
    prediction(
        what, f"{equation}, sampled", case, z[np.argmax(np.abs(z))].real, measured,
        rtol=1e-3, because=EXACT_MODEL,
    )  # fmt: skip
    prediction(what, f"{equation}, z = -K", case, -K, measured, rtol=1e-2, because=SETTLED)


#: law, what is in question, its critical value as a function of Lambda_n
BOUNDARIES = {
    "impedance": ("least stable h_m [kg]", lambda felt: felt / 2),
    "parallel": ("largest stable k_F", lambda felt: 2 * 3.0 / felt),
    "parallel-pid": ("largest stable k_F", lambda felt: 1.0),  # noqa: ARG005
    "hybrid": ("largest stable p", lambda felt: 1.0),  # noqa: ARG005
}


@pytest.mark.parametrize("kind", BOUNDARIES)
def test_boundary(simulate, prediction, loop, kind):
    """-1 < K < 1: for (4.17) that is h_m > Lambda_n/2."""
    what, critical = BOUNDARIES[kind]
    equation, rule = FORMULA[kind]
    case = f"{kind}, planar2, {rule} = 1"

    def gains(value):
        return (1.0, value) if kind == "impedance" else (value, 3.0)

    def settles(value):
        k_F, h = gains(value)
        return not grows(ringing(simulate, kind, k_F, 0.0, h, seconds=0.045, step=0.05)[1])

    def stable(value):
        k_F, h = gains(value)
        z = np.linalg.eigvals(loop.matrix(model(loop, kind, k_F, 0.0, h)))
        return bool(np.min(z.real) > -1)

    formula = critical(loop.felt)
    predicted = sampled.critical(stable, 0.5 * formula, 2 * formula, 1e-6)
    measured = sampled.bisected(settles, predicted)
    prediction(what, f"{equation}, sampled", case, predicted, measured, rtol=5e-3, because=BISECTED)
    prediction(what, f"{equation}, K = 1", case, formula, measured, rtol=2e-2, because=SETTLED)


#: law, K, k_I T
INTEGRALS = [("parallel-pid", 0.0, 0.5), ("parallel-pid", 0.0, 1.9), ("parallel-pid", 0.0, 2.1),
             ("parallel-pid", 0.4, 1.1), ("parallel-pid", 0.4, 1.3), ("hybrid", 0.2, 0.9),
             ("hybrid", 0.2, 1.7)]  # fmt: skip


@pytest.mark.parametrize(("kind", "K", "KIT"), INTEGRALS)
def test_integral_gain(simulate, prediction, loop, kind, K, KIT):
    """z^2 - z + (K + K_I T) z - K = 0: stable for 0 < K_I T < 2 (1 - K)."""
    _, force = ringing(simulate, kind, K, KIT / T, 3.0)
    formula = np.roots([1.0, K + KIT - 1, -K])
    z = np.linalg.eigvals(loop.matrix(model(loop, kind, K, KIT / T, 3.0)))
    measured = ratios(force[:20], 2 if K else 1)[0].real
    equation, rule = FORMULA[kind]
    case = f"{kind}, planar2, {rule} = {K}, K_I T = {KIT}"
    what = "leading root z of the force error"
    prediction(
        what, f"{equation}, sampled", case, z[np.argmax(np.abs(z))].real, measured,
        rtol=2e-3, because=EXACT_MODEL,
    )  # fmt: skip
    prediction(
        what, "z² - (1 - K - K_I T) z - K = 0", case, formula[np.argmax(np.abs(formula))],
        measured, rtol=2e-2, because=SETTLED,
    )  # fmt: skip
    assert (abs(measured) < 1) == (KIT < 2 * (1 - K))
