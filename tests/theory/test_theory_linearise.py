"""The compiled stages as sampled linear systems, against models that are written down by hand.

Both are the same mathematics, made in two ways: their numbers agree to rounding where the hand-made
model has everything, and to what it leaves out where it has not.
"""

from __future__ import annotations

from types import SimpleNamespace

import arm as plant
import numpy as np
import pytest
import sampled
from presses import ARMS, PANDA, SQUARE

from sensors import RunningSensor
from taskspec.program.plan import StagePlan
from taskspec.program.prepare import prepare
from taskspec.program.sensor import SensorModel
from taskspec.program.stages.stage import compile_stage
from taskspec.spec import load_text
from taskspec.stability.controller import Operating
from taskspec.stability.loop import one_step
from taskspec.stability.sampled_stage import analyse

T = 1e-3
#: Bisected to 1e-6; the poles move with eps^(1/2) at worst.
EXACT = 1e-5


class Start(SimpleNamespace):
    """What `arm.loop` wants of a run, at the start pose."""

    def __getitem__(self, column):
        return [self.context.start[int(column.split(".")[1]) - 1]]

    @property
    def program(self):
        return self


def press(arm, law, *, contact, more="", rest="", force="15 N"):
    text = arm.task(
        law,
        f"press: {{axes: {{N: {{force: +{force}}}}}, time: 1 s}}",
        contact=contact,
        more=more,
        rest=rest,
    )
    return prepare(load_text(text, "press.yaml"))


def loop_of(context, arm):
    return plant.loop(Start(context=context), arm.axes, arm.normal)


def radius(analysed):
    """Spectral radius of the modes that are not neutral."""
    return max(abs(mode.z) for mode in analysed.modes())


def parallel_text(h, d, k, k_F, k_I):
    return (
        f"{{kind: parallel, mass: {h} kg, damping: {d} N*s/m, stiffness: {k} N/m, "
        f"force: {{proportional: {k_F}, integral: {k_I:.9g} /s}}}}"
    )


#: arm, h_m, d_m, k_m, k_F, k_e [kN/m], plant rate [kHz], largest k_I by hand where it is known
CRITICAL = [
    ("panda", 1, 40, 400, 0.5, 10, 1, 20.63),
    ("planar2", 1, 90, 500, 1.0, 80, 1, 38.78),
    ("planar2", 1, 90, 500, 1.0, 80, 5, None),
    ("planar3", 2, 60, 300, 0.2, 20, 1, None),
    ("ur5e", 1.5, 70, 400, 0.8, 15, 2, None),
]


@pytest.mark.parametrize(("name", "h", "d", "k", "k_F", "k_e", "rate", "known"), CRITICAL)
def test_critical_integral_of_the_parallel_law(name, h, d, k, k_F, k_e, rate, known):
    """(4.36): the gain at which the force begins to ring."""
    arm = ARMS[name]
    rest = f"control: {{rate: 1 kHz, plant_rate: {rate} kHz}}\n"

    def task(k_I):
        contact = f"stiffness: {k_e} kN/m, damping: 0"
        return press(arm, parallel_text(h, d, k, k_F, k_I), contact=contact, rest=rest)

    loop = loop_of(task(1), arm).core()
    hand = sampled.critical(
        lambda i: loop.radius(sampled.parallel(loop, h, d, k, k_F, i)) < 1, 1, 200, 1e-6
    )
    # Within ten times the tolerance.
    found = sampled.critical(
        lambda i: radius(analyse(compile_stage(StagePlan(task(i), "press")))) < 1,
        (1 - 10 * EXACT) * hand, (1 + 10 * EXACT) * hand, 1e-6,
    )  # fmt: skip
    assert found == pytest.approx(hand, rel=EXACT)
    if known is not None:
        assert found == pytest.approx(known, rel=5e-4)


