"""The sheet of a task: what `explain` says of constraints and of its trial, and as data."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_task, load_text
from taskspec_runner.cli.app import app
from taskspec_runner.cli.sheet.at_rest import grouped
from taskspec_runner.cli.sheet.collisions import collision_rows
from taskspec_runner.cli.sheet.stage import stage_sheet
from taskspec_runner.cli.sheet.visits import stage_trials
from taskspec_runner.trial.trial import trial
from taskspec_runner.verdict.response import responses

TASKS = Path(__file__).parents[2] / "tasks"


def accounts(loaded):
    """Stages by name as the plan has them: without a trial and poles, which take time."""
    program = compile_unchecked(loaded)
    return {s.name: stage_sheet(program, s, None, None) for s in program.stages}


def tried(loaded):
    """Stages by name with what they came to, and the trial."""
    program = compile_unchecked(loaded)
    one = trial(program)
    came_to = stage_trials(one)
    return {s.name: stage_sheet(program, s, one, came_to[s.name]) for s in program.stages}, one


@pytest.fixture(scope="module")
def stages():
    """Stages of shipped tasks by name, each task planned once."""
    told = {}

    def find(task, stage):
        if task not in told:
            told[task] = accounts(load_task(TASKS / f"{task}.yaml"))
        return told[task][stage]

    return find


@pytest.fixture(scope="module")
def tried_stages():
    """Stages of shipped tasks by name, and the trial; each task is run once."""
    told = {}

    def find(task):
        if task not in told:
            told[task] = tried(load_task(TASKS / f"{task}.yaml"))
        return told[task]

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
        # Signal, set point, at rest, closed form, its source.
        ("wipe-table", "wipe", ("force.z", "-15 N", "-15 N", "-15 N", "set point")),
        ("wipe-table", "wipe", ("table.gap", "-", "-0.728 mm", "-", "")),
        ("tilted-force", "press", ("force.y", "0", "0", "0", "(4.41)")),
        ("crank", "rotate",
         ("crank.torque", "-", "0.167 N*m", "0.167 N*m", "friction and damping")),
        ("tilted-force", "press", ("force.x", "0", "3.42 N", "3.42 N", "(4.48)")),
        ("press-pd", "press", ("force.z", "-", "-20 N", "-20 N", "(4.26), (4.27)")),
        ("press-pd", "press", ("position.z", "-12 mm", "-2 mm", "-", "")),
    ],
)  # fmt: skip
def test_what_signals_settle_at(tried_stages, task, stage, row):
    found = [*grouped(tried_stages(task)[0][stage].at_rest)]
    assert row in [(c[0], c[1], c[2], c[5], c[6]) for c in found]


def test_a_stage_in_its_trial(tried_stages):
    """It is what the columns have: when it was entered, its largest force, its blow."""
    sheets, one = tried_stages("wipe-table")
    approach = sheets["approach"].trial
    first, second, _ = one.history.visits()
    assert [v.to for name in sheets for v in sheets[name].trial.visits] == [
        "wipe",
        "retreat",
        "end",
    ]
    assert approach.visits[0].lasts == pytest.approx(1e-3 * (first.last + 1))
    assert sheets["wipe"].trial.visits[0].begins == pytest.approx(1e-3 * second.first)
    assert dict(approach.rows)["trial"] == (
        "at 0 s for 1.447 s, until force.z < -2 N for 10 ms -> wipe"
    )
    force = [one.history.columns[f"force.{axis}"][first.rows] for axis in "xyz"]
    assert approach.peaks["force"] == pytest.approx(np.linalg.norm(force, axis=0).max())
    touch = approach.touch
    assert one.history.columns["touching"][touch.touch.row - 1 : touch.touch.row + 1].tolist() == [
        0.0,
        1.0,
    ]
    assert touch.touch.contact == "table"
    assert touch.touch.speed == pytest.approx(0.03, rel=1e-3)
    assert touch.touch.peak == pytest.approx(0.03 * (touch.touch.mass * 20e3) ** 0.5, rel=1e-3)
    # The stage after it presses too: the contact bears at least what is left of the blow.
    assert touch.touch.peak / math.e < touch.force < 1.3 * touch.touch.peak
    # What pressed before begins no touch of its own.
    assert sheets["wipe"].trial.touch is None


def test_a_response_is_that_of_the_summary(tried_stages):
    sheets, one = tried_stages("wipe-table")
    row = next(r for r in sheets["wipe"].at_rest if r.signal == "force.z")
    period = one.program.context.period
    kept = responses(one.history, {"wipe": {"force.z": None}}, period, {})["wipe"]["force.z"]
    assert row.rest == kept["rest"]
    assert row.overshoot == kept["overshoot"]
    assert row.settling_time == kept["settling_time"]


def test_stages_that_are_visited_often_and_never():
    text = """
