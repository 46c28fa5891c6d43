from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path

import pytest

from taskspec.expression import FloatAlgebra, evaluate
from taskspec.spec import FILE, LoadedTask, Robot, Shape, Start, key_of, load_task, load_text
from taskspec.spec.stage import Within
from taskspec.text.diagnostic import SpecError
from taskspec.text.source import Span
from taskspec.text.units import ANGLE, FORCE, LENGTH, Quantity

CORPUS = Path(__file__).parent.parent / "corpus"
WIPE = CORPUS / "ok" / "wipe_table.yaml"
HEAD = "taskspec: 1\nrobot: {model: panda}\n"
WAIT = "stages:\n  wait: {time: 1 s}\n"


def codes(text: str, **overrides: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        load_text(text, "t.yaml", overrides)
    return [d.code for d in caught.value.diagnostics]


def piece(loaded: LoadedTask, span: Span) -> str:
    assert span.line == span.end_line
    return loaded.source.line(span.line)[span.column - 1 : span.end_column - 1]


def test_the_example_of_the_language_in_si_units() -> None:
    task = load_task(WIPE).task
    assert task.name == "wipe-table"
    assert task.robot.tool.mass == 0.3
    assert task.robot.start is not None
    assert task.robot.start.rpy == (math.pi, 0.0, 0.0)
    assert task.world["table"] == Shape(
        shape="plane", xyz=(0.0, 0.0, 0.3), stiffness=20e3, damping=30.0, friction=0.2
    )
    assert task.params == {"press": Quantity(15.0, FORCE)}
    assert task.frames["task"].surface == "table"
    assert (task.frame, task.law.kind, task.limits.speed) == ("task", "hybrid", 0.25)
    assert list(task.stages) == ["approach", "wipe", "retreat"]
    approach, wipe, retreat = task.stages.values()
    assert approach.within is not None
    assert (approach.within.time, approach.within.travel) == (4.0, 0.06)
    assert list(wipe.axes) == ["x", "y", "z"]
    assert wipe.axes["z"].ramp == 0.3
    assert (retreat.axes["z"].move, retreat.axes["z"].speed) == (0.05, 0.1)
    assert [e.text for e in task.expect][1] == "rms(wipe.error.x) < 0.5 mm"
    (stiffness,) = task.vary["world.table.stiffness"]
    assert stiffness is not None
    assert (stiffness.low, stiffness.high, stiffness.relative) == (5e3, 80e3, False)
    tilt = task.vary["world.table.rpy"]
    assert tilt[2] is None
    assert tilt[0] is not None
    assert (tilt[0].low, tilt[0].relative) == (-math.radians(3), True)


def test_what_is_not_said_has_the_defaults_of_the_language() -> None:
    task = load_text(HEAD + WAIT, "some/dir/My Task_2.yaml").task
    assert task.name == "my-task-2"
    assert (task.frame, task.law.kind, task.law.force) == ("world", "hybrid", None)
    assert task.robot.base.xyz == (0.0, 0.0, 0.0)
    assert (task.robot.tool.shape, task.robot.tool.radius, task.robot.tool.mass) == (
        "sphere",
        None,
        0.0,
    )
    assert task.robot.start is None
    assert (task.control.rate, task.control.plant_rate) == (1000.0, 1000.0)
    assert (task.world, task.params, task.expect, task.vary) == ({}, {}, (), {})
    shape = load_text(HEAD + "world: {a: {shape: plane}}\n" + WAIT, "t").task.world["a"]
    assert (shape.stiffness, shape.damping, shape.friction) == (20e3, None, 0.0)


@pytest.mark.parametrize(
    ("name", "expected"), [("1.yaml", "task-1"), ("--", "task"), ("ä", "task")]
)
def test_every_file_name_gives_a_task_name(name: str, expected: str) -> None:
    assert load_text(HEAD + WAIT, name).task.name == expected


def test_gains_come_in_three_forms() -> None:
    stages = load_task(CORPUS / "ok" / "gains.yaml").task.stages
    b, c = stages["b"].law, stages["c"].law
    assert b is not None
    assert c is not None
    assert b.mass is not None
    assert [b.mass.get(axis) for axis in ("x", "z", "rx")] == [2.0, 2.0, 0.1]
    assert b.stiffness is not None
    assert [b.stiffness.get(axis) for axis in ("x", "rz")] == [1000.0, None]
    assert b.damping is not None
    assert [b.damping.get(axis) for axis in ("x", "z", "rx")] == [30.0, 60.0, None]
    assert c.stiffness is not None
    assert c.stiffness.get("ry") == 30.0
    with pytest.raises(KeyError):
        c.stiffness.get("w")


def test_hold_has_a_short_form() -> None:
    axes = load_task(CORPUS / "ok" / "expressions.yaml").task.stages["three"].axes
    assert [axes[name].hold for name in ("x", "y", "rz", "z")] == ["start", "start", "world", None]


def test_constants_may_use_params_in_any_order() -> None:
    task = load_task(CORPUS / "ok" / "world.yaml").task
    assert task.params["h"] == Quantity(0.05, LENGTH)
    assert task.frames["side"].xyz == (0.0, 0.0, pytest.approx(0.06))
    assert task.limits.deviation == 0.05
    assert task.stages["there"].time == 3.0
    force = task.stages["there"].axes["z"].force
    assert force is not None
    value = evaluate(force.tree, FloatAlgebra(), lambda name: task.params[str(name)].value)
    assert value == pytest.approx(-3.75)


def test_paths() -> None:
    stages = load_task(CORPUS / "ok" / "paths.yaml").task.stages
    to, table = stages["to"].path, stages["table"].path
    assert to is not None
    assert to.to == pytest.approx((0.06, 0, -0.005, 0, 0, math.pi / 2))
    assert table is not None
    assert (table.file, table.speed, table.time) == ("points.csv", None, None)


def test_places() -> None:
    loaded = load_task(WIPE)
    z = FILE.stages["wipe"].axes["z"].force
    assert piece(loaded, loaded.span(z)) == "-press"
    assert piece(loaded, loaded.span(key_of(z))) == "force"
    assert piece(loaded, loaded.span(FILE.stages["wipe"].axes["z"])) == "{"
    assert piece(loaded, loaded.span(FILE.stages["wipe"])) == "wipe"
    assert piece(loaded, loaded.span(FILE.stages["wipe"].path.to)) == "wipe"
    assert piece(loaded, loaded.span(FILE.world["table"].xyz[2])) == "300 mm"
    assert piece(loaded, loaded.span(FILE)) == "t"
    assert piece(loaded, loaded.span(FILE.expect[1])) == "rms(wipe.error.x) < 0.5 mm"


def test_parts_of_expressions_have_places() -> None:
    loaded = load_task(CORPUS / "ok" / "expressions.yaml")
    fail_if = loaded.task.stages["one"].fail_if
    assert fail_if is not None
    span = fail_if.where(fail_if.tree)
    assert span is not None
    assert (span.line, span.end_line) == (17, 18)
    assert loaded.source.line(17)[span.column - 1 :].startswith("(norm(force in tool)")
    quoted = loaded.task.stages["one"].axes["z"].force
    assert quoted is not None
    assert quoted.span is not None
    assert piece(loaded, quoted.span).startswith("'-press")
    where = quoted.where(quoted.tree)
    assert where is not None
    assert piece(loaded, where) == "-press * smooth(t / (0.5 s))"


def test_paths_start_from_the_folder_of_the_file() -> None:
    assert load_task(WIPE).base == WIPE.parent
    assert load_text(HEAD + WAIT, "t", base=Path("x")).base == Path("x")
    assert load_text(HEAD + WAIT, "t").path is None


def test_overrides() -> None:
    loaded = load_task(
        WIPE,
        {
            "press": "20N",
            "world.table.stiffness": "50 kN/m",
            "stages.wipe.axes.z.ramp": "1 s",
            "stages.retreat.axes.x.velocity": "2 mm/s",
            "robot.start.xyz.2": "0.35 m",
            "law": "{kind: parallel, mass: 3 kg}",
            "control.rate": "500 Hz",
            "vary.world.table.friction": "0..1",
            "expect.0": "max(gap) < 1 m",
            "limits.force": "1e2 N",
        },
    )
    task = loaded.task
    assert task.params["press"].value == 20.0
    assert task.world["table"].stiffness == 50e3
    assert task.stages["wipe"].axes["z"].ramp == 1.0
    assert "x" in task.stages["retreat"].axes
    assert task.robot.start is not None
    assert task.robot.start.xyz == (0.5, 0.0, 0.35)
    assert task.law.kind == "parallel"
    assert task.control.rate == 500.0
    assert task.vary["world.table.friction"][0] is not None
    assert task.expect[0].text == "max(gap) < 1 m"
    assert loaded.overrides["press"] == "20N"
    span = loaded.span(FILE.world["table"].stiffness)
    assert span == Span(2, 23, 2, 30, "--set")


def test_what_the_file_leaves_alone_can_be_varied() -> None:
    text = (HEAD + WAIT).replace("robot:", "world: {table: {shape: plane}}\nrobot:", 1)
    task = load_text(text, "t.yaml", {"vary.world.table.stiffness": "5..9 kN/m"}).task
    assert set(task.vary) == {"world.table.stiffness"}
    with pytest.raises(SpecError, match="unknown object 'tabel'"):
        load_text(text, "t.yaml", {"vary.world.tabel.stiffness": "5..9 kN/m"})


def test_a_gain_can_be_set_on_a_law_without_gains() -> None:
    law = load_task(WIPE, {"law.bandwidth": "8 Hz"}).task.law
    assert law.kind == "hybrid"
    assert law.bandwidth is not None
    assert law.bandwidth.z == 8.0


def test_a_bare_time_is_the_time_of_a_bound() -> None:
    text = (HEAD + WAIT).replace("{time: 1 s}", "{until: touching, within: 4 s}")

    def bound(**overrides: str) -> Within | None:
        return load_text(text, "t.yaml", overrides).task.stages["wait"].within

    assert bound() == Within(time=4.0)
    assert bound(**{"stages.wait.within": "3 s"}) == Within(time=3.0)
    assert bound(**{"stages.wait.within.time": "3 s"}) == Within(time=3.0)
    both = bound(**{"stages.wait.within.travel": "50 mm"})
    assert both == Within(time=4.0, travel=0.05)


def test_mistakes_of_an_override_are_shown_in_the_override() -> None:
    with pytest.raises(SpecError) as caught:
        load_task(WIPE, {"params.press": "20 mm", "limits.force": "3 N +"})
    places = {(d.source, d.span.line if d.span else 0) for d in caught.value.diagnostics}
    assert ("--set", 2) in places
    assert set(caught.value.sources) == {str(WIPE), "--set"}


def test_byte_order_mark_and_foreign_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + (HEAD + WAIT).replace("\n", "\r\n").encode())
    assert load_task(path).task.name == "task"


