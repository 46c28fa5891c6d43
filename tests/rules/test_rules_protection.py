"""What is said of tasks that do not keep to the robot's protection, and how their runs end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.spec import load_text
from taskspec.spec.robot_file import built_in
from taskspec.text.diagnostic import SpecError
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.trial.check import check
from taskspec_runner.verdict.protected import sentences

ARM = """\
taskspec: 1
name: protected
robot:
  model: panda
  start: {xyz: [500 mm, 0, 340 mm]}
  protection: PROTECTION
"""
MOVE = ARM + "stages:\n  over: {axes: {x: {move: 100 mm, speed: 200 mm/s}}}\n"
PRESS = (
    ARM
    + """\
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}
frames: {task: {surface: table}}
frame: task
stages:
  down: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N, within: {time: 4 s}}
  press: {axes: {z: {force: -15 N}}, time: 0.6 s}
"""
)
#: docs/conventions.md: a move of speed s has jerks of 4 s/T^2, accelerations of 2 s/T at most.
T, SPEED = 0.2, 0.2


def task(text: str, protection: str) -> str:
    return text.replace("PROTECTION", protection)


def codes(text: str) -> list[str]:
    return [each.code for each in check(load_text(text, "task.yaml")).findings]


def run(text: str, out: Path, loop: str | None = None) -> Run:
    execute(load_text(text, "task.yaml"), out, loop=loop, report=False, force=True)
    return Run.load(out)


@pytest.mark.parametrize(
    ("key", "unit", "peak"),
    [("speed", "m/s", SPEED), ("acceleration", "m/s^2", 2 * SPEED / T), ("jerk", "m/s^3", None)],
)
def test_a_move_is_held_against_its_closed_form(key, unit, peak):
    """Between 5 % more than the closed form has, and 5 % less: differences are within that."""
    if peak is None:
        # Four times that of the ramp is where third differences of a cubic's pieces lie.
        peak = 4 * SPEED / T**2
    beyond, within = (f"{{source: s, tip: {{{key}: {x * peak:.5f} {unit}}}}}" for x in (0.95, 1.05))
    assert "TS443" in codes(task(MOVE, beyond))
    assert codes(task(MOVE, within)) == []


HANDED = (
    ARM
    + """\
stages:
  go: {axes: {x: {velocity: 100 mm/s}}, time: 0.5 s}
  next: {axes: {x: {velocity: RATE mm/s}}, time: 0.5 s}
"""
)


@pytest.mark.parametrize("rate", [100, 60, 0, -50])
def test_a_stage_goes_on_from_the_rate_before(rate, tmp_path):
    """Accelerations are those of a run's references, over the change of stage too."""
    text = task(HANDED, "{source: s, tip: {speed: 9 m/s}}").replace("RATE", str(rate))
    reference = run(text, tmp_path / "run").columns["velocity.x.ref"]
    most = float(np.abs(np.diff(reference[500:])).max()) / 1e-3
    assert (most < 1e-6) == (rate == 100)
    # The first stage rises from rest, which is the largest change for small ones.
    largest = float(np.abs(np.diff(reference)).max()) / 1e-3
    for share in (0.95, 1.05):
        bound = text.replace("speed: 9 m/s", f"acceleration: {share * largest:.6f} m/s^2")
        assert ("TS443" in codes(bound)) == (share < 1)


def test_joints_are_those_of_a_run(tmp_path):
    """The arm of a run follows the references: its joints get as fast as they ask for, to 10 %."""
    # An arm without joints to spare does nothing beside.
    text = task(MOVE, "{source: s, joints: {speed: 9 rad/s}}").replace("panda", "ur5e")
    window = run(text, tmp_path / "run").columns
    v = np.array([window[f"joint.{i + 1}.velocity"] for i in range(6)])
    most = float(np.abs(np.diff(v, axis=1)).max()) / 1e-3
    for share in (0.9, 1.1):
        bound = text.replace("speed: 9 rad/s", f"acceleration: {share * most:.5f} rad/s^2")
        assert ("TS443" in codes(bound)) == (share < 1)


