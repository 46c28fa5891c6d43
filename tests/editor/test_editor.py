"""What an editor shows of a text: findings, completions, meanings, places, changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from taskspec.spec import load_text
from taskspec_runner.editor import places
from taskspec_runner.editor.completion import proposals
from taskspec_runner.editor.opened import OpenedFile

TASKS = Path(__file__).resolve().parents[2] / "tasks"
TASK = """\
taskspec: 1
name: press
robot: {model: panda, start: {xyz: [500 mm, 0, 320 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
frames: {task: {surface: table}}
frame: task
params: {press: 10 N}
limits: {force: 40 N}
templates:
  touch: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N, within: {time: 3 s}}
stages:
  approach: {use: touch}
  push: {axes: {z: {force: -press}}, time: 2 s}
  leave: {axes: {z: {move: 30 mm}}}
expect: [push.force.z within -press +- 0.5 N for 70 %]
"""


def opened(text: str) -> tuple[OpenedFile, int]:
    """A file that was whole before its text became this, and the place of `|` in it."""
    file = OpenedFile(TASKS / "press.yaml", TASK)
    offset = text.index("|")
    file.change(text.replace("|", "", 1))
    return file, offset


def completed(old: str, new: str) -> list[str]:
    """What is proposed where `|` stands in the task after a change."""
    assert TASK.count(old) == 1, old
    return [each.text for each in proposals(*opened(TASK.replace(old, new)))]


#: In place of what, what is being written, and what has to be and must not be proposed.
COMPLETIONS = [
    ("frame: task", "frame: |", {"task", "world", "tool", "table"}, {"push", "press"}),
    ("{use: touch}", "{use: |}", {"touch"}, {"push"}),
    ("{move: 30 mm}}", "{move: 30 mm}}, next: |", {"end", "fail", "approach", "push"}, {"table"}),
    ("{surface: table}", "{surface: |}", {"table"}, {"push"}),
    ("{surface: table}", "{|}", {"surface: ", "xyz: ", "rpy: "}, {"force: "}),
    ("model: panda", "model: |", {"panda", "ur5e", "planar2", "planar3"}, {"table"}),
    ("model: panda", "model: ur|", {"ur5e"}, set()),
    ("shape: plane", "shape: |", {"plane", "box", "mesh"}, {"panda"}),
    ("stiffness: 20 kN/m", "st|", {"stiffness: ", "friction: "}, {"shape: ", "xyz: "}),
    ("stiffness: 20 kN/m", "stiffness: 20 |", {"kN/m", "N/m"}, {"N", "mm"}),
    ("stiffness: 20 kN/m", "stiffness: 20|", {" kN/m"}, {" mm"}),
    ("{force: 40 N}", "{force: 40 |}", {"N", "kN"}, {"mm"}),
    ("{force: 40 N}", "{|}", {"force: ", "speed: "}, {"stages: "}),
    ("{force: -press}", "{|}", {"force: ", "velocity: ", "move: "}, {"shape: "}),
    ("{force: -press}", "{force: -press, |}", {"ramp: "}, {"force: "}),
    ("{force: -press}", "{force: -|}", {"press"}, {"panda"}),
    ("time: 2 s}", "time: 2 |}", {"s", "ms"}, {"N"}),
    ("time: 2 s}", "|}", {"time: ", "until: ", "next: "}, {"axes: ", "robot: "}),
    ("time: 2 s}", "until: fo|}", {"force.z", "force"}, set()),
    ("time: 2 s}", "until: table.|}", {"table.gap", "table.force"}, set()),
    ("limits:", "law: |\nlimits:", {"hybrid", "impedance", "pd"}, {"panda"}),
    ("limits:", "law: {kind: |}\nlimits:", {"hybrid", "parallel"}, {"panda"}),
    ("limits:", "law: {|}\nlimits:", {"kind: ", "stiffness: ", "solve: "}, {"model: "}),
    ("limits:", "law: {solve: |}\nlimits:", {"closed-form", "qp"}, {"hybrid"}),
    ("limits:", "|\nlimits:", {"law: ", "vary: ", "truth: "}, {"limits: ", "robot: "}),
    ("limits:", "law:\n  |\nlimits:", {"kind: ", "force: "}, {"limits: "}),
    ("limits:", "sweep:\n  |\nlimits:", {"worlds: "}, {"limits: "}),
    ("leave: {", "wait:\n    |\n  leave: {", {"axes: ", "time: ", "path: "}, {"leave: "}),
    ("leave: {", "wait:\n    path: {|}\n  leave: {", {"line: ", "arc: ", "raster: "}, {"axes: "}),
    ("leave: {", "wait:\n    axes:\n      |\n  leave: {", {"x: ", "rz: "}, {"force: "}),
    ("leave: {", "wait:\n    axes:\n      y:\n        |\n  leave: {", {"force: "}, {"x: "}),
    ("leave: {", "wait:\n    within: {|}\n  leave: {", {"time: ", "travel: "}, {"axes: "}),
    ("expect: [push", "expect: [|push", {"push", "max(", "press"}, {"panda"}),
    ("expect: [push", "expect:\n  - |\nother: [push", {"push", "force.z", "rms("}, {"panda"}),
    ("{model: panda,", "{model: panda, |", {"tool: ", "sensor: ", "grasp: "}, {"model: "}),
    ("{model: panda,", "{model: panda, tool: {|},", {"shape: ", "mass: "}, {"xyz_: "}),
    ("{model: panda,", "{model: panda, sensor: {at: |},", {"contact", "wrist"}, {"panda"}),
    ("{model: panda,", "{model: panda, sensor: {filter: 50 |},", {"Hz"}, {"N"}),
    ("[500 mm, 0,", "[500 |, 0,", {"mm", "m"}, {"N"}),
    ("params:", "control: {|}\nparams:", {"rate: "}, {"model: "}),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "wanted", "unwanted"), COMPLETIONS)
def test_what_can_be_written_is_proposed(
    old: str, new: str, wanted: set[str], unwanted: set[str]
) -> None:
    found = completed(old, new)
    assert wanted <= set(found)
    assert not unwanted & set(found)
    assert len(found) == len(set(found))


#: A word of the task, the text that hovering over it shows, and the line that gives the name.
WORDS = [
    ("{surface: ta|ble}", "object", 4),
    ("frame: ta|sk", "frame", 5),
    ("-pr|ess}}", "param", 7),
    ("use: tou|ch", "template", 10),
    ("pu|sh.force.z", "stage", 13),
    ("push.for|ce.z", "force that the robot applies", None),
    ("shap|e: plane", "plane", None),
    ("sti|ffness: 20", "`kN/m`", None),
    ("unt|il: force", "condition", None),
    ("lim|its: {", "imit", None),
]


@pytest.mark.parametrize(("place", "said", "line"), WORDS)
def test_hovering_says_what_a_word_is(place: str, said: str, line: int | None) -> None:
    file, offset = opened(TASK.replace(place.replace("|", ""), place))
    found = places.hover(file, offset)
    assert found is not None
    assert said in found[0]
    span = places.definition(file, offset)
    assert (None if span is None else span.line) == line


def test_an_included_name_leads_to_its_file(tmp_path: Path) -> None:
    cell = "world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}\n"
    (tmp_path / "cell.yaml").write_text(cell)
    world = next(line for line in TASK.split("\n") if line.startswith("world:"))
    text = TASK.replace(world, "include: [cell.yaml]")
    file = OpenedFile(tmp_path / "press.yaml", text)
    span = places.definition(file, text.index("surface: table") + 10)
    assert span is not None
    assert (Path(span.source).name, span.line) == ("cell.yaml", 1)


@pytest.mark.parametrize(
    ("name", "count"), [("table", 2), ("task", 2), ("press", 3), ("touch", 2), ("push", 2)]
)
def test_a_renamed_task_reads_as_before(name: str, count: int) -> None:
    file = OpenedFile(TASKS / "press.yaml", TASK)
    found = places.renames(file, TASK.index(f"{name}: {{") if name != "press"
                           else TASK.index("press: 10"), str)  # fmt: skip
    assert found is not None
    assert found[0] == name
    assert list(found[1]) == [""]
    spans = found[1][""]
    assert len(spans) == count
    text = TASK
    for span in reversed(spans):
        at = file.source.offset(span.line, span.column)
        assert text[at : at + len(name)] == name
        text = f"{text[:at]}other{text[at + len(name) :]}"
    assert not load_text(text, "renamed.yaml").warnings


def test_a_name_is_renamed_in_what_is_included(tmp_path: Path) -> None:
    cell = "world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}\n"
    world = next(line for line in TASK.split("\n") if line.startswith("world:"))
    text = TASK.replace(world, "include: [cell.yaml]")
    (tmp_path / "cell.yaml").write_text(cell)
    file = OpenedFile(tmp_path / "press.yaml", text)
    offset = text.index("surface: table") + 10
    found = places.renames(file, offset, lambda name: Path(name).read_text())
    assert found is not None
    (source,) = found[1].keys() - {""}
    (span,) = found[1][source]
    assert (span.line, span.column) == (1, 9)
    assert len(found[1][""]) == 1
    (tmp_path / "cell.yaml").write_text(cell.replace("table", "bench"))
    assert not load_text(text.replace("table", "bench"), "p.yaml", base=tmp_path).warnings


def test_hovering_over_a_key_says_its_range_and_page() -> None:
    file, offset = opened(TASK.replace("robot: {", "control: {ra|te: 2 kHz}\nrobot: {"))
    found = places.hover(file, offset)
    assert found is not None
    assert "20 Hz" in found[0]
    assert "docs/language/defaults.md#control)" in found[0]
    file, offset = opened(TASK.replace("{move: 30 mm}", "{mo|ve: 30 mm}"))
    found = places.hover(file, offset)
    assert found is not None
    assert "docs/language/axes.md)" in found[0]
    file, offset = opened(TASK.replace("model: panda, ", "model: panda, tool: {rad|ius: 10 mm}, "))
    found = places.hover(file, offset)
    assert found is not None
    assert "more than 0" in found[0]
    assert "docs/language/robot.md)" in found[0]
