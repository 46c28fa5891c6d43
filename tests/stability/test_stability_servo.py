"""The sampled loop over a joint servo: against the loop that runs, and beside the closed form."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.laws.gains import Gain
from taskspec.planning import plan_task
from taskspec.program.program import Program
from taskspec.program.sensor import SensorModel
from taskspec.spec import load_text
from taskspec.stability.margin import Search, grows
from taskspec.stability.sampled_stage import analyse, loop_of
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.plant.plant import Plant

#: M / D of a designed admittance [s].
LAG = 0.005
#: Differences of the states; what is left of a pole after a tick is not compared.
STEP, GONE = 1e-5, 0.3
#: By which poles may be off: the arm has sagged under its load, and stands a little otherwise. Of
#: the many that lie together, those of joints that do not ring, it parts some more.
OFF, PARTED = 1e-3, 3e-3


def press(
    command: str, servo: str = "", robot: str = "", rest: str = "", law: str = "admittance"
) -> str:
    return (
        f"taskspec: 1\nname: press\nrobot: {{model: ur5e, command: {command}, servo: {{{servo}}}, "
        "tool: {shape: sphere, radius: 15 mm, length: 120 mm, mass: 0.3 kg}, "
        f"start: {{xyz: [450 mm, 100 mm, 299 mm]}}{robot}}}\n{rest}\n"
        "world: {bench: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}\n"
        f"law: {law}\nstages: {{press: {{axes: {{z: {{force: -20 N}}}}, time: 60 s}}}}\n"
    )


#: Drives stiffer than their bandwidth makes of the inertia; soft ones would sag under the load.
STIFF = (
    "rate: 4 kHz, stiffness: [6000 N*m/rad, 5000 N*m/rad, 4000 N*m/rad, 2000 N*m/rad, "
    "1500 N*m/rad, 1000 N*m/rad]"
)
FINE = "control: {plant_rate: 4 kHz}"
#: With a damping ratio of 1 poles of the servo meet, and rounding parts them.
FILES = {
    "velocity": press("velocity", "bandwidth: 15 Hz, damping: 0.8, delay: 3 ms"),
    "position": press(
        "position", "bandwidth: 30 Hz, damping: 0.7, delay: 2 ms", law="force-velocity"
    ),
    "a filter": press("velocity", "damping: 0.8", ", sensor: {filter: 30 Hz}"),
    "a late sensor": press("position", "damping: 1.2", ", sensor: {delay: 3 ms, filter: 80 Hz}"),
    "stiff drives": press("velocity", f"damping: 0.7, {STIFF}", rest=FINE, law="force-velocity"),
    "stiff drives by position": press("position", f"delay: 3 ms, damping: 0.7, {STIFF}", rest=FINE),
    "other rates": press(
        "velocity",
        "damping: 0.8, rate: 1 kHz",
        rest="control: {rate: 500 Hz, plant_rate: 4 kHz}",
    ),
}


class RunningLoop:
    """Machine and plant at rest in their contact, and what one period makes of their states."""

    def __init__(self, program: Program, ticks: int) -> None:
        """Runs so many ticks, and begins there."""
        self.parts: Assembly[Plant] = assemble(program)
        plant, machine = self.parts.plant, self.parts.machine
        self._sensing = Sensing(plant.arm, plant.views.equations, machine)
        self._period = program.context.period
        self._sensing.read()
        machine.start()
        for _ in range(ticks):
            self._tick()
        servo = plant.arm.servo
        assert servo is not None
        self._ticks, self._place = machine.stage_ticks, servo.place.copy()
        sensor = self._sensing.sensor
        self._arrays = [
            *(plant.arm.joints, plant.arm.rates, servo.state, servo.queue, servo.before),
            *(plant.arm.wrench, machine.torque, machine.runner.memory),
            *([] if sensor is None else [sensor.memory]),
        ]
        self.rest = np.concatenate(self._arrays)
        self._state = np.zeros(mujoco.mj_stateSize(plant.model, self._kind))
        mujoco.mj_getState(plant.model, plant.data, self._state, self._kind)

    _kind = mujoco.mjtState.mjSTATE_INTEGRATION

    def _tick(self) -> None:
        machine = self.parts.machine
        if machine.stage_ticks:
            self._sensing.read()
        machine.tick(machine.stage_ticks * self._period)
        self.parts.plant.step(machine.torque)

    def after(self, states: np.ndarray) -> np.ndarray:
        """What a period makes of states, the queue's rows in the order in which they are taken."""
        plant, machine, servo = self.parts.plant, self.parts.machine, self.parts.plant.arm.servo
        assert servo is not None
        mujoco.mj_setState(plant.model, plant.data, self._state, self._kind)
        at = 0
        for array in self._arrays:
            array[:] = states[at : at + len(array)]
            at += len(array)
        servo.place[:], machine.stage_ticks = self._place, self._ticks
        self._tick()
        n = len(servo.command)
        moved = int(self._place[0] - servo.place[0]) * n
        servo.queue[:] = np.roll(servo.queue, moved)
        return np.concatenate(self._arrays)

    def poles(self) -> np.ndarray:
        """Eigenvalues of the period, by central differences."""
        size = len(self.rest)
        F = np.zeros((size, size))
        for i in range(size):
            step = np.zeros(size)
            step[i] = STEP
            F[:, i] = (self.after(self.rest + step) - self.after(self.rest - step)) / (2 * STEP)
        return np.linalg.eigvals(F)