@pytest.mark.parametrize("name", ["planar2", "panda"])
def test_poles_of_a_hybrid_force_axis(name):
    """Section 4.3.3: all poles of the normal axis, and of no other."""
    arm, n = ARMS[name], ARMS[name].normal
    law = (
        f"{{kind: hybrid, force: {{proportional: {{{n}: 0.3}}, integral: {{{n}: 5 /s}}, "
        f"damping: {{{n}: 100 N*s/m}}}}}}"
    )
    context = press(arm, law, contact="stiffness: 5 kN/m, damping: 20 N*s/m")
    loop = loop_of(context, arm).core()
    hand = loop.poles(sampled.hybrid(0.3, 5, 100))
    hand = hand[(hand.imag >= 0) & (hand.real > -2000)]
    mine = np.array(
        [mode.s for mode in analyse(compile_stage(StagePlan(context, "press"))).modes()]
    )
    for pole in hand:
        assert np.min(np.abs(mine - pole)) < 1e-6 * abs(pole)


def test_the_pid_regulator_couples_the_axes():
    """(4.50) on planar3: the springs of one axis move the others; all poles at once."""
    arm, k_m, d_m = ARMS["planar3"], 400.0, 60.0
    law = (
        f"{{kind: parallel-pid, stiffness: {{linear: {k_m} N/m, angular: 20 N*m/rad}}, "
        f"damping: {{linear: {d_m} N*s/m, angular: 2 N*m*s/rad}}, "
        "force: {proportional: 0.5, integral: 2 /s}}"
    )
    # The ball of the tool is so small that the force passes through the tip, as the model has it.
    context = press(arm, law, contact="stiffness: 8 kN/m, damping: 0", more="tool: {radius: 1 um}")
    loop = loop_of(context, arm)
    hand = loop.poles(
        sampled.parallel_pid(np.array([k_m, k_m, 20.0]), np.array([d_m, d_m, 2.0]), 0.5, 2.0)
    )
    hand = hand[(hand.imag >= 0) & (hand.real > -2000)]
    mine = np.array(
        [mode.s for mode in analyse(compile_stage(StagePlan(context, "press"))).modes()]
    )
    for pole in hand:
        assert np.min(np.abs(mine - pole)) < 1e-4 * abs(pole)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_rigid_contact_and_delay(delay):
    """z^(d+1) - z^d + (K + K_I T) z - K = 0 decides, d one tick more than the sensor's delay."""
    rest = "control: {rate: 1 kHz, plant_rate: 20 kHz}\n"
    more = f"sensor: {{delay: {delay} ms}}"
    d = 1 + delay

    def stable(p):
        law = (
            f"{{kind: hybrid, force: {{proportional: {p:.9g}, integral: 50 /s, "
            "damping: 30 N*s/m}}"
        )
        context = press(SQUARE, law, contact="stiffness: rigid", more=more, rest=rest)
        return radius(analyse(compile_stage(StagePlan(context, "press")))) < 1

    def by_hand(K):
        K_I = 50 * T
        polynomial = np.zeros(d + 2)
        polynomial[0], polynomial[1] = 1, -1
        polynomial[-2] += K + K_I
        polynomial[-1] -= K
        return max(abs(np.roots(polynomial))) < 1

    hand = sampled.critical(by_hand, 0.01, 2, 1e-6)
    # The contact keeps 0.45 % of the tick before (test_theory_sampling_rigid), and the damper
    # takes its part of the first tick.
    found = sampled.critical(stable, 0.95 * hand, 1.05 * hand, 1e-3)
    assert found == pytest.approx(hand, rel=1e-2)


