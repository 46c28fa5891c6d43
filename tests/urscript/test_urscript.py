"""Tasks as URScript: programs by their goldens, reasons by the page, and places of both."""

from __future__ import annotations

import math
import re

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

from taskspec.motion import blend
from taskspec.motion.profile import RISE_TIME, move
from taskspec.planning import plan_task
from taskspec.robot.library import read_builtin
from taskspec.spec import load_task, load_text
from taskspec_runner.cli.app import app
from taskspec_runner.urscript.exported import script_of
from taskspec_runner.urscript.refusals import NotMappedError
from taskspec_runner.urscript.script import library
from urscript.golden import (
    EXAMPLE,
    GOLDENS,
    PAGE,
    ROOT,
    TASKS,
    golden,
    outcome,
    page_with,
    parts,
    plain,
    row,
)

#: What the programs use of URScript (script manual 5.x).
_URSCRIPT = {
    *("def", "end", "if", "elif", "else", "while", "return", "local", "global", "halt"),
    *("and", "or", "not", "True", "False", "p"),
    *("acos", "asin", "atan", "atan2", "cos", "floor", "log", "norm", "pow", "sin", "sqrt", "tan"),
    *("pose_inv", "pose_trans", "get_inverse_kin", "get_steptime", "sleep", "sync"),
    *("get_actual_tcp_pose", "get_actual_tcp_speed", "get_actual_tool_flange_pose"),
    *("get_actual_joint_positions", "get_tcp_force", "zero_ftsensor"),
    *("set_tcp", "set_target_payload", "movej", "servoj", "speedl", "stopl"),
    *("force_mode", "end_force_mode", "force_mode_set_damping", "force_mode_set_gain_scaling"),
    *("read_input_boolean_register", "read_input_float_register", "popup", "textmsg"),
}
_NAMED_ARGUMENTS = re.compile(r"\b(?:a|v|t|lookahead_time|gain|title|error|blocking)=")
_OPENS = re.compile(r"(?:def|if|while)\b.*:$")
MAPPED = sorted(path.stem for path in GOLDENS.glob("*.script"))


@pytest.mark.parametrize("name", TASKS)
def test_a_shipped_task_maps_as_its_golden_or_is_refused_as_the_page_says(name):
    found = outcome(name)
    assert row(name) in PAGE.read_text(encoding="utf-8").splitlines()
    if found.script is None:
        assert found.reasons
        assert all(re.match(rf".*{name}\.yaml:\d+:\d+: .", reason) for reason in found.reasons)
        assert not golden(name).exists()
        return
    assert plain(found.script.own_text) == golden(name).read_text(encoding="utf-8")
    assert "NEVER EXECUTED" in found.script.text
    _check_names(found.script.text)


def _check_names(text: str) -> None:
    """Every name is defined or of URScript, and each block ends at its own depth."""
    assigned = set(re.findall(r"(?:local|global) (\w+) =", text))
    functions = re.findall(r"def (\w+)\((.*)\):", text)
    assigned |= {name for name, _ in functions}
    assigned |= {each for _, given in functions for each in given.split(", ")}
    depth = 0
    for line in text.splitlines():
        code = re.sub(r'"[^"]*"', '""', line).partition("#")[0].rstrip()
        code = _NAMED_ARGUMENTS.sub("", code)
        unknown = set(re.findall(r"(?<![\w.])[A-Za-z_]\w*", code)) - assigned - _URSCRIPT
        assert not unknown, line
        if not code:
            continue
        depth -= bool(re.match(r"\s*(?:end|elif|else)\b", code))
        assert len(code) - len(code.lstrip()) == 2 * depth, line
        depth += bool(_OPENS.search(code.strip()) or re.match(r"\s*(?:elif|else)\b", code))
    assert depth == 0


def test_the_page_shows_the_example_and_has_a_row_for_each_task():
    shown = PAGE.read_text(encoding="utf-8")
    script = outcome(EXAMPLE).script
    assert script is not None
    assert plain(script.text) in shown
    assert all(plain(str(loss)).partition(": ")[2] in shown for loss in script.all_losses)
    table = shown.partition("<!-- urscript: table -->")[2].partition("<!-- end -->")[0]
    rows = re.findall(r"^\| `([\w-]+)` \|", table, re.M)
    assert rows == TASKS
    assert MAPPED
    assert f"{len(MAPPED)} of the {len(TASKS)} shipped tasks map" in shown


