"""What sampling does on a rigid contact: the force errors of one tick make those of the next.

The plant runs at 20 kHz and the controller at 1 kHz, so `rigid` is 4e8 N/m here and settles within
a tick: 10 rad of critical damping leave (1 + 10) e^-10 = 5e-4 of the tick before.
"""

from __future__ import annotations

import numpy as np
import pytest

import arm as plant
import sampled
from identify import grows, ratios
from presses import SQUARE

SECTION = "What sampling does, on a rigid contact"

T = 1e-3
SETTLED = "the contact keeps 5e-4 of the tick before; the springs of the law give way by less"
RIGID = "stiffness: rigid"
RATES = "control: {rate: 1 kHz, plant_rate: 20 kHz}\n"

#: Each law with K_lambda or k_I in question: its gains, and a set point that it takes in one tick.
STEP = "x: {{force: {f} N, ramp: 0}}"
CLAMP = '"305 mm + clamp((t - 100.5 ms) * 10 mm/s, 0, 10 um)"'


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
        seconds += 0.1
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
    return run, run.during("ring", "force.x", 0.1035 if kind == "impedance" else 0.0015)


@pytest.fixture
def felt(simulate):
    """Lambda_n of planar2 at its right angle [kg]."""
    run, _ = ringing(simulate, "hybrid", 0.0, 10, 3, seconds=0.01)
    return plant.loop(run, "x y", "x", -1).felt


CASES = [("impedance", 0.7), ("impedance", 1.1), ("parallel", 0.6), ("parallel", 1.1),
         ("parallel-pid", 0.9), ("parallel-pid", 1.1), ("hybrid", 0.9), ("hybrid", 1.1)]  # fmt: skip


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
def test_the_force_error_alternates(simulate, prediction, felt, kind, K):
    """e[k] = -K e[k-1]: it rings down below K = 1 and up above."""
    k_F, h = gains_for(kind, K, felt)
    _, force = ringing(simulate, kind, k_F, 0.0, h)
    equation, rule = FORMULA[kind]
    print(kind, K, force[:6])
    prediction(
        "force error of a tick over that of the tick before", equation,
        f"{kind}, planar2, {rule} = {K}", -K, ratios(force[:20], 1)[0].real,
        rtol=2e-3, because=SETTLED,
    )  # fmt: skip
