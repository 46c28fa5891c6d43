"""Theorem 4.1 with a rate: no run of a random press leaves the bound, and none is slower."""

from __future__ import annotations

import numpy as np
import presses
from scipy.linalg import expm

from taskspec.control.regulator_bound import (
    ArmBounds,
    PressedContact,
    RegulatedAxis,
    RegulatorState,
    regulator_bound,
)
from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.report.settling import settlings

SECTION = "4.2 Parallel control"
ARMS = list(presses.ARMS.values())


def press(rng):
    """A press that is stepped by a fifth, after a force across the normal has been let go."""
    arm = ARMS[rng.integers(len(ARMS))]
    k_m, d_m, k_e = rng.uniform(200, 900), rng.uniform(60, 160), 10 ** rng.uniform(3, 4)
    k_F, k_I, f = rng.uniform(0.1, 0.6), rng.uniform(1, 4), rng.uniform(5, 15)
    across = next(a for a in "xyz" if a in arm.axes.split() and a != arm.normal)
    aside = rng.uniform(-4, 4)
    law = (
        f"{{kind: parallel-pid, stiffness: {k_m:.4g} N/m, damping: {d_m:.4g} N*s/m, "
        f"force: {{proportional: {k_F:.3g}, integral: {k_I:.3g} /s}}}}"
    )
    return arm.task(
        law,
        f"press: {{axes: {{N: {{force: +{f:.4g} N}}}}, time: 1.5 s}}",
        f"lean: {{axes: {{N: {{force: +{f:.4g} N}}, {across}: {{force: {aside:.3g} N}}}}, "
        "time: 0.5 s}",
        f"step: {{axes: {{N: {{force: +{1.2 * f:.4g} N, ramp: 0}}}}, time: 4 s}}",
        contact=f"stiffness: {k_e:.5g} N/m, damping: {rng.uniform(0, 20):.3g} N*s/m",
    )


def test_no_random_press_leaves_its_bound(tmp_path, request, prediction):
    """||e|| of each run against Phi exp(-r t), and the rate at which ||e|| falls against r.

    The bound is that of (4.56) in continuous time; what sampling and the contact's damper make of
    it is of first order in it. Rotations are held, as the theorem has none.
    """
    count = request.config.getoption("random_presses")
    rng, inside, fast, bounded = np.random.default_rng(41), 0, 0, 0
    for number in range(count):
        made = run(
            load_text(press(rng), "task.yaml"), out=tmp_path / str(number), force=True, report=False
        )
        assert made.summary["status"] == "done"
        (each,) = (each for each in settlings(made) if each.stage == "step")
        if each.bound is None:
            continue
        bounded += 1
        t = np.arange(len(each.error)) * made.period
        inside += bool(np.all(each.error < each.bound.at(t)))
        # The largest that is still to come never rises, so it has a rate whatever oscillates.
        left = np.maximum.accumulate(each.error[::-1])[::-1]
        seen = np.flatnonzero(left > 1e-4 * left[0])[-1]
        fast += np.log(left[0] / left[seen]) > each.bound.rate * t[seen]
    # Not all gains satisfy (4.70) and (4.71).
    assert bounded > 0.8 * count
    case = f"parallel-pid, {count} random presses of four arms, {bounded} of them with a bound"
    for what, found in (("below their bound", inside), ("falling faster than it", fast)):
        prediction(
            f"runs {what}", "(4.65), Theorem 4.1 made strict", case, bounded, found,
            atol=0.5, because="a bound has no exception",
        )  # fmt: skip


def test_the_bound_holds_for_the_linear_closed_loop():
    """(4.60), (4.61) with constant inertia and C_x = 0, solved exactly: ||e|| below the bound."""
    rng, found = np.random.default_rng(7), 0
    for _ in range(200):
        size = rng.integers(1, 4)
        masses = rng.uniform(0.5, 8, size)
        turn = np.linalg.qr(rng.normal(size=(size, size)))[0]
        H = turn @ np.diag(masses) @ turn.T
        k, d = rng.uniform(100, 900, size), rng.uniform(40, 200, size)
        k_e, k_F, k_I = 10 ** rng.uniform(3, 4.5), rng.uniform(0, 0.8), rng.uniform(0.5, 6)
        e, v, w = rng.normal(size=size) * 1e-3, rng.normal(size=size) * 1e-2, rng.normal() * 1e-3
        bound = regulator_bound(
            [RegulatedAxis(*each) for each in zip(k, d, strict=True)],
            PressedContact(k_e, k_F, k_I),
            ArmBounds(masses.min(), masses.max(), 0.0),
            RegulatorState(e, v, w),
            3.0,
        )
        if bound is None:
            continue
        found += 1
        a = np.eye(size)[0]
        stiff = np.diag(k) + (1 + k_F) * k_e * np.outer(a, a)
        F = np.zeros((2 * size + 1, 2 * size + 1))
        F[:size, :size] = -np.linalg.solve(H, np.diag(d))
        F[:size, size:-1] = -np.linalg.solve(H, stiff)
        F[:size, -1] = -k_I * k_e * np.linalg.solve(H, a)
        F[size:-1, :size] = np.eye(size)
        F[-1, size] = 1
        step, z, T = expm(F * 5e-3), np.concatenate([v, e, [w]]), 5e-3
        for number in range(600):
            assert np.linalg.norm(z[size:-1]) <= bound.at(number * T)
            z = step @ z
        # No bound is faster than the slowest pole.
        assert bound.rate <= -np.linalg.eigvals(F).real.max() * (1 + 1e-9)
    assert found > 100


def test_gains_outside_the_theorem_have_no_bound():
    """(4.70), (4.71): k_I / (1 + k_F) = 4 / 1.5 of the least rho, times 30 kg, is more than d_m."""
    start = RegulatorState(np.array([1e-3]), np.zeros(1), 0.0)
    contact, arm = PressedContact(5e3, 0.5, 4.0), ArmBounds(1.0, 30.0, 0.0)
    assert regulator_bound([RegulatedAxis(500, 79)], contact, arm, start, 3.0) is None
    assert regulator_bound([RegulatedAxis(500, 120)], contact, arm, start, 3.0) is not None
