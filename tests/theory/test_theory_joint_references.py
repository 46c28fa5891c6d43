"""Section 4.3.2 with joint references: q_d(t) and u_phi,d(t) of (4.101) on an ideal rail.

The arm is planar2 on the rail x = c. With q_2 for q2 the chapter's psi is explicit:
c = 2 l cos(q2/2) cos(q1 + q2/2) gives q1 = psi(q2) = arccos(c/(2 l cos(q2/2))) - q2/2, so that T,
theta and the law of (4.117) can be written down as they stand.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from rigid import Arm, run_rigid

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text

SECTION = "4.3.2 Hybrid control of multipliers"
T = 1e-3
#: Length of both links, and where the rail is [m].
LINK, RAIL = 0.3, 0.4
#: What the robot applies along the normal of the rail [N].
PUSH = 20.0
#: q2 against time [rad]; q1 moves the arm across the rail more than q2 does all the while, so that
#: it is the coordinate that yields.
BENT, SWING, PERIOD = np.radians(30.0), np.radians(12.0), 1.0
K_P, K_D = (2 * np.pi * 5.0) ** 2, 2 * (2 * np.pi * 5.0)

Q2 = f"({BENT} rad + {SWING} rad*(1 - cos(2*pi*t/({PERIOD} s))))"
#: A q1 that keeps the rail, with what may be added to it.
Q1 = f"acos({RAIL}/(2*{LINK}*cos({Q2}/2))) - {Q2}/2 + {{off}}"
#: J_phi^T times the push.
TORQUES = tuple(
    torque.format(q1=f"({Q1.format(off='0 rad')})", both=f"({Q1.format(off='0 rad')} + {Q2})")
    for torque in (
        f"-{PUSH} N*({LINK} m*sin({{q1}}) + {LINK} m*sin({{both}}))",
        f"-{PUSH} N*{LINK} m*sin({{both}})",
    )
)
TASK = """taskspec: 1
robot: {{model: planar2, start: {{joints: [{start} rad, {bent} rad]}}}}
world: {{rail: {{equation: "x = {rail} m"}}}}
law: {{kind: {law}, force: {{{gains}}}}}
stages:
  slide:
    constraints: {{rail: {{generalised: ["{u1}", "{u2}"], ramp: 0}}}}
    path: {{joints: ["{q1}", "{q2}"], time: 2 s}}
"""


def psi(q2):
    """q1 on the rail."""
    return ca.acos(RAIL / (2 * LINK * ca.cos(q2 / 2))) - q2 / 2


@lru_cache
def program(law="hybrid-multipliers", *, off=0.0, torques=TORQUES, gains="proportional: 0"):
    if law == "hybrid-multipliers":
        gains = f"{gains}, integral: 0"
    text = TASK.format(
        law=law, gains=gains, rail=RAIL, bent=BENT, start=float(psi(BENT)),
        u1=torques[0], u2=torques[1], q1=Q1.format(off=f"{off} rad"), q2=Q2,
    )  # fmt: skip
    return compile_unchecked(load_text(text, "task.yaml"))


@lru_cache
def chapter():
    """(4.117) without its force part, H and C q' + g given: (q, q', t, H, n) -> u, lambda_d."""
    q, v, t = ca.SX.sym("q", 2), ca.SX.sym("v", 2), ca.SX.sym("t")
    H, bias = ca.SX.sym("H", 2, 2), ca.SX.sym("bias", 2)
    x, dx = ca.SX.sym("x", 2), ca.SX.sym("dx", 2)
    theta = ca.Function("theta", [x], [ca.vertcat(x[0] - psi(x[1]), x[1])])
    slope = ca.jacobian(psi(x[1]), x[1])
    matrix = ca.blockcat([[1, slope], [0, 1]])
    T_of = ca.Function("T", [x], [matrix])
    along = ca.jtimes(ca.vec(matrix), x, dx)
    T_rate = ca.Function("T_rate", [x, dx], [ca.reshape(along, 2, 2)])
    q2_d = BENT + SWING * (1 - ca.cos(2 * ca.pi * t / PERIOD))
    q_d = ca.vertcat(psi(q2_d), q2_d)
    v_d = ca.jacobian(q_d, t)
    a_d = ca.jacobian(v_d, t)
    here, there = ca.inv(T_of(q)), ca.inv(T_of(q_d))
    E_2 = ca.DM([[0, 1]])
    # theta''_d, theta'_d and theta_d of (4.114)-(4.116).
    wanted = there @ (a_d - T_rate(q_d, v_d) @ there @ v_d)
    wanted += E_2.T @ (K_P * E_2 @ (theta(q_d) - theta(q)))
    wanted += E_2.T @ (K_D * E_2 @ (there @ v_d - here @ v))
    motion = H @ T_of(q) @ wanted + H @ T_rate(q, v) @ here @ v + bias
    tip = LINK * (ca.cos(x[0]) + ca.cos(x[0] + x[1]))
    gradient = ca.Function("J", [x], [ca.jacobian(tip, x)])
    return ca.Function("chapter", [q, v, t, H, bias], [motion, gradient(q), gradient(q_d), q_d])


CASE = "planar2 on a rail, q_d(t) and u_φd(t) given"


def kicked(t):
    """A torque along the rail [N m] for 20 ms, which gives e_2 a start."""
    return np.array([60.0, 60.0]) * (0.1 <= t < 0.12)


def test_the_torque_is_that_of_the_chapter(prediction):
    """(4.117), written down with the chapter's T and theta, at every tick of a disturbed run."""
    compiled = program()
    run = run_rigid(compiled, 1.0, disturbance=kicked)
    arm, law = Arm(compiled), chapter()
    worst = 0.0
    for t, q, v, u in zip(run.t, run.q, run.v, run.u, strict=True):
        H, bias = arm.dynamics(q, v)
        motion, J, J_d, _ = (np.array(x) for x in law(q, v, t, H, bias))
        lambda_d = (J_d @ (J_d[0] * PUSH) / (J_d @ J_d.T)).item()
        # In the theory's sign the multiplier is what the rail exerts: minus lambda_d.
        worst = max(worst, float(np.abs(u - (motion.ravel() + J[0] * lambda_d)).max()))
    assert np.abs(run.outputs["joint_ref"] - run.q).max() > 1e-3
    prediction(
        "greatest difference of the torque [N·m]", "(4.114)-(4.117)", CASE, 0.0, worst, atol=1e-9,
        because="the same law in other coordinates; double precision",
    )  # fmt: skip


