"""Defaults, designed gains, stops and the log: the numbers and names that the code has."""

from __future__ import annotations

import inspect
import re
from dataclasses import replace

import pytest
from documents import CONVENTIONS, LANGUAGE, completed, first_words, load, table, value, words

from taskspec.compiler import compile_task
from taskspec.control.gains import Plant, design
from taskspec.motion.blend import BLEND_TIME
from taskspec.motion.profile import RISE_TIME
from taskspec.program import events
from taskspec.program.laws import POSTURE_FREQUENCY
from taskspec.program.references import DEFAULT_RAMP
from taskspec.program.signals import TOUCHING
from taskspec.program.stiffness import rigid_stiffness
from taskspec.program.tracks import MOVE_SPEED
from taskspec.robot import builtin_robots, load_robot
from taskspec.robot.tool import LENGTH, RADIUS
from taskspec.spec import Axis, Law, Robot, Task
from taskspec.spec.control import Control
from taskspec.spec.law import LAWS
from taskspec.spec.world import Shape
from taskspec.text.expression import Expression, parse, signals
from taskspec.text.units import FORCE, split_quantity, to_si
from taskspec_runner import folder, loop
from taskspec_runner.cli import guard
from taskspec_runner.plant.plant import Plant as SimulatedPlant
from taskspec_runner.record import BATCH
from taskspec_runner.summary import EXIT_GOOD, EXIT_INTERRUPTED, EXIT_MISSED, EXIT_STOPPED


def test_defaults():
    rows = {row[0]: words(row[1]) for row in table(LANGUAGE, "table: defaults")}
    plain = {"`law`, `frame`", "limits", "sensor"}
    shape, control = Shape.model_fields, Control.model_fields
    expected = {
        "radius of a tool": RADIUS,
        "length of a tool": LENGTH,
        "stiffness of an object": shape["stiffness"].default,
        "friction of an object": shape["friction"].default,
        "ramp of a force": DEFAULT_RAMP,
        "speed of a move, translations": MOVE_SPEED["linear"],
        "speed of a move, rotations": MOVE_SPEED["angular"],
        "time in which a move reaches its speed": RISE_TIME,
        "blending at entry": BLEND_TIME,
        "touching": TOUCHING,
        "rate of the controller": control["rate"].default,
        "rate of the plant": control["plant_rate"].default,
        "posture of a redundant arm": POSTURE_FREQUENCY,
    }
    assert rows.keys() - plain == expected.keys()
    for what, number in expected.items():
        parts = split_quantity(rows[what][0])
        assert parts is not None
        assert to_si(*parts).value == pytest.approx(number, rel=1e-12), what
    assert rows["`law`, `frame`"] == [Law().kind, Task.model_fields["frame"].default]


AXES = {
    "motion": Axis(hold="start"),
    "force": Axis(force=Expression("", parse("1 N", "sum"), FORCE)),
    "soft": Axis(hold="start", damping=None, stiffness=800.0),
}
PLANTS = (
    Plant(h=3.0, held=8.0, k=20e3, period=1e-3),
    Plant(h=0.4, held=0.7, k=1e3, period=1e-3),
    Plant(h=1.5, held=2.0, k=2e5, period=4e-3),
)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("law", LAWS)
def test_designed_gains_follow_the_documented_rules(law, plant):
    known = {"h": plant.h, "L": plant.held, "k": plant.k, "T": plant.period}
    rules: dict[tuple[str, str], str] = {}
    for row in table(LANGUAGE, "table: designed"):
        if law in words(row[0]):
            rules[row[1], words(row[2])[0]] = words(row[3])[0]
    assert rules
    for mode in AXES:
        if mode == "soft" and law != "hybrid":
            continue
        own = {gain: rule for (kind, gain), rule in rules.items() if kind == mode}
        inherited = {gain: rule for (kind, gain), rule in rules.items() if kind == "motion"}
        if law != "hybrid":
            own = inherited | own
        axis = AXES[mode]
        if mode == "soft":
            # One of the two is always given on a soft axis.
            damped = design(Law(kind=law), {"x": replace_axis(axis, None, 5.0)}, {"x": plant})
            assert damped["stiffness"]["x"].value == value(own.pop("stiffness"))
            known["K"] = 800.0
        gains = {
            name: by_axis["x"].value
            for name, by_axis in design(Law(kind=law), {"x": axis}, {"x": plant}).items()
        }
        for name, letter in (("mass", "M"), ("stiffness", "K"), ("damping", "d")):
            known[letter] = gains.get(name, known.get(letter, 0.0))
        known["d"] = gains.get("force.damping", known["d"])
        for name, rule in own.items():
            assert gains[name] == pytest.approx(value(rule, known), rel=1e-12), (mode, name)
        # `mass` of the laws at the arm's own inertia is no gain of theirs; K_P and K_D follow.
        designed = set(gains) - {"K_P", "K_D"} - ({"mass"} if "mass" not in LAWS[law] else set())
        assert designed - ({"stiffness"} if mode == "soft" else set()) == set(own), mode


