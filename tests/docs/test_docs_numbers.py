"""Defaults, designed gains, stops and the log: the numbers and names that the code has."""

from __future__ import annotations

import inspect
import json
import math
import re
from dataclasses import replace

import pytest
from documents import (
    CONVENTIONS,
    LANGUAGE,
    completed,
    first_words,
    load,
    table,
    text_of,
    value,
    words,
)

from taskspec import signals
from taskspec.compiler import compile_task
from taskspec.control import null_space
from taskspec.control.state import ARM_LENGTH
from taskspec.expression import Expression, parse
from taskspec.geometry.axis import ROTATIONS, Axis
from taskspec.laws import LAWS
from taskspec.laws.gains import AxisPlant
from taskspec.laws.servo_loop import Contact, ServoTiming
from taskspec.modes import DEFAULT_RAMP, MOVE_SPEED
from taskspec.motion.blend import BLEND_TIME
from taskspec.motion.profile import RISE_TIME
from taskspec.program import events
from taskspec.program.program import Program
from taskspec.robot.tool import LENGTH, RADIUS
from taskspec.signals.entries import TOUCHING
from taskspec.spec import AxisEntry, Law, Task
from taskspec.spec.control import Control
from taskspec.spec.equation import EquationObject
from taskspec.spec.gains import AxisValues
from taskspec.spec.law import NULL_SPACE_GOALS
from taskspec.spec.world import Shape
from taskspec.text.units import FORCE, split_quantity, to_si
from taskspec_runner import exit_codes
from taskspec_runner.compare import folder as compared
from taskspec_runner.export import FORMATS
from taskspec_runner.export.export import LAYOUT
from taskspec_runner.export.mcap import (
    JOINT_COMMANDS,
    JOINT_STATES,
    POSES,
    SCALARS,
    SCENE,
    TOPICS,
)
from taskspec_runner.export.messages import SIGNALS
from taskspec_runner.loop import fixed_step as loop
from taskspec_runner.loop.telemetry import RATE, message
from taskspec_runner.plant.plant import Plant as SimulatedPlant
from taskspec_runner.record import names
from taskspec_runner.record.recorder import BATCH
from taskspec_runner.runs import ROWS
from taskspec_runner.verdict.summary import BY_SIGNAL


def test_defaults():
    rows = {row[0]: words(row[1]) for row in table(LANGUAGE, "table: defaults")}
    plain = {"`law`, `frame`", "limits", "sensor"}
    shape, control = Shape.model_fields, Control.model_fields
    expected = {
        "radius of a tool": RADIUS,
        "length of a tool": LENGTH,
        "stiffness of an object": shape["stiffness"].default,
        "friction of an object": shape["friction"].default,
        "stiffness of an equation": EquationObject.model_fields["stiffness"].default,
        "ramp of a force": DEFAULT_RAMP,
        "speed of a move, translations": MOVE_SPEED["linear"],
        "speed of a move, rotations": MOVE_SPEED["angular"],
        "time in which a move reaches its speed": RISE_TIME,
        "blending at entry": BLEND_TIME,
        "touching": TOUCHING,
        "rate of the controller": control["rate"].default,
        "rate of the plant": control["plant_rate"].default,
        "posture of a redundant arm": null_space.FREQUENCY,
    }
    assert rows.keys() - plain == expected.keys()
    for what, number in expected.items():
        parts = split_quantity(rows[what][0])
        assert parts is not None
        assert to_si(*parts).value == pytest.approx(number, rel=1e-12), what
    assert rows["`law`, `frame`"] == [Law().kind, Task.model_fields["frame"].default]