def test_set_points_are_held_against_reflex_and_range():
    for group in ("reflex", "sensor"):
        assert "TS444" in codes(task(PRESS, f"{{source: s, {group}: {{force: 14 N}}}}"))
        assert codes(task(PRESS, f"{{source: s, {group}: {{force: 18 N}}}}")) == []


def test_torque_rates_are_those_of_a_run(tmp_path):
    made = run(task(PRESS, "{source: s, joints: {torque_rate: 5000 N*m/s}}"), tmp_path / "run")
    window = made.columns
    torques = np.array([window[f"joint.{i + 1}.torque"] for i in range(7)])
    most = np.abs(np.diff(torques, axis=1)).max() / 1e-3
    beyond, within = (
        f"{{source: s, joints: {{torque_rate: {x * most:.1f} N*m/s}}}}" for x in (0.95, 1.05)
    )
    assert codes(task(PRESS, beyond)) == ["TS445"]
    assert codes(task(PRESS, within)) == []


@pytest.mark.parametrize(
    ("text", "protection", "words"),
    [
        (MOVE, "{source: s, tip: {speed: 150 mm/s}}", "speed of the tip"),
        (MOVE, "{source: s, joints: {speed: 0.2 rad/s}}", "speed of joint"),
        (PRESS, "{source: s, reflex: {force: 10 N}}", "reflex at a force"),
        (PRESS, "{source: s, sensor: {force: 12 N}}", "range of the sensor, force"),
    ],
)
def test_a_run_ends_by_what_is_exceeded(text, protection, words, tmp_path):
    logs = []
    for loop in ("native", "python"):
        made = run(task(text, protection), tmp_path / loop, loop)
        assert made.summary["ending"]["reason"] == "protection"
        assert made.summary["ending"]["text"].startswith(f"protection: {words}")
        logs.append((tmp_path / loop / "log.arrow").read_bytes())
    assert logs[0] == logs[1]


def test_the_summary_says_how_near_a_run_came(tmp_path):
    bounds = "{source: s, joints: {torque_rate: 5000 N*m/s}, tip: {speed: 1 m/s}}"
    made = run(task(PRESS, bounds), tmp_path / "run")
    told = {each["is"]: each for each in made.summary["protection"]}
    assert len(told) == 8
    torque = np.abs(np.diff(made.columns["joint.2.torque"])).max() / 1e-3
    assert told["torque rate of joint 2"]["most"] == pytest.approx(torque)
    assert told["torque rate of joint 2"]["share"] == pytest.approx(torque / 5000)
    assert told["speed of the tip"]["most"] == pytest.approx(made.columns["speed"].max())
    assert next(sentences(made.summary)).startswith("protection: nearest is the torque rate of")
    plain = run(task(PRESS, "panda").replace("  protection: panda\n", ""), tmp_path / "plain")
    assert "protection" not in plain.summary
    assert not list(sentences(plain.summary))


def test_an_arm_that_is_commanded_no_torques_is_not_held_to_their_rates(tmp_path):
    bounds = "{source: s, joints: {speed: 3 rad/s, torque_rate: 1 N*m/s}}\n  command: velocity"
    saved = run(task(MOVE, bounds).replace("100 mm, speed", "1 mm, speed"), tmp_path / "run")
    found = [each["is"] for each in saved.summary["protection"]]
    assert found == [f"speed of joint {i}" for i in range(1, 8)]


def test_a_turn_is_watched(tmp_path):
    text = ARM + "stages:\n  swing: {axes: {rz: {move: 20 deg, speed: 30 deg/s}}}\n"
    bound = "{source: s, turn: {speed: 20 deg/s}}"
    assert "TS443" in codes(task(text, bound))
    made = run(task(text, bound), tmp_path / "run")
    assert "rate at which the tool turns: 20 deg/s" in made.summary["ending"]["text"]


def test_qp_keeps_the_torque_rate():
    text = task(PRESS, "{source: s, joints: {torque_rate: 300 N*m/s}}")
    program = load_text(text + "law: {solve: qp}\n", "task.yaml")
    for stage in compile_task(program).stages:
        assert stage.plan.limits.torque_rate == 300
    own = text + "law: {solve: qp}\nlimits: {torque_rate: 200 N*m/s}\n"
    for stage in compile_task(load_text(own, "task.yaml")).stages:
        assert stage.plan.limits.torque_rate == 200