def replace_axis(axis: Axis, stiffness: float | None, damping: float | None) -> Axis:
    return axis.model_copy(update={"stiffness": stiffness, "damping": damping})


def test_the_smaller_mass_of_a_rotation_stands_in_the_text():
    light = replace(PLANTS[0], h=1e-6, held=1e-6)
    gains = design(Law(kind="impedance"), {"rx": AXES["motion"]}, {"rx": light})
    number = gains["mass"]["rx"].value
    text = " ".join(LANGUAGE.read_text(encoding="utf-8").split())
    assert f"On rotations {number:g} kg·m² takes the place" in text


def test_rigid():
    rows = {words(row[0])[0]: words(row[1])[0] for row in table(CONVENTIONS, "table: rigid")}
    assert rows.keys() == {robot.name for robot in builtin_robots()}
    for name, stiffness in rows.items():
        k = rigid_stiffness(load_robot(Robot(model=name)), 1e-3)
        assert value(stiffness) == pytest.approx(k, rel=5e-3), name


def test_limits():
    limits = "limits: {force: 60 N, torque: 9 N*m, speed: 1 m/s, deviation: 10 mm}\n"
    found = compile_task(load(completed(limits))).stages[0].events
    names = [e.name for e in found if e.kind == events.LIMIT]
    assert first_words(CONVENTIONS, "table: limits") == list(dict.fromkeys(names))


def test_alarms():
    source = inspect.getsource(SimulatedPlant.alarm) + inspect.getsource(loop.run)
    names = set(re.findall(r'"([a-z_]+)", (?:f"|text)', source))
    assert set(first_words(CONVENTIONS, "table: alarms")) == names


def test_exit_codes():
    documented = [int(row[0]) for row in table(CONVENTIONS, "table: exits")]
    own = {guard.WELL, guard.WRONG, guard.USAGE, guard.INTERNAL, guard.INTERRUPTED}
    assert set(documented) == own | {EXIT_GOOD, EXIT_MISSED, EXIT_STOPPED, EXIT_INTERRUPTED}


def test_run_folder():
    files = (folder.TASK, folder.MANIFEST, folder.LOG)
    later = (folder.SUMMARY, folder.REPORT, folder.CRASH)
    assert tuple(first_words(CONVENTIONS, "table: folder")) == files + later
    assert f"batches of {BATCH} rows" in CONVENTIONS.read_text(encoding="utf-8")


def test_columns_of_the_log(simulate):
    run = simulate(completed("stages: {slide: {time: 5 ms}}\nexpect: []\n"))
    expected: dict[str, str] = {}
    for row in table(CONVENTIONS, "table: columns"):
        (pattern,), units = words(row[0]), words(row[1])
        axes = signals.VECTORS.get(pattern.partition(".")[0], ()) if "AXIS" in pattern else ("",)
        for axis in axes:
            unit = units[-1 if axis in signals.ROTATIONS else 0] if units else ""
            for joint in range(1, 8) if "N" in pattern.split(".") else (0,):
                name = pattern.replace("AXIS", axis).replace(".N.", f".{joint}.")
                expected[name.replace("OBJECT", "table")] = unit
    del expected["stage"]
    assert {name: run.history.units[name] for name in run.history.columns} == expected