def test_lines_of_losses_are_those_of_the_file():
    script = outcome(EXAMPLE).script
    assert script is not None
    lines = (ROOT / "tasks" / f"{EXAMPLE}.yaml").read_text(encoding="utf-8").splitlines()
    force = next(loss for loss in script.all_losses if "force loop" in loss.text)
    assert lines[force.line - 1][force.column - 1 :].startswith("{force: -press, ramp: 0.3 s}")
    assert f"# LOST ({EXAMPLE}.yaml:{force.line}): {force.text}" in script.text


def test_a_live_param_is_set_at_a_register_and_others_follow_it():
    live = "params: {press: {value: 5 N, live: 2..8 N, rate: 4 N/s}, half: press / 2}\nstages:\n"
    stages = (
        "  a: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -half, within: {time: 2 s}}\n"
        "  b: {axes: {z: {force: -press}}, time: 1 s}\n"
    )
    head = _HEAD.replace("{max: 40 N, then: away}", "40 N").replace("stages:\n", live)
    text = script_of(plan_task(load_text(head + stages, "made.yaml"))).text
    about = "N, set at float input register 24 while boolean 64 is true"
    assert f"global PRESS = 5.0  # {about}\n" in text
    follows = "PRESS = followed(PRESS, 24, 2.0, 8.0, 4.0)"
    assert text.count(f"      {follows}\n      HALF = PRESS / 2.0\n") == 2
    assert "def followed(value, register, least, most, rate):" in text
    # A task without any has nothing of it.
    assert "followed" not in outcome(EXAMPLE).script.text


def test_live_params_without_a_register_stay_and_that_is_said():
    many = ", ".join(f"p{i}: {{value: 1 N, live: 0..2 N}}" for i in range(25))
    head = _HEAD.replace("{max: 40 N, then: away}", "40 N")
    head = head.replace("stages:\n", f"params: {{{many}}}\nstages:\n")
    sums = " - ".join(f"p{i}" for i in range(25))
    stage = f"  a: {{axes: {{z: {{force: -{sums}}}}}, time: 1 s}}\n"
    script = script_of(plan_task(load_text(head + stage, "made.yaml")))
    said = [loss.text for loss in script.all_losses if loss.text.startswith("the param")]
    assert len(said) == 1
    assert said[0].startswith("the param p24 stays at 1 N")
    assert "P23 = followed(P23, 47, 0.0, 2.0, 0.0)" in script.text


# Physics


def test_joints_and_flange_of_the_ur5e_are_the_manufacturers():
    """DH parameters of Universal Robots, whose base is half a turn from the model's."""
    a, d = (0, -0.425, -0.3922, 0, 0, 0), (0.1625, 0, 0, 0.1333, 0.0997, 0.0996)
    alpha = (math.pi / 2, 0, 0, math.pi / 2, -math.pi / 2, 0)
    robot = plan_task(load_task(ROOT / "tasks" / "sand-panel.yaml")).context.robot
    assert read_builtin("ur5e")
    data, base = robot.pin.createData(), pin.SE3(pin.rpy.rpyToMatrix(0, 0, math.pi), np.zeros(3))
    for q in ([0.0] * 6, [0.3, -1.2, 1.1, 0.4, -0.7, 0.9]):
        flange = pin.SE3.Identity()
        for i in range(6):
            turn = pin.SE3(pin.rpy.rpyToMatrix(0, 0, q[i]), np.array([0, 0, d[i]]))
            twist = pin.SE3(pin.rpy.rpyToMatrix(alpha[i], 0, 0), np.array([a[i], 0, 0]))
            flange = flange * turn * twist
        tip = base * flange * pin.SE3(np.eye(3), np.array([0, 0, 0.13]))
        pin.forwardKinematics(robot.pin, data, np.array(q))
        model = data.oMi[robot.tip_joint] * robot.tip
        np.testing.assert_allclose(model.homogeneous, tip.homogeneous, atol=1e-12)


@pytest.fixture(scope="module")
def functions():
    """The library's functions of numbers: these lines mean the same in Python."""
    names = {"RISE_TIME": RISE_TIME, "NOWHERE": 1e-9, "FADE_PEAK": 1.875}
    names |= {"norm": abs, "sqrt": math.sqrt, "pow": math.pow, "floor": math.floor}
    wanted = "travel travel_time from_rest risen smooth fade_time waypoint"
    for _, code in library(wanted).values():
        lines = [re.sub(r"\blocal ", "", line) for line in code if line.strip() != "end"]
        exec("\n".join(lines), names)
    return names