def test_built_in_protections_have_sources_and_let_a_press_pass():
    assert "panda" in built_in("protection")
    loaded = load_text(task(PRESS, "panda"), "task.yaml")
    protection = loaded.task.robot.protection
    assert protection is not None
    assert all("frankaemika/docs" in protection.source_of(group) for _, group in protection.groups)
    assert codes(task(PRESS, "panda")) == []


def test_a_file_of_ones_own(tmp_path):
    (tmp_path / "arm.yaml").write_text("source: s\nreflex: {force: 14 N}\n")
    loaded = load_text(task(PRESS, "arm.yaml"), str(tmp_path / "task.yaml"), base=tmp_path)
    assert [path.name for path in loaded.included] == ["arm.yaml"]
    assert loaded.task.robot.protection is not None
    assert loaded.task.robot.protection.reflex is not None
    assert loaded.task.robot.protection.reflex.force == 14


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("none.yaml", None, "TS134"),
        ("../../../etc/hosts.yaml", None, "TS409"),
        ("arm.txt", b"source: s\n", "TS134"),
        ("arm.yaml", b"\xff\xfe", "TS134"),
        ("arm.yaml", b"", "TS010"),
        ("arm.yaml", b"reflex: {force: 3 m}\n", "TS112"),
        ("arm.yaml", b"reflex: {force: 3 N}\n", "TS021"),
        ("arm.yaml", b"[1, 2]\n", "TS010"),
    ],
)
def test_what_is_wrong_with_a_file_is_told(name, content, code, tmp_path):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(SpecError) as told:
        load_text(task(MOVE, name), str(tmp_path / "task.yaml"), base=tmp_path)
    assert code in [each.code for each in told.value.diagnostics]


def test_an_override_names_another_protection(tmp_path):
    (tmp_path / "arm.yaml").write_text("source: s\nreflex: {force: 14 N}\n")
    text, name = task(PRESS, "panda"), str(tmp_path / "task.yaml")
    loaded = load_text(text, name, {"robot.protection": "arm.yaml"}, tmp_path)
    assert loaded.task.robot.protection is not None
    assert loaded.task.robot.protection.reflex is not None
    loaded = load_text(text, name, {"robot.protection.tip.speed": "1 m/s"}, tmp_path)
    assert loaded.task.robot.protection is not None
    assert loaded.task.robot.protection.tip is not None
    assert loaded.task.robot.protection.tip.speed == 1


def test_a_table_is_followed_by_its_spline(tmp_path):
    """What a run is sent along a table has no corners: accelerations and jerks are the run's."""
    rows = "\n".join(f"{20 * i},{3 * (-1) ** i}" for i in range(1, 9))
    (tmp_path / "leaf.csv").write_text(f"x [mm],y [mm]\n0,0\n{rows}\n")
    text = ARM + "stages:\n  draw: {path: {file: leaf.csv, speed: 60 mm/s}}\n"
    text = task(text, "panda").replace("xyz: [500 mm, 0, 340 mm]", "xyz: [450 mm, 0, 340 mm]")
    text += "frames: {own: {xyz: [450 mm, 0, 340 mm]}}\nframe: own\n"
    loaded = load_text(text, str(tmp_path / "task.yaml"), base=tmp_path)
    assert check(loaded).findings == ()
    execute(loaded, tmp_path / "run", report=False, force=True)
    columns = Run.load(tmp_path / "run").columns
    sent = np.array([columns[f"position.{a}.ref"] for a in "xy"])
    assert sent.shape[1] > 1000
    for order, key, unit in ((2, "acceleration", "m/s^2"), (3, "jerk", "m/s^3")):
        most = np.linalg.norm(np.diff(sent, order, axis=1), axis=0).max() / 1e-3**order
        for share in (0.95, 1.05):
            bound = f"{{source: s, tip: {{{key}: {share * most:.6f} {unit}}}}}"
            bounded = load_text(
                text.replace("protection: panda", f"protection: {bound}"), loaded.source.name,
                base=tmp_path,
            )  # fmt: skip
            assert ("TS443" in [each.code for each in check(bounded).findings]) == (share < 1)
