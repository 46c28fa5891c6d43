"""Both loops on an arm with a servo, its log, and how it is brought to rest."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_text
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.log import Log

LAW = "law: force-velocity\n"
TASKS = {
    "velocities, a payload, a wrist sensor, a loose body": (
        "robot: {model: panda, balanced: true, start: {xyz: [500 mm, 0, 330 mm]}, command: "
        "velocity, servo: {delay: 3 ms, acceleration: 20 rad/s^2}, tool: {shape: sphere, length: "
        "100 mm, mass: 300 g}, sensor: {at: wrist, noise: 0.1 N}}\n"
        "control: {rate: 500 Hz, plant_rate: 4 kHz}\n"
        "world: {floor: {shape: plane, xyz: [0, 0, 320 mm], stiffness: 5 kN/m}, lid: {shape: box, "
        "size: [40 mm, 40 mm, 40 mm], xyz: [700 mm, 200 mm, 360 mm], free: true, mass: 2 kg}}\n"
        "truth: {robot.payload: {mass: 100 g}}\n"
        f"{LAW}stages: {{down: {{axes: {{z: {{move: -15 mm}}}}, time: 0.6 s}}}}\n"
    ),
    "positions, stiff drives": (
        "robot: {model: planar2, start: {joints: [20 deg, 40 deg]}, command: position, "
        "servo: {velocity: 1 rad/s, stiffness: 500 N*m/rad, damping: 0.8}}\n"
        "control: {rate: 250 Hz}\n"
        f"{LAW}stages: {{down: {{axes: {{y: {{move: -15 mm}}}}, time: 0.2 s}}}}\n"
    ),
    "velocities on a rigid constraint": (
        "robot: {model: panda, balanced: true, start: {xyz: [540 mm, 0, 350 mm]}, command: "
        "velocity, servo: {bandwidth: 30 Hz}}\n"
        "frames: {rail: {xyz: [450 mm, 0, 350 mm]}}\n"
        'world: {rim: {equation: "x^2 + y^2 = (90 mm)^2", frame: rail, stiffness: exact}}\n'
        f"{LAW}stages: {{up: {{axes: {{z: {{move: 5 mm}}}}, time: 0.2 s}}}}\n"
    ),
    "positions at their limits, an equation, two stages": (
        "robot: {model: panda, start: {xyz: [540 mm, 0, 350 mm]}, command: position, servo: "
        "{acceleration: 10 rad/s^2}}\n"
        "frames: {rail: {xyz: [450 mm, 0, 350 mm]}}\n"
        'world: {rim: {equation: "x^2 + y^2 = (90 mm)^2", frame: rail, stiffness: 20 kN/m}}\n'
        "law: hybrid-velocity\nlimits: {speed: 80 mm/s}\n"
        "stages: {round: {axes: {y: {velocity: 0.2 m/s}}, constraints: {rim: {force: 5 N}}, "
        "time: 0.4 s}, fold: {path: {joints: [0.3 rad, -0.5 rad, 0, -2 rad, 0, 1.8 rad, 0.8 rad], "
        "speed: 3 rad/s}, law: hybrid-velocity, time: 0.3 s}}\n"
    ),
    "an admittance whose contact is at its limit": (
        "robot: {model: panda, start: {xyz: [500 mm, 0, 322 mm]}, command: velocity, servo: panda, "
        "tool: {shape: sphere, length: 100 mm}}\n"
        "world: {floor: {shape: plane, xyz: [0, 0, 320 mm], stiffness: 20 kN/m, friction: 0.3}}\n"
        "law: {kind: admittance, solve: qp, damping: {linear: 300 N*s/m, angular: 5 N*m*s/rad}}\n"
        "limits: {force: 12 N}\n"
        "stages: {press: {axes: {x: {force: 10 N}, z: {force: -30 N}}, time: 0.4 s}}\n"
    ),
}


def program(name: str, rest: str = "") -> Program:
    return compile_unchecked(load_text(f"taskspec: 1\nname: servo\n{TASKS[name]}{rest}", "s.yaml"))


def ran(
    of: Program, path: Path, loop: str, *, to_rest: bool = False
) -> tuple[Assembly[Plant], fixed_step.Outcome]:
    parts = assemble(of)
    with closing(parts.recorder(Log(path))) as recorder:
        outcome = fixed_step.run(
            *(parts.machine, parts.plant, parts.bus, recorder, of.context.period),
            seed=3,
            loop=loop,
            to_rest=to_rest,
        )
    return parts, outcome


@pytest.mark.parametrize("name", TASKS)
def test_all_loops_write_the_same(name, tmp_path):
    of, found = program(name), set()
    for loop in ("native", "interpreted", "python"):
        (tmp_path / loop).mkdir()
        path = tmp_path / loop / "log"
        parts, outcome = ran(of, path, loop)
        assert outcome.loop == ("python" if loop == "python" else "native")
        assert outcome.ticks * of.context.period >= 0.2
        servo, arm = parts.plant.arm.servo, parts.plant.arm
        assert servo is not None
        numbers = (servo.state, servo.queue, servo.place, servo.before, arm.q, arm.v)
        found.add(path.read_bytes() + b"".join(map(np.ndarray.tobytes, numbers)))
    assert len(found) == 1


def test_the_log_has_what_is_commanded_and_what_drives_exert():
    """A tick has the command that is held in it, and torque and reference at its end."""
    of = program("velocities, a payload, a wrist sensor, a loose body")
    parts = assemble(of)
    layout = LogLayout.of(of, parts.world.task)
    units = layout.units
    assert units["joint.1.velocity.command"] == "rad/s"
    assert units["joint.1.position.servo"] == "rad"
    assert "joint.1.position.command" not in units
    assert len(units) == len(set(units))
    servo = parts.plant.arm.servo
    assert servo is not None
    for k in range(50):
        parts.machine.torque[:] = 0.01 * k
        parts.plant.step(parts.machine.torque)
    found = layout.columns(parts.bus.array[None])
    assert found["joint.3.velocity.command"][0][0] == 0.49
    for i in range(7):
        assert found[f"joint.{i + 1}.torque"][0][0] == parts.plant.data.ctrl[i] != 0.49
        assert found[f"joint.{i + 1}.position.servo"][0][0] == servo.reference[i]
    positions = program("positions, stiff drives")
    assert (
        "joint.1.position.command" in LogLayout.of(positions, positions.context.loaded.task).units
    )


def test_an_arm_that_takes_torques_has_neither():
    text = "taskspec: 1\nrobot: {model: planar2}\nstages: {wait: {time: 1 s}}\n"
    of = compile_unchecked(load_text(text, "torques.yaml"))
    assert assemble(of).plant.arm.servo is None
    names = LogLayout.of(of, of.context.loaded.task).units
    assert "joint.1.torque" in names
    assert not [name for name in names if name.endswith((".command", ".servo"))]


@pytest.mark.parametrize("name", list(TASKS)[:2])
def test_it_is_brought_to_rest_by_commands_within_the_limit_of_acceleration(name, tmp_path):
    of = program(name, "limits: {speed: 4 mm/s}\n")
    parts, outcome = ran(of, tmp_path / "log", "python", to_rest=True)
    assert outcome.status == fixed_step.STOPPED
    assert outcome.not_at_rest == ""
    assert np.abs(parts.plant.arm.v).max() < 1e-4
    assert np.abs(parts.plant.arm.q).max() > 0.1
    servo = parts.plant.arm.servo
    assert servo is not None
    if not servo.positions:
        assert np.abs(parts.machine.torque).max() == 0
