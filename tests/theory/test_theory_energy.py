"""The chapter's Lyapunov functions along runs: they fall, and as fast as the proofs have it.

The log has the state at the start of each tick; rates are integrated by the trapezoidal rule. The
torque is held over 1 ms: a damper of K_m T/2 = 0.25 N s/m too few, beside 20 N s/m and more.
"""

from __future__ import annotations

import arm as plant
import numpy as np
import pytest
from presses import SQUARE

from taskspec.geometry.axis import Axis
from taskspec.robot.operational import operational_terms

T = 1e-3
AXES = (Axis.X, Axis.Y)
#: Share of the energy by which sampling is off the continuous rate.
SAMPLED = 0.03
K_M, D_M, K_E = 500.0, 20.0, 5e3


class States:
    """The arm along a stage: x, x' (k, 2) of the tip, and terms of operational space."""

    def __init__(self, run, stage, after):
        rows = np.flatnonzero(run.history.window(stage))[round(after / T) :]
        twin = run.program.context.robot.twin()
        joints = [(plant.joints(run, k), plant.joints(run, k, "velocity")) for k in rows]
        self.x = np.array([twin.tip(q).translation[:2] for q, _ in joints])
        self.rate = np.array([twin.jacobian(q)[:2] @ v for q, v in joints])
        self.terms = [operational_terms(twin, AXES, q) for q, _ in joints]
        self.inertia = np.array([each.inertia for each in self.terms])

    def squared(self, matrix, a, b):
        """(k,) a^T M b, of one matrix (2, 2) or one for each state."""
        return np.einsum("ki,kij,kj->k", a, np.broadcast_to(matrix, self.inertia.shape), b)


def integral(rate):
    """(k,) of a rate from the first tick on."""
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * T)])


@pytest.mark.parametrize("contact", [False, True])
def test_what_pd_loses_is_what_its_damper_takes(simulate, contact):
    """(4.22), (4.23) in free space, (4.28)-(4.30) in contact: V' = -x'^T D_m x', x_d at rest."""
    law = f"{{kind: pd, stiffness: {K_M:g} N/m, damping: {D_M:g} N*s/m}}"
    way = "move: 20 mm, speed: 1 m/s" if contact else "move: -20 mm, speed: 1 m/s"
    run = simulate(
        SQUARE.task(
            law,
            f"go: {{axes: {{x: {{{way}}}, y: {{move: 20 mm, speed: 1 m/s}}}}, time: 4 s}}",
            contact=f"stiffness: {K_E:g} N/m, damping: 0" if contact else None,
        )
    )
    at = States(run, "go", after=0.3)
    error = np.array([run.during("go", f"error.{a}", 0.3) for a in "xy"]).T
    goal = at.x[-1] + error[-1]
    assert np.abs(at.x + error - goal).max() < 1e-9
    V = 0.5 * at.squared(at.inertia, at.rate, at.rate) + 0.5 * K_M * np.sum(error**2, axis=1)
    if contact:
        depth = at.x[:, 0] - SQUARE.surface
        assert depth.min() > 0
        x_E = (K_M * goal[0] + K_E * SQUARE.surface) / (K_M + K_E)
        least = 0.5 * K_M * (goal[0] - x_E) ** 2 + 0.5 * K_E * (SQUARE.surface - x_E) ** 2
        V += 0.5 * K_E * depth**2 - least
    assert V[0] > 1e-4
    taken = integral(D_M * np.sum(at.rate**2, axis=1))
    assert V[0] - V == pytest.approx(taken, abs=SAMPLED * V[0])
    # It comes to its end: x_d in free space, x_E of (4.26) in contact.
    assert abs(V[-1]) < 1e-6 * V[0]


def test_the_function_of_theorem_4_1_falls(simulate):
    """(4.62)-(4.64) and their bounds (4.67), (4.68) where (4.69)-(4.71) hold."""
    k_F, k_I, d_m, n = 0.5, 4.0, 60.0, np.array([-1.0, 0.0])
    law = (
        f"{{kind: parallel-pid, stiffness: {K_M:g} N/m, damping: {d_m:g} N*s/m, "
        f"force: {{proportional: {k_F}, integral: {k_I} /s}}}}"
    )
    run = simulate(
        SQUARE.task(
            law,
            "press: {axes: {x: {force: 10 N}}, time: 3 s}",
            "step: {axes: {x: {force: 12 N, ramp: 0}, y: {force: 0}}, time: 6 s}",
            contact=f"stiffness: {K_E:g} N/m, damping: 0",
        )
    )
    at = States(run, "step", after=0.0)
    x_E = np.array([SQUARE.surface + 12.0 / K_E, (at.x[-1] + [0, run["error.y"][-1]])[1]])
    e, e_rate = x_E - at.x, -at.rate
    # w' = a^T e (4.58), and w is zero at the end.
    along = e @ n
    w = integral(along) - integral(along)[-1]
    largest = max(each.masses()[1] for each in at.terms)
    k_C = max(each.coriolis_bound() for each in at.terms)
    region = np.linalg.norm(e, axis=1).max()
    # (4.69)-(4.71), with the least rho of (4.70) and 1 % more.
    rho = 1.01 * k_I / (1 + k_F)
    assert d_m > rho * (largest + region * k_C)
    assert K_M + rho * d_m > rho**2 * largest
    stiff = (K_M + rho * d_m) * np.eye(2) + (1 + k_F) * K_E * np.outer(n, n)
    V = (
        0.5 * at.squared(at.inertia, e_rate, e_rate)
        + rho * at.squared(at.inertia, e_rate, e)
        + 0.5 * at.squared(stiff, e, e)
        + k_I * K_E * w * along
        + 0.5 * rho * k_I * K_E * w**2
    )
    C = np.array([each.coriolis(v) for each, v in zip(at.terms, at.rate, strict=True)])
    damper = d_m * np.eye(2) - rho * at.inertia
    spring = rho * K_M * np.eye(2) + (rho * (1 + k_F) - k_I) * K_E * np.outer(n, n)
    bend = at.squared(C, e_rate, e)
    rate = -at.squared(damper, e_rate, e_rate) + rho * bend - at.squared(spring, e, e)
    assert V[0] > 1e-4
    assert V.min() > -1e-9 * V[0]
    assert rate.max() <= 0
    # A force that is answered a tick late is a damper of k_F k_e 3/2 T = 3.75 N s/m too few.
    assert V - V[0] == pytest.approx(integral(rate), abs=3.75 / d_m * V[0])
    assert abs(V[-1]) < 1e-3 * V[0]
    # (4.66): rho e'^T C^T e within the bound that Property 4.3 gives.
    bound = region * k_C * np.sum(e_rate**2, axis=1)
    assert (np.abs(bend) <= bound * (1 + 1e-9) + 1e-15).all()
