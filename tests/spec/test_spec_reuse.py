"""Templates, included files and ways on: what they come to, and where mistakes in them are told."""

from __future__ import annotations

from pathlib import Path

import pytest

from taskspec.spec import load_task, load_text
from taskspec.text.diagnostic import SpecError
from taskspec.text.units import LENGTH

TASK = """taskspec: 1
robot: {model: panda}
world: {table: {shape: plane}, wall: {shape: plane}}
params: {soft: 8 N}
templates:
  press:
    params: {level: 12 N, on: table, then: end}
    frame: on
    axes: {z: {force: 2*level - 1 N}}
    until: on.gap < 1 mm
    within: 3 s
    next: then
stages:
"""
CELL = """robot: {model: panda}
world: {table: {shape: plane}}
params: {height: 20 mm}
templates: {lift: {params: {way: height}, axes: {z: {move: way}}}}
"""


def written_out(**of: str) -> str:
    return TASK.split("templates:")[0] + "stages:\n" + of["stages"]


def test_a_template_is_its_stage_written_out():
    used = load_text(TASK + "  a: {use: press, with: {on: wall, then: a}, attempts: 2}\n", "t").task
    full = written_out(
        stages="  a: {frame: wall, axes: {z: {force: 2*(12 N) - 1 N}}, until: wall.gap < 1 mm, "
        "within: 3 s, next: a, attempts: 2}\n"
    )
    same = load_text(full, "t").task
    a, b = used.stages["a"], same.stages["a"]
    assert (a.frame, a.within, a.next, a.attempts) == (b.frame, b.within, b.next, b.attempts)
    assert a.axes["z"].force.text == b.axes["z"].force.text
    assert a.until.text == b.until.text
    assert a.until.span.line == 10


def test_what_a_stage_says_goes_before_its_template():
    task = load_text(TASK + "  a: {use: press, frame: wall, within: 1 s}\n", "t").task
    assert task.stages["a"].frame == "wall"
    assert task.stages["a"].within.time == 1


def test_a_param_of_a_template_goes_before_one_of_the_file():
    text = TASK.replace("level: 12 N", "soft: 3 N").replace("2*level", "2*soft")
    task = load_text(
        text + "  a: {use: press}\n  b: {use: press, with: {soft: 2*soft}}\n", "t"
    ).task
    assert task.stages["a"].axes["z"].force.text == "2*(3 N) - 1 N"
    assert task.stages["b"].axes["z"].force.text == "2*(2*soft) - 1 N"


def test_a_param_may_be_a_list_or_a_mapping():
    text = TASK.replace("until: on.gap < 1 mm\n    within: 3 s", "path: way").replace(
        "level: 12 N", "level: 12 N, way: {to: [10 mm], time: 2 s}"
    )
    task = load_text(
        text + "  a: {use: press, with: {way: {to: [0, 5 mm], time: 1 s}}}\n", "t"
    ).task
    assert task.stages["a"].path.to == (0, 0.005)


@pytest.mark.parametrize(
    ("given", "place"),
    [
        ("{level: soft + 4 mm}", (14, 40)),  # in what the stage gives
        ("{level: 4 mm}", (9, 33)),  # in the expression of the template
        ("{then: nowhere}", (14, 32)),  # a whole value stands where it is given
        ("{on: soft}", (14, 30)),
    ],
)
def test_mistakes_are_told_where_they_are_written(given, place):
    with pytest.raises(SpecError) as caught:
        load_text(TASK + f"  a: {{use: press, with: {given}}}\n", "t")
    found = [(d.span.line, d.span.column) for d in caught.value.diagnostics]
    assert place in found


def test_one_mistake_of_a_template_is_told_once_with_all_its_uses():
    text = TASK.replace("until:", "untill:") + "  a: {use: press}\n  b: {use: press}\n"
    with pytest.raises(SpecError) as caught:
        load_text(text, "t")
    (found,) = [d for d in caught.value.diagnostics if d.code == "TS020"]
    assert [note.span.line for note in found.notes] == [14, 15]


