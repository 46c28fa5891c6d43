"""Section 4.1: what the laws do in the joints: the null space, and springs without a damper."""

from __future__ import annotations

import arm as plant
import numpy as np
import pytest
import sampled
from identify import poles
from presses import SQUARE

SECTION = "4.1 Impedance, PD and stiffness control"

T = 1e-3
FREE = """
taskspec: 1
name: theory
robot: {{model: panda, start: {{joints: [{start}]}}, posture: [{posture}]}}
law: {{kind: pd, stiffness: {{linear: 500 N/m, angular: 60 N*m/rad}}}}
stages:
  fall: {{time: {fall} s}}
{rest}"""
HOME = np.array([0.0, 0.2, 0.0, -1.9, 0.0, 2.1, 0.8])


def joint_list(q):
    return ", ".join(f"{1e3 * value:.12g} mrad" for value in q)


def text(posture, fall, rest=""):
    """panda at rest at `HOME`, drawn towards `posture` by pd."""
    return FREE.format(start=joint_list(HOME), posture=joint_list(posture), fall=fall, rest=rest)


def null_vector(run, q):
    """H (n, n), and z (n,) with J z = 0 and z^T H z = 1."""
    H, J = plant.inertia_and_jacobian(run, q)
    z = np.linalg.svd(J)[2][-1]
    return H, z / np.sqrt(z @ H @ z)


def offset_posture(simulate, far):
    """A posture that the null space alone leads to, `far` [rad] away."""
    run = simulate(text(HOME, 0.01))
    z = null_vector(run, HOME)[1]
    return HOME + far * z / np.linalg.norm(z)


def test_pd_draws_the_null_space_to_its_posture(simulate, prediction):
    """(4.21) leaves the null space alone; the language adds a posture, 2 Hz, critically damped."""
    run = simulate(text(offset_posture(simulate, 0.02), 0.3))
    H, z = null_vector(run, HOME)
    way = np.array([z @ H @ (plant.joints(run, k) - HOME) for k in range(300)])
    goal = z @ H @ (np.array(run.program.context.posture) - HOME)
    w = 2 * np.pi * 2
    # One semi-implicit Euler step per period.
    e, v, left = goal, 0.0, []
    for _ in range(300):
        left.append(e)
        v += T * (w**2 * e - 2 * w * v)
        e -= T * v
    for k in (100, 250):
        prediction(
            f"way left in the null space after {k} ms", "(4.21), posture, sampled",
            "pd, panda, 20 mrad away from its posture", left[k] / goal, 1 - way[k] / goal,
            rtol=5e-3, because="the null space turns by 20 mrad over the way",
        )  # fmt: skip
    moved = max(np.ptp(run[f"position.{a}"]) for a in "xyz")
    prediction(
        "tip's way meanwhile [mm]", "(I - J̄J) q̈", "pd, panda, 20 mrad away from its posture",
        0.0, 1e3 * moved, atol=5e-3,
        because="the joints move by 20 mrad of a self-motion with a radius of 0.3 m, whose "
        "centripetal rest C q' pd does not compensate: (0.09 rad/s)^2 0.3 m / (500 N/m / 3 kg)",
    )  # fmt: skip


def test_joint_damping_stops_the_null_space(simulate, prediction):
    """(4.31): springs do no work on the null space, whose momentum z^T H q' is braked alone."""
    damping = 3.0
    law = (
        "{kind: pd-joint, stiffness: {linear: 500 N/m, angular: 60 N*m/rad}, "
        f"damping: {damping} N*m*s/rad}}"
    )
    posture = offset_posture(simulate, 0.02)
    run = simulate(text(posture, 0.08, f"  stop: {{law: {law}, time: 10 s}}"))
    # Once the torque that pd has handed over is faded out, at 1000 N m/s from less than 50 N m.
    first = int(np.argmax(run.history.window("stop"))) + 50
    q, v = plant.joints(run, first), plant.joints(run, first, "velocity")
    H, z = null_vector(run, q)
    case = "pd-joint, panda, 3 N·m·s/rad, pushed in the null space by pd"
    # The damper acts on the velocity before each step, the way is made with the one after it.
    way = plant.joints(run, -1) - q + T * v
    prediction(
        "z^T D_q (way), of the momentum z^T H q̇ at first", "(4.31), sampled", case,
        1.0, float(damping * (z @ way) / (z @ H @ v)),
        rtol=2e-3, because="z turns by 4 mrad while the arm stops",
    )  # fmt: skip
    last = float(np.max(np.abs(plant.joints(run, -1, "velocity"))))
    prediction(
        "joint speed after 10 s [mrad/s]", "(4.31)", case, 0.0, 1e3 * last, atol=1e-3,
        because="the slowest mode, -2.3 1/s, leaves e^-23 of 90 mrad/s",
    )  # fmt: skip


