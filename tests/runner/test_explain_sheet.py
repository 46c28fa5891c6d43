"""The sheet of a task: what `explain` says of constraints and of what is expected, and as data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taskspec.compiler import compile_unchecked
from taskspec.prediction import predict
from taskspec.spec import load_task, load_text
from taskspec_runner.cli.app import app
from taskspec_runner.cli.sheet.sheet import sheet
from taskspec_runner.cli.sheet.stage import stage_sheet

TASKS = Path(__file__).parents[2] / "tasks"


def accounts(loaded):
    """Stages by name, without poles, which take most of the time."""
    program = compile_unchecked(loaded)
    predicted = predict(program, {})
    return {s.name: stage_sheet(program, s, predicted[s.name]) for s in program.stages}


@pytest.fixture(scope="module")
def stages():
    """Stages of shipped tasks by name, each task told once."""
    told = {}

    def find(task, stage):
        if task not in told:
            told[task] = accounts(load_task(TASKS / f"{task}.yaml"))
        return told[task][stage]

    return find


@pytest.mark.parametrize(
    ("task", "stage", "row"),
    [
        ("wipe-table", "approach",
         ("z", "f_z = 0, then v_z = 0 (table)", "v_z = -30 mm/s",
          "motion control, yields to table")),
        ("wipe-table", "wipe",
         ("x", "|f_x| <= 0.2 |f_z| (table)", "x = 60 mm * sin(2*pi*t/(4 s))", "motion control")),
        ("wipe-table", "wipe",
         ("z", "v_z = 0 (table, pushes only)", "f_z = -press, reached in 0.3 s", "force control")),
        ("wipe-table", "retreat",
         ("z", "v_z >= 0 (table)", "z moves 50 mm at 100 mm/s", "motion control, yields to table")),
        ("door-handle", "open",
         ("y", "f_y = door.torque / 400 mm - m_z / 400 mm", "v_y = 140 mm/s", "motion control")),
        ("door-handle", "open",
         ("rz", "w_z = v_y / 400 mm (door)", "rz follows door", "motion control, as door goes")),
        ("crank", "rotate", ("rz", "m_z = 0", "w_z = 0 in the world", "motion control")),
        ("screw", "screw_down",
         ("z", "v_z = 4 mm/turn w_z (cap)", "z follows cap", "motion control, as cap goes")),
        ("tilted-force", "press",
         ("x", "f_x = -0.176 f_z (table)", "v_x = 0; f_x = 0", "force over motion, free to move")),
        ("press-pd", "press",
         ("z", "v_z = 0 (table, pushes only)", "z = -12 mm", "impedance, yields to table")),
        ("ring", "round",
         ("x", "v_x = 0 (rim, where it begins)", "x by path: arc", "motion control, along rim")),
        ("ring", "round",
         ("rim", "x^2 + y^2 = (90 mm)^2", "f = 10 N along its gradient", "force control")),
        ("linkage", "up", ("rz", "w_z = 0 (bars)", "w_z = 0", "the world (bars)")),
        ("wipe-friction", "lean",
         ("x", "|f_x| <= 0.3 |f_z| (table)", "f_x = 4 N, reached in 1 s",
          "force control, held by friction")),
    ],
)  # fmt: skip
def test_constraints_of_an_axis(stages, task, stage, row):
    found = {a.axis: a for a in stages(task, stage).axes}[row[0]]
    assert (found.axis, found.natural, found.artificial, found.by) == row


@pytest.mark.parametrize(
    ("task", "stage", "row"),
    [
        ("wipe-table", "approach",
         ("impact on table", "up to 8.2 N, 7.1 N of it before the guard",
          "up to 16 N at table.stiffness = 80 kN/m",
          "3.7 kg at 30 mm/s on 20 kN/m")),
        ("wipe-table", "approach", ("duration", "1.45 s, at most 4 s", "", "comes to table")),
        ("wipe-table", "wipe",
         ("into table", "0.75 mm", "3 mm at table.stiffness = 5 kN/m", "f / k")),
        ("crank", "rotate",
         ("force.x force.z torque.rx torque.ry", "0", "", "set point")),
        ("crank", "rotate", ("crank.torque", "0.167 N*m", "", "friction and damping")),
        ("tilted-force", "press",
         ("drift", "20.8 mm/s", "", "of set points that nothing returns")),
        ("linkage", "up", ("into bars", "0.0573 deg", "", "f / k")),
        ("press-pd", "press", ("force.z", "-20 N", "", "(4.26), (4.27)")),
    ],
)  # fmt: skip
def test_what_is_expected(stages, task, stage, row):
    found = [(e.what, e.value, e.worst, e.source) for e in stages(task, stage).expected]
    assert row in found


GRIPPED = """
taskspec: 1
name: gripped
robot: {model: panda, grasp: door.handle, start: {rpy: [180 deg, -30 deg, 0]}}
world: {door: {mechanism: hinge, xyz: [600 mm, -350 mm, 400 mm], handle: [0, 400 mm, 0]}}
frame: door.handle
stages: {open: {axes: {x: {force: 0}, y: {velocity: 50 mm/s}, z: {move: 1 mm}}, time: 1 s}}
"""


def test_motion_on_what_the_world_decides_is_told():
    account = accounts(load_text(GRIPPED, "gripped.yaml"))["open"]
    by = {a.axis: a.by for a in account.axes}
    assert by["rx"] == "motion control, door holds it too"
    assert by["z"] == "motion control, against door"
    assert by["x"] == "force control"
    # The frame turns with the door, and the tool with the frame.
    (rz,) = (a for a in account.axes if a.axis == "rz")
    assert (rz.natural, rz.artificial, rz.by) == (
        "w_z = v_y / 400 mm (door)",
        "rz held, turns with the frame",
        "motion control, as door goes",
    )


def test_selection_where_directions_lie_between_axes():
    """On the slope z = -x tan 10 deg, S_f is along its normal and S_v along it."""
    task = """