def test_overrides_reach_what_is_given_and_what_it_has_become():
    text = TASK + "  a: {use: press}\n  b: {use: press}\n"
    changes = {"stages.a.with.level": "5 N", "stages.b.axes.z.force": "-7 N"}
    task = load_text(text, "t", changes).task
    assert task.stages["a"].axes["z"].force.text == "2*(5 N) - 1 N"
    assert task.stages["b"].axes["z"].force.text == "-7 N"
    both = load_text(text, "t", {"templates.press.params.level": "9 N"}).task
    assert {s.axes["z"].force.text for s in both.stages.values()} == {"2*(9 N) - 1 N"}


def test_templates_may_not_blow_up():
    body = "".join(f"    a{i}: 1\n" for i in range(500))
    uses = "".join(f"  s{i}: {{use: big}}\n" for i in range(100))
    text = f"taskspec: 1\nrobot: {{model: panda}}\ntemplates:\n  big:\n{body}stages:\n{uses}"
    with pytest.raises(SpecError) as caught:
        load_text(text, "t")
    assert "TS009" in {d.code for d in caught.value.diagnostics}


def project(folder: Path, **files: str) -> Path:
    (folder / "pyproject.toml").touch()
    for name, text in files.items():
        path = folder / name.replace("__", "/")
        path.parent.mkdir(exist_ok=True)
        path.with_suffix(".yaml").write_text(text)
    return folder / "tasks" / "t.yaml"


def test_an_included_file_brings_its_sections(tmp_path):
    own = "taskspec: 1\ninclude: [../cells/cell.yaml]\nworld: {wall: {shape: plane}}\n"
    path = project(tmp_path, cells__cell=CELL, tasks__t=own + "stages: {a: {use: lift}}\n")
    loaded = load_task(path)
    assert list(loaded.task.world) == ["table", "wall"]
    assert loaded.task.stages["a"].axes["z"].move == pytest.approx(0.02)
    assert loaded.task.params["height"].dimension == LENGTH
    assert [p.name for p in loaded.included] == ["cell.yaml"]


def test_paths_count_from_the_file_in_which_they_stand(tmp_path):
    cell = "robot: {model: arms/arm.urdf}\ntemplates: {go: {path: {file: way.csv, speed: 1 m/s}}}\n"
    own = "taskspec: 1\ninclude: ../cells/cell.yaml\nstages: {a: {use: go}}\n"
    task = load_task(project(tmp_path, cells__cell=cell, tasks__t=own)).task
    assert task.robot.model == "../cells/arms/arm.urdf"
    assert task.stages["a"].path.file == "../cells/way.csv"


def test_what_comes_by_two_ways_comes_once(tmp_path):
    own = "taskspec: 1\ninclude: [a.yaml, b.yaml]\nstages: {go: {time: 1 s}}\n"
    path = project(
        tmp_path,
        tasks__t=own,
        tasks__a="include: ../c.yaml\nparams: {p: 1 N}\n",
        tasks__b="include: ../c.yaml\nparams: {q: 1 N}\n",
        c="robot: {model: panda}\nparams: {r: 1 N}\n",
    )
    assert set(load_task(path).task.params) == {"p", "q", "r"}


def test_a_mistake_in_an_included_file_is_told_there(tmp_path):
    own = "taskspec: 1\ninclude: [../cells/cell.yaml]\nstages: {a: {use: lift}}\n"
    path = project(tmp_path, cells__cell=CELL.replace("20 mm", "20 mmm"), tasks__t=own)
    with pytest.raises(SpecError) as caught:
        load_task(path)
    first = caught.value.diagnostics[0]
    assert Path(first.source) == tmp_path / "cells" / "cell.yaml"
    assert (first.code, first.span.line) == ("TS111", 3)
    assert [(note.source, note.span.line) for note in first.notes] == [(str(path), 2)]
    assert first.source in caught.value.sources


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        ("cell.yaml", "TS133"),
        ("../../cell.yaml", "TS409"),
        ("/etc/cell.yaml", "TS409"),
        ("t.yaml", "TS133"),
        ("../cells/", "TS133"),
        ('"a\\0b.yaml"', "TS002"),
    ],
)
def test_what_cannot_be_included(tmp_path, entry, code):
    own = f"taskspec: 1\ninclude: [{entry}]\nstages: {{a: {{time: 1 s}}}}\n"
    with pytest.raises(SpecError) as caught:
        load_task(project(tmp_path, cells__cell=CELL, tasks__t=own))
    assert code in {d.code for d in caught.value.diagnostics}