@pytest.mark.parametrize(
    "sensor", ["", "filter: 60 Hz", "delay: 3 ms", "rate: 250 Hz, filter: 80 Hz, delay: 2 ms"]
)
def test_the_sensor_is_that_of_the_run(sensor):
    """Tick by tick with the run's own sensor, the closed loop goes where its matrix says."""
    law = "{kind: impedance, mass: 0.6 kg, stiffness: 100 N/m, damping: 40 N*s/m}"
    context = press(
        SQUARE, law, contact="stiffness: 1 kN/m, damping: 0", more=f"sensor: {{{sensor}}}"
    )
    seen = analyse(compile_stage(StagePlan(context, "press")))
    linear, A, B = seen.controller, *seen.plant().step()
    model = SensorModel.of(context.loaded.task.robot.sensor, T)
    running, ticks = RunningSensor(model, np.zeros(6)), 8 * model.hold_ticks
    state, wrench, memory = np.array([1e-3, 2e-3, 0.1, -0.2]), np.zeros(6), np.zeros(0)
    for _ in range(ticks):
        measured = np.concatenate([state, running.step(wrench), memory])
        out = A @ state + B @ (linear.torque @ measured)
        memory = linear.memory @ measured
        state, wrench = out[:4], out[4:10]
    first = one_step(linear, seen.plant(), model, samples=True)
    held = one_step(linear, seen.plant(), model, samples=False)
    x = np.zeros(len(first))
    x[:4] = 1e-3, 2e-3, 0.1, -0.2
    for k in range(ticks):
        x = (first if k % model.hold_ticks == 0 else held) @ x
    assert x[:4] == pytest.approx(state, rel=1e-9, abs=1e-12)


def test_derivative_against_differences():
    """The derivative along q', wrench and memory is that of the closed form itself."""
    context = press(PANDA, "hybrid", contact="stiffness: 5 kN/m, damping: 20 N*s/m")
    plan = StagePlan(context, "press")
    assert plan.path is None
    at = Operating(context, compile_stage(plan))
    at.press(np.array([0.1, 0.2, 15.0, 0.0, 0.0, 0.0]), np.zeros(0))
    linear, n = at.linear(), context.robot.pin.nv

    def torque(v, wrench, memory):
        arguments = list(at._arguments)
        arguments[2], arguments[-2] = arguments[2] + v, arguments[-2] + wrench
        found = at.stage.closed_form(*arguments, at.memory + memory, at.parameters)
        return np.array(found[0]).ravel()

    size, step = len(at.memory), 1e-5
    for column in range(n, linear.torque.shape[1]):
        v, wrench, memory = np.zeros(n), np.zeros(6), np.zeros(size)
        if column < 2 * n:
            v[column - n] = step
        elif column < 2 * n + 6:
            wrench[column - 2 * n] = step
        else:
            memory[linear.slots[column - 2 * n - 6]] = step
        there, back = torque(v, wrench, memory), torque(-v, -wrench, -memory)
        difference = (there - back) / (2 * step)
        # Rounding: 1e-16 of 100 N m over 2e-5; only velocities enter with a square, which cancels.
        assert linear.torque[:, column] == pytest.approx(difference, abs=1e-6, rel=1e-6)


def test_free_motion_has_the_poles_of_its_law():
    """x'' = K_P e + K_D e' in sampled time; a reference that is carried along is neutral."""
    text = (
        "taskspec: 1\nname: free\nrobot: {model: panda}\n"
        "law: {kind: hybrid, bandwidth: 3 Hz, damping_ratio: 0.7}\n"
        "stages: {go: {axes: {z: {velocity: 10 mm/s}}, time: 1 s}}\n"
    )
    seen = analyse(compile_stage(StagePlan(prepare(load_text(text, "free.yaml")), "go")))
    loop = sampled.Loop(np.eye(1), 0, 0.0, 0.0, 0.0)
    w = 2 * np.pi * 3
    expected = loop.poles(sampled.motion(loop, w**2, 1.4 * w))
    # The gains are those of translations; rotations and the elbow are critically damped.
    found = [mode.s for mode in seen.modes() if mode.frequency > 1]
    assert len(found) == 3
    assert max(abs(s - expected[0]) for s in found) < 1e-6 * w


def test_an_arm_that_nothing_holds_is_neutral():
    """A law without a posture leaves the elbow to itself: a double eigenvalue 1 is no mode."""
    text = PANDA.task(
        "{kind: stiffness, stiffness: {linear: 300 N/m, angular: 10 N*m/rad}}",
        "hold: {time: 1 s}",
        contact=None,
        more="balanced: true",
    )
    found = analyse(compile_stage(StagePlan(prepare(load_text(text, "hold.yaml")), "hold"))).modes()
    # Six undamped oscillators, which semi-implicit Euler steps keep on the unit circle.
    assert len(found) == 6
    assert max(abs(abs(mode.z) - 1) for mode in found) < 1e-9
