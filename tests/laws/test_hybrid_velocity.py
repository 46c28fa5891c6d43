"""Velocities of `hybrid-velocity` under constraints, against a formulation of its own."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from law_cases import as_reference, command_of, gains_on
from test_equations import AXES, Arm, task_state

from taskspec.laws.multipliers import Multipliers

RNG = np.random.default_rng(11)


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_constraints_decide_their_coordinates_and_leave_the_others(robot):
    """J_z q' and an equation n'J q' by their force loops, all other axes and inner motion kept.

    The reference is one linear system: the constraints, the axes that they do not decide, and what
    of the motion is in the null space.
    """
    arm, axes = Arm(robot), AXES[robot]
    task, n, m = task_state(arm, axes), arm.n, len(axes)
    normal, e, rate = RNG.normal(size=m), RNG.normal(size=m) * 1e-2, RNG.normal(size=m)
    carried, wanted, measured, integral = (RNG.normal(size=2) for _ in range(4))
    w, p, i, d = 12.0, 0.8, 2.5, RNG.uniform(100, 900, 2)
    J_phi = ca.vertcat(task.J[2, :], ca.DM(normal).T @ task.J)
    inverse = ca.inv(arm.terms.H)
    bar = inverse @ task.J.T @ ca.inv(task.J @ inverse @ task.J.T)
    posture = ca.DM(RNG.normal(size=n)) if n > m else None
    names = ("z", "rim")
    on = Multipliers(
        names=names,
        J=J_phi,
        gamma=ca.SX(2, 1),
        directions=bar[:, [2, 0]],
        closing=J_phi @ arm.v + ca.DM(carried),
        desired=-ca.SX(wanted),
        measured=-ca.SX(measured),
        integral=-ca.SX(integral),
        held=ca.SX.zeros(n),
    )
    gains = gains_on(axes, K_V=w) | gains_on(
        names, force__proportional=p, force__integral=i, force__damping=d
    )
    found = command_of(
        "hybrid-velocity",
        task,
        as_reference(e, rate, 0 * rate),
        gains,
        arm.v,
        constraints=on,
        posture=posture,
    ).joint_velocity
    for _ in range(5):
        values = arm.random()
        z, J, phi, J_bar = arm([found, task.J, J_phi, bar], values)
        into = (p * (wanted - measured) + i * integral) / d - carried
        keeps = [k for k in range(m) if k not in (2, 0)]
        inner = np.eye(n) - J_bar @ J
        moved = np.zeros(n) if posture is None else np.array(posture).ravel()
        A = np.vstack([phi, J[keeps], inner])
        b = np.concatenate([into, (rate + w * e)[keeps], inner @ moved])
        x, *_ = np.linalg.lstsq(A, b, rcond=None)
        np.testing.assert_allclose(A @ x, b, atol=1e-9)
        np.testing.assert_allclose(z, x, rtol=1e-10, atol=1e-10)