def test_what_is_not_a_readable_file_is_not_a_diagnostic(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    path.write_bytes(HEAD.encode("utf-16"))
    with pytest.raises(UnicodeDecodeError):
        load_task(path)
    with pytest.raises(OSError):  # noqa: PT011
        load_task(tmp_path)
    with pytest.raises(FileNotFoundError):
        load_task(tmp_path / "none.yaml")


def test_a_broken_definition_is_told_once_and_not_by_its_users() -> None:
    text = HEAD + (
        "params: {press: 15 newton, twice: 2*press, gone: .nan, none: }\n"
        "world:\n  table: {shape: hexagon, radius: 3}\n  dent: {shape: dimple}\n"
        "frames: {task: {surface: table}, in_dent: {surface: dent}, bad: {parent: taks}}\n"
        "frame: bad\n"
        "limits: {force: twice, torque: gone * 1 m, speed: none}\n"
        "stages:\n"
        "  press:\n"
        "    axes: {z: {force: -press}, x: {force: gone}}\n"
        "    until: table.gap < 1 mm and dent.force > twice\n"
        "    within: {time: 1 s}\n"
        "    next: broken\n"
        "  broken:\n"
    )
    found = codes(text)
    assert sorted(found) == [
        "TS011", "TS011", "TS015", "TS025", "TS025", "TS110", "TS111", "TS122",
    ]  # fmt: skip


def test_models_can_be_made_without_a_file() -> None:
    robot = Robot(model="planar2", start=Start(xyz=(0.3, 0.0, 0.0)))
    assert robot.start is not None
    assert robot.start.xyz == (0.3, 0.0, 0.0)


@pytest.mark.parametrize(
    ("control", "rate", "plant_rate"),
    [
        ("", 1000, 1000),
        ("control: {rate: 300 Hz}\n", 300, 1200),
        ("control: {rate: 2 kHz}\n", 2000, 2000),
        ("control: {rate: 500 Hz, plant_rate: 2 kHz}\n", 500, 2000),
        ("control: {plant_rate: 4 kHz}\n", 1000, 4000),
    ],
)
def test_plant_steps_a_whole_number_of_times(control: str, rate: float, plant_rate: float) -> None:
    found = load_text(HEAD + WAIT + control, "t").task.control
    assert (found.rate, found.plant_rate) == (rate, plant_rate)


def test_tasks_and_errors_pass_between_processes() -> None:
    loaded = load_task(WIPE)
    copy = pickle.loads(pickle.dumps(loaded))
    assert copy.task == loaded.task
    assert copy.span(FILE.law) == loaded.span(FILE.law)
    with pytest.raises(SpecError) as caught:
        load_text(HEAD, "t")
    again = pickle.loads(pickle.dumps(caught.value))
    assert again.diagnostics == caught.value.diagnostics


def joints_of(text: str, tmp_path: Path) -> tuple[float, ...]:
    path = tmp_path / "task.yaml"
    path.write_text(
        f"taskspec: 1\nrobot: {{model: panda, posture: {text}, start: {{joints: {text}}}}}\n"
        "stages:\n  wait: {time: 1 s}\n"
    )
    robot = load_task(path).task.robot
    assert robot.start is not None
    assert robot.start.joints == robot.posture
    return robot.start.joints or ()


def test_joints_are_angles_or_lengths(tmp_path: Path) -> None:
    joints = joints_of("[30 mm, 180 deg, 0]", tmp_path)
    assert joints == pytest.approx((0.03, math.pi, 0))
    assert [q.dimension for q in joints] == [LENGTH, ANGLE, None]
    assert [q.dimension for q in copy.deepcopy(joints)] == [LENGTH, ANGLE, None]


@pytest.mark.parametrize(
    ("entry", "code", "words"),
    [
        ("5", "TS110", "where an angle or a length is needed"),
        ("5 N", "TS112", "an angle or a length is needed here, this is a force"),
        ("true", "TS022", "an angle or a length is needed here, this is true or false"),
        ("1 deg + 1 mm", "TS113", "does not go together"),
    ],
)
def test_joints_are_nothing_else(entry: str, code: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(SpecError) as caught:
        joints_of(f"[{entry}]", tmp_path)
    assert {d.code for d in caught.value.diagnostics} == {code}
    assert words in caught.value.diagnostics[0].message


def test_an_axis_with_a_stiffness_or_damping_alone_is_a_soft_hold() -> None:
    soft = (
        "stages: {rest: {axes: {x: {stiffness: 200 N/m}, ry: {damping: 1 N*m*s/rad}}, time: 1 s}}\n"
    )
    named = soft.replace("{stiffness", "{hold: start, stiffness").replace(
        "{damp", "{hold: start, damp"
    )
    axes, whole = (
        load_text(HEAD + text, "t.yaml").task.stages["rest"].axes for text in (soft, named)
    )
    for axis in ("x", "ry"):
        assert axes[axis].is_soft
        assert axes[axis].mode == whole[axis].mode
        assert (axes[axis].stiffness, axes[axis].damping) == (
            whole[axis].stiffness, whole[axis].damping,
        )  # fmt: skip