taskspec: 1
name: turns
robot: {model: planar2, start: {xyz: [400 mm, 100 mm, 0]}}
stages:
  go: {axes: {x: {move: 1 mm}}, repeat: 5, next: end}
  never: {axes: {x: {move: 1 mm}}}
"""
    sheets, _ = tried(load_text(text, "turns.yaml"))
    assert len(sheets["go"].trial.visits) == 5
    rows = [value for key, value in sheets["go"].trial.rows if key == "trial"]
    assert len(rows) == 4
    assert rows[-1] == "5 visits in all"
    assert [*sheets["never"].trial.rows] == [("trial", "does not come to this stage")]


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


def data_of(*options):
    arguments = ["explain", str(TASKS / "wipe-table.yaml"), "--format", "json", *options]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_as_data():
    data = data_of()
    approach, wipe, _ = data["stages"]
    # SI, in the signs of the file.
    force = next(row for row in wipe["at_rest"] if row["signal"] == "force.z")
    assert force["law"] == {"value": -15.0, "source": "set point"}
    assert force["rest"] == pytest.approx(-15.0, abs=0.01)
    gap = next(row for row in wipe["at_rest"] if row["signal"] == "table.gap")
    # The simulator's friction of a tool that slides bears 4 % of what presses.
    assert gap["rest"] == pytest.approx(-15 / 20e3, rel=0.05)
    touch = approach["trial"]["touch"]
    assert touch["blow"] == pytest.approx(touch["speed"] * (touch["mass"] * 20e3) ** 0.5)
    assert wipe["selection"]["S_f"] == "diag(0 0 1 0 0 0)"
    assert wipe["natural"][2]["state"] == "there"
    assert wipe["selected"]["axes"] == ["x", "y", "z", "rx", "ry", "rz"]
    trial = data["trial"]
    assert (trial["status"], trial["exit_code"]) == ("done", 0)
    assert trial["duration"] == pytest.approx(10.147)
    assert [each["passed"] for each in trial["expectations"]] == [True, True, True]


def test_without_a_trial_the_plan_stays():
    data = data_of("--static")
    assert data["trial"] is None
    assert [stage["trial"] for stage in data["stages"]] == [None, None, None]
    (force,) = data["stages"][1]["at_rest"]
    assert (force["law"]["value"], force["rest"]) == (-15.0, None)
    arguments = ["explain", str(TASKS / "wipe-table.yaml"), "--static"]
    shown = CliRunner().invoke(app, arguments).stdout
    rows = [" ".join(line.split()) for line in shown.splitlines()]
    assert "trial left out: --static" in rows
    assert "force.z -15 N set point" in rows
    assert not any(row.startswith(("peaks", "first touch")) for row in rows)


def test_a_trial_that_does_not_come_to_its_end_says_where():
    changed = "stages.approach.within={time: 0.5 s}"
    arguments = ["explain", str(TASKS / "wipe-table.yaml"), "--set", changed]
    shown = CliRunner().invoke(app, arguments).stdout
    rows = [" ".join(line.split()) for line in shown.splitlines()]
    assert any(row.startswith("trial fails in stage 'approach' after 0.5 s") for row in rows)
    assert rows.count("trial does not come to this stage") == 2


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
    (text,) = [value for key, value in collision_rows(program) if key == "collisions"]
    assert text == (
        "links are held against table; not against belt, which moves; not against part, which "
        "is loose; not against plate, which rides on a mechanism"
    )
    empty = WORLD[: WORLD.index("world:")] + WORLD[WORLD.index("stages:") :]
    program = compile_unchecked(load_text(empty, "t.yaml"))
    assert not [*collision_rows(program)]


# Terms


def explained(*words):
    result = CliRunner().invoke(app, ["explain", *words, "--format", "json"])
    assert result.exit_code == 0, result.output
    return {each["name"]: each for each in json.loads(result.stdout)["stages"]}


def test_terms_are_shown_where_they_are_wanted():
    """Masses of all configurations, H_x and g_x of the first; the region of (4.65) and (4.71)."""
    path = str(TASKS / "press-parallel-pid.yaml")
    stages = explained(path, "--terms")
    assert set(stages) == {"approach", "press", "lift"}
    for stage in stages.values():
        terms = stage["terms"]
        inertia = np.array(terms["inertia"])
        assert inertia.shape == (6, 6)
        np.testing.assert_allclose(inertia, inertia.T)
        masses = np.linalg.eigvalsh(inertia[:3, :3])
        assert terms["masses"][0] <= masses[0] + 1e-9
        assert masses[-1] <= terms["masses"][1] + 1e-9
        assert terms["coriolis"] > 0
    assert stages["lift"]["terms"]["region"] > stages["press"]["terms"]["region"] > 0
    assert stages["lift"]["terms"]["damping"] is None
    # rho (lambda_M + Phi k_Cx) by hand.
    press = stages["press"]
    gains = {(g["gain"], axis): g for g in press["gains"] for axis in g["axes"]}
    assert gains["force.integral", "z"]["value"]
    has, needs = press["terms"]["damping"]
    assert needs > 0
    assert has > 0
    assert "terms" not in [key for key, value in explained(path)["press"].items() if value]


def test_the_condition_of_theorem_4_1_by_hand(tmp_path):
    """rho = k_I / (1 + k_F) = 4 / 1.5; d_m is the least damping of the translations."""
    law = (
        "{kind: parallel-pid, stiffness: 400 N/m, damping: 60 N*s/m, "
        "force: {proportional: 0.5, integral: 4 /s}}"
    )
    path = tmp_path / "press.yaml"
    path.write_text(
        "taskspec: 1\nrobot: {model: planar2, start: {joints: [20 deg, 80 deg]}}\n"
        f"law: {law}\nstages: {{push: {{axes: {{x: {{force: 0}}}}, time: 0.1 s}}}}\n"
    )
    (stage,) = explained(str(path), "--terms").values()
    terms = stage["terms"]
    has, needs = terms["damping"]
    assert has == 60
    least = 4 / 1.5 * terms["masses"][1]
    assert needs == pytest.approx(least + 4 / 1.5 * terms["region"] * terms["coriolis"], rel=0.02)
    shown = CliRunner().invoke(app, ["explain", str(path), "--terms"]).stdout
    assert "holds: d_m = 60 N*s/m, rho (lambda_M + Phi k_Cx) = " in " ".join(shown.split())


def test_terms_without_a_trial_and_of_a_stage_that_is_not_reached():
    path = str(TASKS / "wipe-table.yaml")
    at_start = explained(path, "--terms", "--static")
    assert {each["terms"]["where"] for each in at_start.values()} == {"at the start pose"}
    unreached = explained(str(TASKS / "peg-in-hole.yaml"), "--terms")["lift"]["terms"]
    assert unreached == "the trial does not come to this stage"


def test_live_params_with_bounds_and_rates(tmp_path):
    path = tmp_path / "live.yaml"
    path.write_text("""
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.2}}
params:
  level: {value: 12 N, live: 5..20 N, rate: 10 N/s}
  side: {value: 0, live: +- 20 mm, rate: 20 mm/s}
  half: level / 2
  soft: {value: 800 N/m, live: 400..1200 N/m}