def test_numbers_of_the_null_space():
    rows = {words(row[0])[0]: words(row[2]) for row in table(LANGUAGE, "table: null space")}
    assert tuple(rows) == NULL_SPACE_GOALS
    share, width = rows["joint-limits"]
    assert value(share) == pytest.approx(null_space.LIMIT_SHARE, rel=1e-12)
    assert value(width) == pytest.approx(null_space.LIMIT_WIDTH, rel=1e-12)
    gain, most = rows["manipulability"]
    assert value(gain) == pytest.approx(null_space.GAIN**2, rel=1e-12)
    assert value(most) == pytest.approx(null_space.MOST, rel=1e-12)
    text = text_of(LANGUAGE / "null-space.md")
    assert f"ω = 2π `{null_space.FREQUENCY:g} Hz`" in text
    assert f"a length of `{ARM_LENGTH:g} m`" in text


AXES = {
    "motion": AxisEntry(hold="start"),
    "force": AxisEntry(force=Expression("", parse("1 N", "sum"), FORCE)),
    "soft": AxisEntry(hold="start", damping=None, stiffness=800.0),
}
SERVO = ServoTiming(w=2 * math.pi * 20.0, ratio=1.0, delay=4e-3, period=1e-3, tick=1e-3, step=1e-3)
PLANTS = (
    AxisPlant(h=3.0, held=8.0, k=20e3, period=1e-3, servo=SERVO.along(3.0, Contact(20e3))),
    AxisPlant(h=0.4, held=0.7, k=1e3, period=1e-3, servo=SERVO.along(0.4, Contact(1e3))),
    AxisPlant(h=1.5, held=2.0, k=2e5, period=4e-3, servo=SERVO.along(1.5, Contact(2e5))),
)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("law", LAWS)
def test_designed_gains_follow_the_documented_rules(law, plant):
    known = {"h": plant.h, "L": plant.held, "k": plant.k, "T": plant.period}
    assert plant.servo is not None
    known["D_0"] = plant.servo.least_damping(lag=5e-3)[0]
    if "force.integral" in LAWS[law].gain_names and LAWS[law].commands == "velocity":
        # Beside the integral that the least without one has.
        integral = plant.k / (8 * 3 * plant.servo.least_damping()[0])
        known["D_0"] = plant.servo.least_damping(integral=integral)[0]
    rules: dict[tuple[str, str], str] = {}
    for row in table(LANGUAGE, "table: designed"):
        if law in words(row[0]):
            rules[row[1], words(row[2])[0]] = words(row[3])[0]
    assert rules
    for mode in AXES:
        if mode == "soft" and not LAWS[law].soft_axes:
            continue
        own = {gain: rule for (kind, gain), rule in rules.items() if kind == mode}
        inherited = {gain: rule for (kind, gain), rule in rules.items() if kind == "motion"}
        if not LAWS[law].selects:
            own = inherited | own
        axis = AXES[mode]
        if mode == "soft":
            # One of the two is always given on a soft axis.
            damped = Law(kind=law).design({Axis.X: replace_axis(axis, None, 5.0)}, {Axis.X: plant})
            assert damped["stiffness"][Axis.X].value == value(own.pop("stiffness"))
            known["K"] = 800.0
            if LAWS[law].commands == "velocity":
                known["D_0"] = plant.servo.least_damping(lag=5e-3, spring=800.0)[0]
        gains = {
            name: by_axis[Axis.X].value
            for name, by_axis in Law(kind=law).design({Axis.X: axis}, {Axis.X: plant}).items()
        }
        for name, letter in (("mass", "M"), ("stiffness", "K"), ("damping", "d")):
            known[letter] = gains.get(name, known.get(letter, 0.0))
        known["d"] = gains.get("force.damping", known["d"])
        for name, rule in own.items():
            assert gains[name] == pytest.approx(value(rule, known), rel=1e-12), (mode, name)
        # `mass` of the laws at the arm's own inertia is no gain of theirs; K_P and K_D follow.
        designed = (
            set(gains)
            - {"K_P", "K_D", "K_V"}
            - ({"mass"} if "mass" not in LAWS[law].gain_names else set())
            - ({"stiffness"} if mode == "force" and LAWS[law].selects else set())  # It is 0.
        )
        assert designed - ({"stiffness"} if mode == "soft" else set()) == set(own), mode


def replace_axis(axis: AxisEntry, stiffness: float | None, damping: float | None) -> AxisEntry:
    return axis.model_copy(update={"stiffness": stiffness, "damping": damping})


