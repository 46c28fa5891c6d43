"""Velocities of laws under constraints and limits, against formulations of their own."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import daqp
import numpy as np
import pytest
from law_cases import as_reference, command_of, gains_on
from random_states import States
from test_equations import AXES, Arm, task_state

from taskspec.compiler import compile_unchecked
from taskspec.control.servo import Following, ServoReference, excursions, transition
from taskspec.laws.multipliers import Multipliers
from taskspec.program.limits.bounds import COMMAND, JOINT, VELOCITY_SHARE
from taskspec.spec import load_text
from taskspec_runner.trial.trial import trial

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
    bar = ca.pinv(task.J) if n == m else None
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


FREE = """\
taskspec: 1
name: free
robot: {{model: panda, command: {command}, start: {{xyz: [500 mm, 0, 400 mm]}}, servo: {servo}}}
law: {{kind: {law}, solve: qp}}
stages: {{go: {{axes: {axes}, time: {time}}}}}
{more}"""
TURNS = {
    "command": "velocity",
    "servo": "panda",
    "axes": "{rz: {velocity: 60 deg/s}}",
    "time": "3 s",
    "more": "limits: {speed: 100 mm/s}\n",
}


@pytest.mark.parametrize("law", ["admittance", "force-velocity", "hybrid-velocity"])
def test_the_answer_is_that_of_a_program_in_the_velocities_themselves(law):
    """min of the twist's change and of inner motion's, within bounds that are written out here."""
    states = States(FREE.format(law=law, **(TURNS | {"more": ""})), seed=3)
    drives, T = states.context.drives, states.context.period
    loop, tried = drives.loop, 0
    fastest, lag = VELOCITY_SHARE * drives.most, 3 * (loop.delay + 1 / loop.w)
    assert {row.kind for row in states.stage.resolution.rows} == {COMMAND, JOINT}
    for k in range(60):
        states.draw_present(turned=0.6, fast=0.3, force=30.0)
        last = np.clip(states.torque, -1, 1) + states.rng.uniform(-1, 1, 7) * 0.02
        states.runner.remember(last, last)
        states.evaluate()
        if states.violation <= 1e-9:
            continue
        wish = states.torque.copy()
        assert states.solver.resolve()
        if states.solver.counts.relaxed:
            states.solver.counts.relaxed = 0
            continue
        q, share = states.machine.q, 1 - np.exp(-T * loop.w / (2 * loop.ratio))
        low, high = (
            last + np.clip(share * (end - last), -T * drives.rates, T * drives.rates)
            for end in (-fastest, fastest)
        )
        for side, room in ((1, states.robot.upper - 1e-3 - q), (-1, q - states.robot.lower - 1e-3)):
            a, inside = drives.rates, np.maximum(room, 0)
            reach = np.minimum(a * (np.sqrt(lag**2 + 2 * inside / a) - lag), fastest)
            reach += np.maximum(np.minimum(room, 0) / lag, -fastest)
            low, high = (
                (low, np.minimum(high, reach)) if side > 0 else (np.maximum(low, -reach), high)
            )
        _, inertia, *_, J = (np.array(x) for x in (0, *matrices(states)))
        twist = np.diag([1, 1, 1, 0.3, 0.3, 0.3]) @ J
        Lambda = np.linalg.inv(J @ np.linalg.solve(inertia, J.T))
        P = twist.T @ twist + 1e-2 * (inertia - J.T @ Lambda @ J)
        x, _, flag, _ = daqp.solve(P, -P @ wish, np.eye(7), high, low, np.zeros(7, dtype=np.int32))
        assert flag == 1
        np.testing.assert_allclose(states.torque, x, atol=1e-7)
        tried += 1
    assert tried > 15


def matrices(states: States) -> tuple[np.ndarray, np.ndarray]:
    """H (n, n) and J (6, n) of the tip, by Pinocchio."""
    twin, q = states.robot.twin(), states.machine.q
    return twin.inertia(q), twin.jacobian(q)


@lru_cache
def run(**given: str):
    """A run to its end, whatever its verdicts."""
    return trial(compile_unchecked(load_text(FREE.format(**(TURNS | given)), "free.yaml")))


@pytest.mark.parametrize("command", ["velocity", "position"])
def test_limits_are_kept_by_a_run_that_presses_against_them(command):
    found = run(command=command, law="hybrid-velocity")
    robot, T = found.program.context.robot, found.program.context.period
    servo = found.program.context.loaded.task.robot.servo

    def joints(name: str) -> np.ndarray:
        return np.column_stack([found.history[f"joint.{k + 1}.{name}"] for k in range(7)])

    q, v, reference = joints("position"), joints("velocity"), joints("position.servo")
    assert (q > robot.lower).all()
    assert (q < robot.upper).all()
    assert (robot.upper - q).min() < 5e-3 or (q - robot.lower).min() < 5e-3
    assert (np.abs(v) < robot.velocity_limit).all()
    assert np.max(found.history["speed"]) < 0.1
    acceleration, jerk = (np.diff(reference, k, axis=0) / T**k for k in (2, 3))
    assert (np.abs(acceleration) <= 1.001 * np.array(servo.acceleration)).all()
    assert (np.abs(jerk) <= 1.001 * np.array(servo.jerk)).all()
    assert np.abs(jerk / np.array(servo.jerk)).max() > 0.3


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_excursions_are_what_the_worst_commands_make_of_a_reference(ratio):
    """Commands that turn round as the answer to one of them does come to it, and none beyond."""
    w, h, ticks = 2 * np.pi * 30, 1e-3, 2
    acceleration, jerk = excursions(w, ratio, h, ticks)
    r, q, v, a, z = (ca.SX.sym(name) for name in "rqvaz")
    free = Following(w, ratio, h, ca.DM(transition(w, ratio, h)), *[ca.DM(np.inf)] * 3)
    after = free.after(ServoReference(r, q, v, a), z, positions=False)
    step = ca.Function("step", [r, q, v, a, z], [after.r, after.q, after.v, after.a])

    def answer(changes: np.ndarray) -> np.ndarray:
        state, z, found = [ca.DM(0)] * 4, 0.0, []
        for change in changes:
            z += change * ticks * h
            for _ in range(ticks):
                state = step(*state, z)
                found.append(float(state[3]))
        return np.array(found)

    one = answer(np.array([1.0, *np.zeros(150)]))
    for shape, most in ((one, acceleration), (np.diff(one, prepend=0) / h, jerk)):
        late = np.abs(shape).reshape(-1, ticks).sum(axis=0).argmax()
        worst = answer(np.sign(shape.reshape(-1, ticks)[::-1, late]))
        reached = worst if most == acceleration else np.diff(worst, prepend=0) / h
        assert np.abs(reached).max() == pytest.approx(most, rel=1e-3)
    wild = answer(RNG.choice([-1.0, 1.0], 300))
    assert np.abs(wild).max() <= acceleration * (1 + 1e-9)