@pytest.mark.parametrize("law", ["hybrid-multipliers", "hybrid-reaction"])
def test_the_multiplier_of_the_torques_is_reached(prediction, law):
    """(4.102), (4.103): u_phi,d = J_phi^T lambda_d is had at once, and nothing is left of it."""
    run = run_rigid(program(law), 1.0)
    prediction(
        "greatest λ − λ_d [N]", "(4.103), (4.113)", f"{CASE}, {law}", 0.0,
        np.abs(run.force[:, 0] - PUSH).max(), atol=1e-8,
        because="the model is exact; double precision",
    )  # fmt: skip
    prediction(
        "greatest residual u_φd − J_φᵀ λ_d [N·m]", "(4.102)", f"{CASE}, {law}", 0.0,
        run.outputs["reaction_residual"].max(), atol=1e-10, because="double precision",
    )  # fmt: skip
    prediction(
        "greatest φ(q_d) [m]", "(4.101)", f"{CASE}, {law}", 0.0,
        np.abs(run.outputs["gap_ref"]).max(), atol=1e-10, because="double precision",
    )  # fmt: skip


def test_torques_that_do_not_fit_are_projected(prediction):
    """The residual is that of the projection on J_phi(q_d), and its part along that is had."""
    run = run_rigid(program(torques=("2 N*m + 0 N*m*t/(1 s)", "3 N*m")), 1.0)
    u, law = np.array([2.0, 3.0]), chapter()
    left, wanted = [], []
    for t, q, v in zip(run.t, run.q, run.v, strict=True):
        J = np.array(law(q, v, t, np.eye(2), np.zeros(2))[2])
        made = np.linalg.lstsq(J.T, u, rcond=None)[0]
        left.append(np.linalg.norm(u - J.T @ made))
        wanted.append(made.item())
    assert min(left) > 0.5
    case = "planar2 on a rail, u_φd = (2, 3) N·m"
    prediction(
        "greatest difference of the residual from NumPy's [N·m]", "(4.102), (4.103)", case, 0.0,
        np.abs(run.outputs["reaction_residual"][:, 0] - left).max(), atol=1e-10,
        because="double precision",
    )  # fmt: skip
    prediction(
        "greatest λ − λ_d [N]", "(4.103)", case, 0.0, np.abs(run.force[:, 0] - wanted).max(),
        atol=1e-8, because="the model is exact; double precision",
    )  # fmt: skip


def sampled(x, v, ticks):
    """e_2 with its acceleration held for a period, from e_2 = x and its rate v."""
    found = []
    for _ in range(ticks):
        found.append(x)
        a = -K_D * v - K_P * x
        x, v = x + T * v + T**2 / 2 * a, v + T * a
    return np.array(found)


@pytest.mark.parametrize("off", [0.0, 0.05])
def test_the_free_joint_goes_by_its_gains(prediction, off):
    """(4.109) in q2, whether or not q_d keeps the rail; q1 is what the rail makes of it."""
    run = run_rigid(program(off=off), 0.6, disturbance=kicked)
    e = run.outputs["joint_ref"][:, 1] - run.q[:, 1]
    after = 121
    turned = 2 * np.pi / PERIOD * after * T
    rate = SWING * 2 * np.pi / PERIOD * np.sin(turned) - run.v[after, 1]
    predicted = sampled(e[after], rate, 200)
    case = f"planar2 on a rail, a push along it; q1d {off:g} rad off the rail; 5 Hz, ζ = 1"
    for k in (20, 50, 100):
        prediction(
            f"e₂ {k} ms after the push [mrad]", "(4.109), sampled", case, 1e3 * predicted[k],
            1e3 * float(e[after + k]), rtol=0.02,
            because="the torque is held for a tick, in which the arm moves on",
        )  # fmt: skip
    prediction(
        "greatest q₁ − ψ(q₂) [rad]", "(4.111)", case, 0.0,
        max(abs(float(psi(q2)) - q1) for q1, q2 in run.q), atol=1e-10, because="the rail is ideal",
    )  # fmt: skip
    prediction(
        "greatest φ(q_d) [m]", "(4.101)", case,
        float(np.abs(gap(off)).max()) if off else 0.0, np.abs(run.outputs["gap_ref"][300:]).max(),
        **({"rtol": 1e-6} if off else {"atol": 1e-10}), because="the same function of q_d",
    )  # fmt: skip


def gap(off):
    """Distance of q_d from the rail from 0.3 s to 0.6 s, (300,) [m]."""
    t = 0.3 + T * np.arange(300)
    q2 = BENT + SWING * (1 - np.cos(2 * np.pi * t / PERIOD))
    q1 = np.array(psi(ca.DM(q2))).ravel() + off
    return LINK * (np.cos(q1) + np.cos(q1 + q2)) - RAIL