@pytest.mark.parametrize(
    ("distance", "speed"), [(0.05, 0.1), (-0.3, 0.25), (1e-3, 0.1), (2.0, 0.5)]
)
def test_moves_have_the_profile_of_the_simulator(functions, distance, speed):
    cubic = move(0.0, 0.0, distance, speed)
    lasts = float(cubic.rests)
    assert functions["travel_time"](distance, speed, RISE_TIME) == pytest.approx(lasts, abs=1e-9)
    for t in np.linspace(0.0, 1.2 * lasts, 101):
        expected = float(cubic(min(t, lasts)))
        found = functions["travel"](float(t), distance, speed, RISE_TIME)
        assert found == pytest.approx(expected, abs=1e-9)


def test_shapes_are_those_of_the_simulator(functions):
    for t in np.linspace(-0.1, 0.5, 61):
        s = float(t) / RISE_TIME
        assert functions["from_rest"](float(t)) == pytest.approx(blend.from_rest(float(t)))
        assert functions["risen"](1.0, 3.0, s) == pytest.approx(1 + 2 * blend.ramp_shape(s))
        if s >= 0:
            assert 1 - functions["smooth"](s) == pytest.approx(blend.offset_shape(s), abs=1e-12)
    assert functions["fade_time"](-0.1, 0.05) == pytest.approx(float(blend.blend_time(-0.1, 0.05)))
    table = [0.0, 1.0, 4.0]
    found = [functions["waypoint"](table, 3.0, 0.5, t) for t in (-1.0, 0.25, 0.75, 9.0)]
    assert found == pytest.approx([0.0, 0.5, 2.5, 4.0])


# What no shipped task has

_HEAD = """\
taskspec: 1
robot: {model: ur5e, tool: {length: 100 mm, mass: 200 g}, start: {xyz: [450 mm, 100 mm, 250 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 200 mm], stiffness: 20 kN/m}}
frames: {corner: {xyz: [400 mm, 0, 200 mm]}}
frame: corner
limits: {force: {max: 40 N, then: away}, deviation: 20 mm}
stages:
"""
_STAGES = """\
  down:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -2 N and position.x in world within 0.4 m..0.6 m
    within: 4 s
    repeat: 2
    attempts: 4
    next: [{when: down.visits < 5, to: knock}, {to: fail}]
  knock:
    axes:
      x: {position: 80 mm + 10 mm*sin(2*pi*t/(1 s))}
      z: {force: -5 N - 1 N*sin(clock*1 rad/s)}
    time: 2 s
    limits: {force: 30 N}
  away: {path: {to: [50 mm, 100 mm, 60 mm], time: 2 s}}
"""


def written(stages: str) -> str:
    head = _HEAD if "away" in stages else _HEAD.replace("{max: 40 N, then: away}", "40 N")
    return script_of(plan_task(load_text(head + stages, "made.yaml"))).text


def test_reactions_counters_coordinates_and_branches_are_written():
    text = written(_STAGES)
    _check_names(text)
    for line in (
        "if applied[2] < -2.0 and (where_in_world[0] >= 0.4 and where_in_world[0] <= 0.6):",
        "local where_in_world = tool_in(WORLD)",
        "if rounds_down < DOWN_REPEAT:",
        "if rounds_down == 1:",
        "if tries_down > DOWN_ATTEMPTS:",
        "if visits_down < 5.0:",
        'fail("down: force.z < -2 N and position.x in world within 0.4 m..0.6 m")',
        "local x_offset = place[0] - 0.08",
        "local own_time = from_rest(t - x_fade)",
        "if length_of(applied[0], applied[1], applied[2]) > KNOCK_MOST_FORCE:",
        'textmsg(PROGRAM, "down ends: limit on force: 40 N")',
        "clock = clock + STEP",
        "if force_kept and length_of(applied[0], applied[1], applied[2]) > MOST_FORCE:",
        "local z_way = AWAY_Z_TO - place[2]",
        "local path_speed = larger(path_length, NOWHERE) / (AWAY_PATH_TIME - AWAY_RISE)",
        "movej(START_JOINTS, a=START_ACCELERATION, v=START_SPEED)",
    ):
        assert line in text
    assert "KNOCK_BOUNDS = [0.02, 0.02, " in text


def test_a_way_to_a_point_is_as_long_as_all_its_coordinates_make_it():
    text = written("  go: {path: {to: [0, 50 mm, 60 mm, 0, 0, 5 deg], speed: 50 mm/s}}\n")
    _check_names(text)
    assert "local path_length = length_of(x_way, y_way, z_way)\n" in text
    assert "  path_length = length_of(rx_way, ry_way, rz_way)\n" in text


