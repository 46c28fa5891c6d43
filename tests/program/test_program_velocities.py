"""Limits under laws that command velocities, against bounds and programs that are written out."""

from __future__ import annotations

import casadi as ca
import daqp
import numpy as np
import pytest
from random_states import States

from taskspec.control.servo import Following, ServoReference, excursions, transition
from taskspec.program.drives import VELOCITY_FADING
from taskspec.program.limits.bounds import COMMAND, JOINT, VELOCITY_SHARE
from taskspec.program.stages.carried_torque import carrying

RNG = np.random.default_rng(11)

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
    "axes": "{rz: {velocity: 100 deg/s}, y: {position: 30 mm * sin(2*pi*t/(1 s))}}",
    "time": "2.6 s",
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
    for _ in range(60):
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
        inertia, J = matrices(states)
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


@pytest.mark.parametrize("command", ["velocity", "position"])
def test_limits_are_kept_by_a_run_that_presses_against_them(simulate, command):
    """Joint 7 comes to its limit, joints are as fast as they may be, the servo limits nothing."""
    found = simulate(FREE.format(**(TURNS | {"command": command, "law": "hybrid-velocity"})))
    context = found.program.context
    robot, T, servo = context.robot, context.period, context.loaded.task.robot.servo

    def joints(name: str) -> np.ndarray:
        return np.column_stack([found[f"joint.{k + 1}.{name}"] for k in range(7)])

    q, v, reference = joints("position"), joints("velocity"), joints("position.servo")
    assert (q > robot.lower).all()
    assert (q < robot.upper).all()
    assert (robot.upper - q).min() < 5e-3 or (q - robot.lower).min() < 5e-3
    assert (np.abs(v) < robot.velocity_limit).all()
    assert 0.095 < np.max(found["speed"]) < 0.1
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


@pytest.mark.parametrize("bound", [np.inf, 10.0])
def test_what_the_last_stage_commanded_fades_within_half_a_period_of_the_bandwidth(bound):
    """Or, where the joint with most of it would change by more than the bound, as fast as that."""
    carry = carrying(2, bound, 20.0 / VELOCITY_FADING)
    for last, time in (([0.1, 0.01], 0.025), ([-1.0, 0.5], 0.025 if np.isinf(bound) else 0.1)):
        step, rate, most = (np.array(each).ravel() for each in carry(last, [0.0, 0.0]))
        assert list(step) == last
        assert most == pytest.approx(max(np.abs(last)))
        assert 1 / rate == pytest.approx(time)
    assert not np.any([*map(float, carry([1.0, 1.0], [1.0, 1.0])[1:])])