taskspec: 1
name: slope
robot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}
world: {slope: {equation: "0.6*x + 0.8*z = 540 mm", stiffness: 20 kN/m}}
law: hybrid-multipliers
stages: {press: {constraints: {slope: {force: 5 N}}, axes: {x: {move: 10 mm}}}}
"""
    account = accounts(load_text(task, "slope.yaml"))["press"]
    assert dict(account.selection) == {
        "S_f": "(0.6 0 0.8 0 0 0)^T",
        "S_v": "(1 0 -0.75 0 0 0)^T, (0 1 0 0 0 0)^T, (0 0 0 1 0 0)^T, (0 0 0 0 1 0)^T, "
        "(0 0 0 0 0 1)^T",
    }
    tied = {a.axis: a.natural for a in account.axes}
    assert tied["z"] == "v_z = -0.75 v_x (slope)"
    assert tied["x"] == "f_x = 0.75 f_z (slope)"


def test_as_data():
    result = CliRunner().invoke(
        app, ["explain", str(TASKS / "wipe-table.yaml"), "--format", "json"]
    )
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    approach, wipe, _ = data["stages"]
    # SI, in the signs of the file.
    assert wipe["prediction"]["equilibrium"]["force.z"]["value"] == -15.0
    depth = wipe["prediction"]["depths"]["table"]
    assert depth["depth"] == pytest.approx(15 / 20e3)
    assert depth["worst"]["with"] == [
        {"path": "world.table.stiffness", "index": None, "value": 5000.0}
    ]
    impact = approach["prediction"]["impact"]
    assert impact["peak"] == pytest.approx(0.03 * (impact["mass"] * 20e3) ** 0.5)
    z = wipe["prediction"]["settling"]["z"]
    assert z["settling_time"] == pytest.approx(3.912 * z["time_constant"], rel=1e-3)
    assert wipe["selection"]["S_f"] == "diag(0 0 1 0 0 0)"
    assert wipe["prediction"]["natural"][2]["state"] == "there"
    assert data["duration"]["expected"] == pytest.approx(10.147, abs=0.01)


def test_what_is_only_otherwise_in_truth_is_no_worst_of_vary():
    path, changed = str(TASKS / "press-hybrid.yaml"), "truth.world.table.stiffness=5 kN/m"
    shown = CliRunner().invoke(app, ["explain", path, "--set", changed]).output
    heads = [line.split() for line in shown.splitlines() if line.split()[:1] == ["predicted"]]
    assert ["predicted", "is", "in", "truth", "from"] in heads
    assert not any("vary" in head for head in heads)
    assert "4 mm at table.stiffness = 5 kN/m" in shown


def test_a_code_as_data():
    result = CliRunner().invoke(app, ["explain", "TS203", "--format", "json"])
    data = json.loads(result.stdout)
    assert data["code"] == "TS203"
    assert data["page"].startswith(f"# TS203: {data['title']}")


def test_the_document_shows_what_is_printed():
    document = (TASKS.parent / "docs" / "sheet.md").read_text(encoding="utf-8")
    block = document.partition("```text\n")[2].partition("```")[0]
    printed = CliRunner().invoke(app, ["explain", str(TASKS / "wipe-table.yaml")]).stdout
    assert block.strip() in printed


WORLD = """
taskspec: 1
robot: {model: panda, tool: {shape: sphere, radius: 10 mm, length: 100 mm},
  start: {joints: [0, -1.2 rad, 0, -2.8 rad, 0, 1.6 rad, 0.7854 rad]}}
world:
  table: {shape: plane, xyz: [0, 0, -100 mm]}
  belt: {shape: plane, xyz: [0, 0, -200 mm], motion: {x: 10 mm/s * clock}}
  part: {shape: box, size: [50 mm, 50 mm, 50 mm], free: true, mass: 1 kg, xyz: [600 mm, 0, -75 mm]}
  sledge: {mechanism: slide, xyz: [-700 mm, 0, 0]}
  plate: {shape: box, size: [50 mm, 50 mm, 50 mm], on: sledge, xyz: [0, 0, 0]}
stages:
  unfold: {path: {joints: [0, 0, 0, -120 deg, 0, 120 deg, 45 deg], speed: 30 deg/s}}
"""


def test_what_is_not_held_against_the_links_is_said():
    program = compile_unchecked(load_text(WORLD, "t.yaml"))
    (text,) = [value for key, value in sheet(program).robot if key == "collisions"]
    assert text == (
        "links are held against table; not against belt, which moves; not against part, which "
        "is loose; not against plate, which rides on a mechanism"
    )
    corner = sheet(compile_unchecked(load_task(TASKS / "corner.yaml")))
    assert dict(corner.robot)["collisions"] == (
        "links are held against floor, wall; not in 'press', 'slide', whose ways are not known"
    )
    empty = WORLD[: WORLD.index("world:")] + WORLD[WORLD.index("stages:") :]
    program = compile_unchecked(load_text(empty, "t.yaml"))
    assert "collisions" not in dict(sheet(program).robot)