def test_names_of_a_file_take_none_of_the_programs():
    text = written("  start: {path: {line: {by: [50 mm]}, speed: 90 mm/s}}\n  Start: {time: 1 s}\n")
    _check_names(text)
    globals_ = re.findall(r"global (\w+) =", text)
    assert len(globals_) == len(set(globals_)) > 0
    assert "global START_SPEED = 0.5 " in text
    assert "global START_SPEED_2 = 0.09 " in text


@pytest.mark.parametrize(
    ("stages", "place", "reason"),
    [
        (
            "  a: {axes: {z: {velocity: -20 mm/s}}, until: std(force.z) > 1 N, within: 1 s}\n",
            "8:47",
            "'std' over a stage is not kept",
        ),
        (
            "  a: {axes: {z: {velocity: -20 mm/s * table.gap/(9 mm)}}, time: 1 s}\n",
            "8:39",
            "the program does not measure 'table.gap'",
        ),
        (
            "  a: {path: {waypoints: {points: [[1 mm, 0], [2 mm, 5 mm]]}, speed: 10 mm/s}}\n",
            "8:13",
            "make it 'to'",
        ),
    ],
)  # fmt: skip
def test_a_part_that_does_not_map_is_refused_at_its_place(stages, place, reason):
    with pytest.raises(NotMappedError) as refused:
        written(stages)
    (found,) = refused.value.reasons
    assert found.startswith(f"made.yaml:{place}: ")
    assert reason in found


_SERVO = (
    _HEAD.replace("{model: ur5e,", "{model: ur5e, command: velocity,")
    .replace("{max: 40 N, then: away}", "40 N")
    .replace("stages:\n", "law: admittance\nstages:\n")
)


def test_of_an_arm_that_takes_velocities_its_servo_is_lost_and_a_soft_axis_is_no_servoj():
    press = "  a: {axes: {z: {force: -5 N}}, time: 1 s}\n"
    script = script_of(plan_task(load_text(_SERVO + press, "made.yaml")))
    said = [loss.text for loss in script.all_losses]
    assert any(text.startswith("the joint velocities and their servo") for text in said), said
    assert any(text.startswith("the force loop of the admittance law on z") for text in said)
    soft = "  a: {axes: {z: {move: -60 mm, stiffness: 500 N/m}}, time: 1 s}\n"
    with pytest.raises(NotMappedError, match="spring of the admittance law presses on 'table'"):
        script_of(plan_task(load_text(_SERVO + soft, "made.yaml")))


# The command


def test_the_command_writes_a_program_and_says_what_is_lost(tmp_path):
    path = tmp_path / "held.script"
    file = ROOT / "tasks" / "unknown-load.yaml"
    done = CliRunner().invoke(app, ["export", str(file), "--urscript", str(path)])
    assert done.exit_code == 0, done.output
    script = outcome("unknown-load").script
    assert script is not None
    assert plain(path.read_text(encoding="utf-8")) == plain(script.text)
    lost = [line for line in done.output.splitlines() if ": lost: " in line]
    assert len(lost) == len(script.all_losses) > 0
    assert all(re.match(rf"{re.escape(str(file))}:\d+:\d+: lost: ", line) for line in lost)
    assert "never executed" in done.output


@pytest.mark.parametrize(
    ("task", "options", "message"),
    [
        ("ring", ["--urscript", "x.script"], "ring.yaml:15:8: an equation constrains the motion"),
        ("unknown-load", ["--urscript", "no/where.script"], "cannot be written"),
        ("unknown-load", ["--urscript", "x.script", "--csv"], "--urscript of a task file"),
        ("unknown-load", ["--urscript", "x.script", "--c", "x"], "name one"),
    ],
)
def test_the_command_refuses_by_name(task, options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = ROOT / "tasks" / f"{task}.yaml"
    done = CliRunner().invoke(app, ["export", str(file), *options])
    assert done.exit_code == 2
    assert message in done.output
    assert not (tmp_path / "x.script").exists()


def test_generated_parts_have_their_places():
    shown = PAGE.read_text(encoding="utf-8")
    assert page_with(shown, {"table": "x"}).count("\nx\n") == 1
    assert set(re.findall(r"<!-- urscript: (\w+) -->", shown)) == {"table", "losses", "program"}
    assert parts