def test_the_smaller_mass_of_a_rotation_stands_in_the_text():
    light = replace(PLANTS[0], h=1e-6, held=1e-6)
    gains = Law(kind="impedance").design({Axis.RX: AXES["motion"]}, {Axis.RX: light})
    number = gains["mass"][Axis.RX].value
    text = " ".join(text_of(LANGUAGE).split())
    assert f"On rotations {number:g} kg·m² takes the place" in text


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("law", ["parallel", "parallel-pid"])
def test_a_damping_of_the_file_enters_the_integral_gain(law, plant):
    given = Law(kind=law, damping=AxisValues(z=7e3))
    gains = given.design({Axis.Z: AXES["force"]}, {Axis.Z: plant})
    (rule,) = (
        words(row[3])[0]
        for row in table(LANGUAGE, "table: designed")
        if law in words(row[0]) and words(row[2]) == ["force.integral"]
    )
    expected = value(rule, {"k": plant.k, "d": 7e3})
    assert gains["force.integral"][Axis.Z].value == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("plant", PLANTS)
def test_designed_damping_of_the_joints(plant):
    (row,) = (row for row in table(LANGUAGE, "table: designed") if row[1] == "joint")
    assert words(row[0]) == [law for law, facts in LAWS.items() if facts.damps_joints]
    known = {"H": plant.held, "h": plant.h, "S": plant.k, "T": plant.period}
    designed = Law(kind="pd-joint").design_joints([plant])
    assert designed["joint.1"].value == pytest.approx(value(words(row[3])[0], known), rel=1e-12)


def on_a_plane(model: str, stiffness: str) -> Program:
    world = f"world: {{floor: {{shape: plane, stiffness: {stiffness}}}}}"
    stages = "stages: {wait: {time: 1 s}}"
    return compile_task(load(f"taskspec: 1\nrobot: {{model: {model}}}\n{world}\n{stages}\n"))


def test_rigid():
    for row in table(CONVENTIONS, "table: rigid"):
        (model,), (stiffness,), (damping,) = words(row[0]), words(row[2]), words(row[3])
        found = on_a_plane(model, "rigid").context.compliances["floor"]
        assert value(stiffness) == pytest.approx(found.stiffness, rel=2e-3)
        assert value(damping) == pytest.approx(found.damping, rel=2e-3)
        for times, codes in ((3.9, []), (4.1, ["TS307"])):
            warned = on_a_plane(model, f"{times * found.stiffness:.9g} N/m").findings
            assert [d.code for d in warned] == codes


def test_limits():
    limits = "limits: {force: 60 N, torque: 9 N*m, speed: 1 m/s, deviation: 10 mm}\n"
    varies = "stiffness: {z: 1 kN/m + 10 N/m * t/(1 s)}"
    angles = f"law: {{kind: impedance, orientation: rpy, {varies}}}\n"
    protected = {"robot.protection": "panda"}
    found = compile_task(load(completed(limits + angles), protected)).stages[0].events
    names = [e.name for e in found if e.kind == events.LIMIT]
    assert first_words(CONVENTIONS, "table: limits") == list(dict.fromkeys(names))


def test_alarms():
    alarm, run = inspect.getsource(SimulatedPlant.alarm), inspect.getsource(loop.Steps._run)
    names = re.findall(r'"([a-z_]+)", (?:f"|text)', alarm) + re.findall(r'_stopped\("(\w+)"', run)
    assert set(first_words(CONVENTIONS, "table: alarms")) == set(names)


def test_exit_codes():
    documented = [
        int(number) for row in table(CONVENTIONS, "table: exits") for number in row[0].split(", ")
    ]
    own = {value for name, value in vars(exit_codes).items() if name.isupper()}
    # Ctrl-C, hanging up and SIGTERM have these numbers on every POSIX system.
    signalled = {BY_SIGNAL + number for number in (2, 1, 15)}
    assert len(own) == 7
    assert sorted(documented) == sorted(own | signalled)


