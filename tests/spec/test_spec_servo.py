"""What an arm is commanded, and the servo that follows it: as it reads, and what does not fit."""

from __future__ import annotations

import pytest

from taskspec.spec import load_text
from taskspec.spec.robot_file import built_in
from taskspec.spec.servo import NUMBERS, VARIED, Servo
from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.sheet.servo import servo_rows


def text(robot: str, rest: str = "", model: str = "panda") -> str:
    head = f"taskspec: 1\nname: servo\nrobot: {{model: {model}, {robot}}}\n"
    return f"{head}{rest}\nstages: {{wait: {{time: 1 s}}}}\n"


def servo(robot: str, rest: str = "") -> Servo:
    return load_text(text(robot, rest), "servo.yaml").task.robot.servo


def errors(robot: str, rest: str = "", model: str = "panda") -> list[tuple[str, str, str]]:
    with pytest.raises(SpecError) as raised:
        load_text(text(robot, rest, model), "servo.yaml")
    return [(each.code, each.message, each.hint) for each in raised.value.diagnostics]


def test_arms_take_torques_unless_said_otherwise():
    robot = load_text(text("base: {}"), "servo.yaml").task.robot
    assert robot.command == "torque"
    assert robot.takes_torques


def test_a_servo_in_si_units():
    found = servo(
        "command: velocity, servo: {bandwidth: 10 Hz, damping: 0.7, delay: 6 ms, rate: 2 kHz, "
        "velocity: 2 rad/s, acceleration: [1 rad/s^2, 2 rad/s^2], stiffness: 2 kN*m/rad, "
        "sources: {delay: measured in May}}",
        "control: {plant_rate: 4 kHz}",
    )
    assert found.numbers == {
        "bandwidth": 10.0,
        "damping": 0.7,
        "delay": 0.006,
        "rate": 2000.0,
        "velocity": (2.0,),
        "acceleration": (1.0, 2.0),
        "stiffness": (2000.0,),
    }
    assert found.sources == {"delay": "measured in May"}
    assert found.delay_ticks == 12


@pytest.mark.parametrize(
    ("control", "rate"),
    [
        ("", 1000),
        ("control: {rate: 500 Hz}", 1000),
        ("control: {rate: 300 Hz}", 1200),
        ("control: {rate: 250 Hz, plant_rate: 500 Hz}", 500),
        ("control: {rate: 1 kHz, plant_rate: 4 kHz}", 1000),
        ("control: {rate: 300 Hz, plant_rate: 2100 Hz}", 2100),
    ],
)
def test_a_rate_that_is_left_out_is_the_first_from_1_khz_on(control, rate):
    assert servo("command: position", control).rate == pytest.approx(rate)


@pytest.mark.parametrize(
    ("delay", "ticks"), [("0 ms", 0), ("3.4 ms", 3), ("3.6 ms", 4), ("4 ms", 4)]
)
def test_delays_become_the_nearest_ticks(delay, ticks):
    assert servo(f"command: velocity, servo: {{delay: {delay}}}").delay_ticks == ticks


def test_a_servo_of_torques_is_refused():
    ((code, message, hint),) = errors("servo: {bandwidth: 20 Hz}")
    assert (code, message) == ("TS026", "joints that are commanded torques have no servo")
    assert "command: velocity" in hint


def test_a_servo_slower_than_its_commands_is_refused():
    ((code, message, hint),) = errors(
        "command: velocity, servo: {rate: 500 Hz}", "control: {rate: 1 kHz}"
    )
    assert code == "TS118"
    assert "the controller gives them at 1000 Hz" in message
    assert hint == "control: {rate: 500 Hz}"


@pytest.mark.parametrize("rate", ["750 Hz", "1500 Hz", "8 kHz"])
def test_a_rate_between_ticks_is_refused_with_those_that_fit(rate):
    control = "control: {rate: 500 Hz, plant_rate: 4 kHz}"
    ((code, _, hint),) = errors(f"command: velocity, servo: {{rate: {rate}}}", control)
    assert code == "TS118"
    assert "500 Hz, 1000 Hz, 2000 Hz, 4000 Hz" in hint