@pytest.mark.parametrize("name", FILES)
def test_poles_are_those_of_the_loop_that_runs(name):
    program = compile_unchecked(load_text(FILES[name], "press.yaml"))
    sampled = analyse(program.stages[0])
    assert sampled is not None
    expected = np.array([mode.z for mode in sampled.modes() if abs(mode.z) > GONE])
    assert len(expected) > 6
    found = RunningLoop(program, 1500).poles()
    assert max(float(np.abs(found - z).min()) for z in expected) < OFF
    # A reading of what the law has no use for fades in the sensor.
    sensor = SensorModel.of(program.context.loaded.task.robot.sensor, program.context.period)
    known = np.array([*expected, *expected.conj(), sensor.pole])
    lasting = found[np.abs(found) > GONE]
    assert len(lasting) >= len(expected)
    assert max(float(np.abs(known - z).min()) for z in lasting) < PARTED


@pytest.mark.parametrize("name", FILES)
def test_the_closed_form_has_the_boundary_of_the_sampled_loop(name):
    [stage] = compile_unchecked(load_text(FILES[name], "press.yaml")).stages
    sampled, axis = analyse(stage), stage.plan.design_rules.plants["z"].servo
    assert sampled is not None
    assert axis is not None
    gains = stage.plan.gains
    damping, mass = ("damping", LAG) if "damping" in gains else ("force.damping", 0.0)
    integral = gains["force.integral"]["z"].value if "force.integral" in gains else 0.0
    least, rings = axis.least_damping(lag=mass, integral=integral)
    for factor in (1.004, 0.996):
        moved = {damping: least * factor} | ({"mass": mass * least * factor} if mass else {})
        others = {n: gains[n] | {"z": Gain(value, "file")} for n, value in moved.items()}
        at = replace(sampled, controller=sampled.at.under(gains | others).linear())
        [worst, *_] = at.modes()
        assert grows(worst) == (factor < 1)
        if factor < 1:
            assert worst.frequency == pytest.approx(rings, rel=0.01)


def test_boundaries_that_are_looked_for_are_those_of_the_closed_form():
    text = press("velocity", law="{kind: force-velocity, force: {integral: 0 1/s}}")
    loop = loop_of(plan_task(load_text(text, "press.yaml")), "press")
    assert loop is not None
    axis = loop.stage.plan.design_rules.plants["z"].servo
    assert axis is not None
    [limit] = Search(loop.context, loop).gains(["z"], of=["force.damping"])
    assert not limit.upper
    assert limit.value == pytest.approx(axis.least_damping()[0], rel=2e-3)


def test_a_given_mass_and_a_spring_are_in_the_closed_form():
    """Of a soft axis in a contact, and of one whose mass the file gives."""
    text = press("velocity", law="{kind: admittance, mass: 3 kg}").replace(
        "{force: -20 N}", "{hold: start, stiffness: 1 kN/m}"
    )
    loop = loop_of(plan_task(load_text(text, "press.yaml")), "press")
    assert loop is not None
    axis = loop.stage.plan.design_rules.plants["z"].servo
    assert axis is not None
    [limit] = Search(loop.context, loop).gains(["z"], of=["damping"])
    least, _ = axis.least_damping(mass=3.0, spring=1000.0)
    assert limit.value == pytest.approx(least, rel=2e-3)
    assert least != pytest.approx(axis.least_damping(mass=3.0)[0], rel=0.02)