@pytest.mark.parametrize("axis", ["x", "y"])
def test_stiffness_control_rings_by_itself(simulate, prediction, axis):
    """(4.33) without a damper: |z| = 1, the springs and the arm's mass alone."""
    run = simulate(
        SQUARE.task(
            "{kind: stiffness, stiffness: 500 N/m}",
            f"go: {{axes: {{{axis}: {{move: 5 mm, speed: 50 mm/s}}}}, time: 3 s}}",
            contact=None,
            more="balanced: true",
        )
    )
    loop = plant.loop(run, "x y", axis, -1)
    i = "xy".index(axis)
    own = sampled.Loop(loop.inertia[i : i + 1, i : i + 1], 0, 0.0, 0.0, 0.0)
    law = sampled.springs(np.array([500.0]), np.zeros(1))
    predicted = next(s for s in own.poles(law) if s.imag > 0)
    rest = run.during("go", f"error.{axis}", 0.5, 3.0)
    measured = poles(rest, 2, T, round(2 * np.pi / abs(predicted) / T / 10))[0]
    case = f"stiffness, planar2, {axis}, 500 N/m, no joint damping"
    prediction(
        "ω [rad/s]", "(4.33), sampled", case, abs(predicted), abs(measured), rtol=3e-3,
        because="Λ changes by 0.3 % over the 0.7 mm that it rings with",
    )  # fmt: skip
    prediction(
        "decay [1/s]", "(4.33), sampled", case, 0.0, -measured.real, atol=0.01,
        because="semi-implicit Euler keeps the energy; what is left is the fit's own error, a "
        "thousandth of ω",
    )  # fmt: skip


def test_stiffness_control_settles_with_joint_damping(simulate, prediction):
    """(4.33) on joints with dampers of their own, which MuJoCo's Euler step takes implicitly."""
    damping = np.array([0.6, 0.2])
    run = simulate(
        SQUARE.task(
            "{kind: stiffness, stiffness: 500 N/m}",
            "go: {axes: {x: {move: 5 mm, speed: 50 mm/s}}, time: 3 s}",
            contact=None,
            more="balanced: true, joint_damping: [0.6 N*m*s/rad, 0.2 N*m*s/rad]",
        )
    )
    H, J = plant.inertia_and_jacobian(run, plant.joints(run, -1))
    D, K = np.diag(damping), J[:2].T @ (500.0 * J[:2])
    step = np.linalg.inv(H + T * D)
    v_next = np.hstack([-T * step @ K, np.eye(2) - T * step @ D])
    z = np.linalg.eigvals(
        np.vstack([np.hstack([np.eye(2), np.zeros((2, 2))]) + T * v_next, v_next])
    )
    s = np.log(z.astype(complex)) / T
    slow = min((pole for pole in s if pole.imag > 0), key=abs)
    measured = poles(run.during("go", "error.x", 0.5, 2.5), 4, T, 20)
    found = min((pole for pole in measured if pole.imag > 0), key=lambda p: abs(p - slow))
    case = "stiffness, planar2, 500 N/m, joints damped by 0.6 and 0.2 N·m·s/rad"
    prediction(
        "ω [rad/s]", "(4.33), sampled", case, abs(slow), abs(found), rtol=3e-3,
        because="Λ changes by 0.3 % over the 0.7 mm that it rings with",
    )  # fmt: skip
    prediction(
        "decay [1/s]", "(4.33), sampled", case, -slow.real, -found.real, rtol=3e-3,
        because="Λ changes by 0.3 % over the 0.7 mm that it rings with",
    )  # fmt: skip