@pytest.mark.parametrize(
    ("robot", "code"),
    [
        ("command: speed", "TS025"),
        ("command: velocity, servo: {bandwith: 20 Hz}", "TS020"),
        ("command: velocity, servo: {bandwidth: 0 Hz}", "TS118"),
        ("command: velocity, servo: {acceleration: 3 m/s}", "TS112"),
        ("command: velocity, servo: {sources: {bandwith: measured}}", "TS020"),
        ("command: velocity, servo: ur5", "TS134"),
        ("command: velocity, servo: ../../../etc/hosts.yaml", "TS409"),
    ],
)
def test_what_does_not_fit_is_reported(robot, code):
    assert [each[0] for each in errors(robot)] == [code]


def test_numbers_may_differ_in_truth():
    told = ", ".join(f"robot.servo.{key}: {value}" for key, value in OTHERWISE.items())
    loaded = load_text(text("command: velocity", f"truth: {{{told}}}"), "servo.yaml")
    assert set(OTHERWISE) == set(VARIED)
    assert loaded.task.robot.servo == Servo()
    assert set(loaded.true_task.robot.servo.numbers) == set(NUMBERS)
    assert loaded.true_task.robot.servo.delay == 0.01
    assert loaded.true_task.robot.servo.stiffness == (2000.0,)


OTHERWISE = {
    "bandwidth": "10 Hz",
    "damping": "0.7",
    "delay": "10 ms",
    "velocity": "1 rad/s",
    "acceleration": "10 rad/s^2",
    "jerk": "1000 rad/s^3",
    "stiffness": "2000 N*m/rad",
}


def test_rates_do_not_differ_in_truth():
    codes = [each[0] for each in errors("command: velocity", "truth: {robot.servo.rate: 2 kHz}")]
    assert codes == ["TS710"]


def test_built_in_servos_have_a_source_or_are_assumptions():
    names = built_in("servo")
    assert {"panda", "ur5e-servoj", "ur5e-speedj"} <= set(names)
    for name in names:
        found = servo(f"command: velocity, servo: {name}", "control: {rate: 500 Hz}")
        assert set(found.sources) == set(found.numbers), name
        published = [key for key, source in found.sources.items() if "https" in source]
        assert {"rate", "velocity"} <= set(published), name


def test_a_servo_in_a_file_of_ones_own(tmp_path):
    (tmp_path / "arm.yaml").write_text("bandwidth: 12 Hz\n")
    loaded = load_text(
        text("command: velocity, servo: arm.yaml"), str(tmp_path / "task.yaml"), base=tmp_path
    )
    assert loaded.task.robot.servo.bandwidth == 12
    assert [path.name for path in loaded.included] == ["arm.yaml"]


@pytest.mark.parametrize("section", ["vary", "truth"])
def test_servos_of_torques_do_not_differ(section):
    value = "2..10 ms" if section == "vary" else "10 ms"
    codes = [each[0] for each in errors("base: {}", f"{section}: {{robot.servo.delay: {value}}}")]
    assert codes == ["TS026"]


def test_commands_that_are_no_torques_have_no_faults_of_torques():
    faults = "truth: {faults: [{torque: gain 0.8, at: 1 s}]}"
    assert [each[0] for each in errors("command: velocity", faults)] == ["TS026"]
    load_text(text("base: {}", faults), "servo.yaml")


def test_explain_has_a_row_for_each_number_with_its_source():
    told = "command: velocity, servo: {delay: 6 ms, sources: {delay: measured in May}}"
    rows = dict(servo_rows(load_text(text(told), "servo.yaml").task.robot))
    assert rows["commanded"] == "joint velocities"
    assert rows["servo: delay"] == "6 ms (from: measured in May)"
    assert rows["servo: bandwidth"] == "20 Hz (from: an assumption)"
    assert list(servo_rows(load_text(text("base: {}"), "servo.yaml").task.robot)) == []


def test_the_controller_is_by_default_as_slow_as_a_declared_servo():
    def rates(robot: str, rest: str = "") -> tuple[float, float, float]:
        task = load_text(text(robot, rest, "ur5e"), "servo.yaml").task
        return task.control.rate, task.robot.servo.rate, task.control.plant_rate

    assert rates("command: velocity, servo: ur5e-speedj") == (500, 500, 1000)
    assert rates("command: velocity, servo: {rate: 2 kHz}", "control: {plant_rate: 2 kHz}") == (
        *(1000, 2000, 2000),
    )
    assert rates("command: velocity, servo: ur5e-speedj", "control: {rate: 250 Hz}") == (
        *(250, 500, 1000),
    )
    assert rates("command: velocity") == (1000, 1000, 1000)