law: {kind: impedance, stiffness: {x: soft, y: soft, z: 1000 N/m}}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -half, within: {time: 2 s}}
  press: {axes: {z: {force: -level}, x: {position: 500 mm + side}}, time: 1 s}
expect: []
""")
    words = ["explain", "--static", str(path)]
    shown = CliRunner().invoke(app, words)
    assert shown.exit_code == 0, shown.output
    rows = [line.split("  ") for line in shown.stdout.splitlines()]
    cells = [[cell.strip() for cell in row if cell.strip()] for row in rows]
    assert ["level", "12 N", "5 N to 20 N", "10 N/s"] in cells
    assert ["side", "0 mm", "-20 mm to 20 mm", "20 mm/s"] in cells
    assert ["soft", "800 N/m", "400 N/m to 1.2 kN/m", "at once"] in cells
    data = json.loads(CliRunner().invoke(app, [*words, "--format", "json"]).stdout)["live"]
    assert list(data) == ["level", "side", "soft"]
    wanted = {"value": 12.0, "low": 5.0, "high": 20.0, "rate": 10.0, "unit": "N"}
    assert data["level"] == wanted
    plain = CliRunner().invoke(app, ["explain", "--static", str(TASKS / "wipe-table.yaml")])
    assert plain.exit_code == 0
    assert "live params" not in plain.stdout