def test_run_folder():
    files = (names.TASK, names.MANIFEST, names.LOG, names.BLOCK)
    later = (names.SUMMARY, names.REPORT, names.CRASH)
    assert tuple(first_words(CONVENTIONS, "table: folder")) == files + later
    text = CONVENTIONS.read_text(encoding="utf-8")
    assert f"batches of {BATCH} rows" in text


def test_topics_of_an_export():
    rows = {words(row[0])[0]: words(row[1])[0] for row in table(CONVENTIONS, "table: topics")}
    commanded = {JOINT_COMMANDS: TOPICS[JOINT_STATES]}
    assert rows == {**TOPICS, **commanded, **POSES, **SCENE, SCALARS: SIGNALS}
    assert sorted([*FORMATS.values(), LAYOUT]) == sorted(
        name.removeprefix("log") for name in names.EXPORTS
    )
    text = CONVENTIONS.read_text(encoding="utf-8")
    assert f"{ROWS // 1000} 000 rows at a time" in text
    for form, suffix in FORMATS.items():
        assert f"| `--{form}` | `log{suffix}` |" in text


def test_telemetry():
    text = " ".join(CONVENTIONS.read_text(encoding="utf-8").split())
    assert f"{RATE:.0f} a second of simulated time" in text
    for told in re.findall(r"`[^`]*` is `(\{[^`]*\})`", text):
        (name,) = re.findall(r"`([\w.]+)` is `" + re.escape(told), text)
        leaf = float(re.findall(r"-?[\d.]+(?=\})", told)[0])
        sent = json.loads(message({"clock": 0.0, name: leaf}))
        assert sent == {"timestamp": 0.0, **json.loads(told)}


def test_comparison_folder():
    files = (compared.COMPARISON, compared.PAGE, compared.PICTURE)
    assert tuple(first_words(CONVENTIONS, "table: comparison")) == files


def test_columns_of_the_log(simulate):
    world = (
        "world: {table: {shape: plane, xyz: [0, 0, 300 mm]}, floor: {equation: z >= 0},"
        " bars: {equation: q1 >= -180 deg}, door: {mechanism: hinge},"
        " drawer: {mechanism: slide}, bolt: {mechanism: screw, pitch: 2 mm/turn}}\n"
    )
    run = simulate(completed(world + "stages: {slide: {time: 5 ms}}\nexpect: []\n"))
    kinds = {name: thing.kind for name, thing in run.program.context.loaded.task.world.items()}
    expected: dict[str, str] = {}
    for row in table(CONVENTIONS, "table: columns"):
        (pattern,), units = words(row[0]), words(row[1])
        axes = signals.VECTORS[pattern.partition(".")[0]].axes if "AXIS" in pattern else ("",)
        for axis in axes:
            unit = units[-1 if axis in ROTATIONS else 0] if units else ""
            for joint in range(1, 8) if "N" in pattern.split(".") else (0,):
                name = pattern.replace("AXIS", axis).replace(".N.", f".{joint}.")
                expected[name] = unit
    del expected["stage"], expected["OBJECT.SIGNAL"]
    del expected["limits"], expected["residual"]  # of tasks with a program alone
    del expected["param.NAME"]  # of tasks with live params alone
    del expected["link.late"], expected["link.lost"]  # of runs at the wall clock alone
    beside = [name for name in expected if name.startswith("EQUATION.SIGNAL.")]
    for name in beside:
        del expected[name]
    for kind, signal, unit, *_ in table(LANGUAGE, "table: object signals"):
        for thing in (name for name, its in kinds.items() if its == words(kind)[0]):
            full = f"{thing}.{words(signal)[0]}"
            if full.endswith(".residual"):
                continue  # of stages with joint torques alone
            expected[full] = words(unit)[0]
            if "equation" in words(kind)[0] and not full.endswith(".gap"):
                for name in beside:
                    expected[f"{full}.{name.rpartition('.')[2]}"] = words(unit)[0]
    assert {name: run.history.units[name] for name in run.history.columns} == expected
