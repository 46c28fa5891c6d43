"""Robots that people bring, restated from public threads: what a file of them gets.

Each is the arm of six joints with the one thing that the thread is about, on a bench that a press
starts 50 mm above.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from taskspec.examination import examine
from taskspec.spec import load_task
from taskspec.text.diagnostic import SpecError

DATA = Path(__file__).parent / "data"
PRESS = """
taskspec: 1
robot: {{model: ./{model}, {keys}start: {{xyz: [550 mm, 0, {start} mm]}}}}
world: {{bench: {{shape: plane, xyz: [0, 0, {bench} mm], stiffness: 30 kN/m, friction: 0.3}}}}
frames: {{task: {{surface: bench}}}}
frame: task
limits: {{force: 60 N}}
stages:
  approach:
    axes: {{z: {{velocity: -20 mm/s}}}}
    until: force.z < -3 N for 10 ms
    within: {{time: 5 s}}
  press: {{axes: {{z: {{force: -20 N}}}}, time: 2 s}}
  leave: {{axes: {{z: {{move: 40 mm}}}}}}
expect:
  - press.force.z within -20 N +- 2 N for 70 %
"""
ROOT, SPACE = '<robot name="arm6">', 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
INERTIA = 'ixx="0.003" iyy="0.003" izz="0.002"'
LEVEL = "<equality><joint joint1='j3' joint2='j2' polycoef='0 -1 0 0 0'/></equality></mujoco>"
LOOP = "<equality><connect name='rod' body1='l2' body2='l4' anchor='0 0 0.1'/></equality></mujoco>"
ARGUED = f'<robot name="$(arg name)" {SPACE}><xacro:arg name="name"/>'
#: Name: (file, what is replaced, by what, further keys of the robot, codes, where they point).
CASES = {
    "r01, an unused property": (
        "six.urdf", ROOT, f'{ROOT[:-1]} {SPACE}><xacro:property name="width" value=".2"/>', "", {},
    ),
    "r02, a broken triangle": (
        "six.urdf", INERTIA, 'ixx="0.007" iyy="0.003" izz="0.002"', "", {"TS448": "link 'l4'"},
    ),
    "r03, negative moments": (
        "six.urdf", INERTIA, 'ixx="-0.003" iyy="-0.003" izz="0.002"', "", {"TS448": "link 'l4'"},
    ),
    "r04, a link without mass": (
        "six.urdf", '<mass value="1.5"/>', '<mass value="0"/>', "",
        {"TS419": "joint 4 (j4) carries a link without mass, 'l4'"},
    ),
    "r08, a joint that mimics": (
        "six.urdf", 'effort="100"/>', 'effort="100"/><mimic joint="j2" multiplier="-1"/>', "",
        {"TS412": "cannot get to the start: it misses it by 142.5 mm"},
    ),
    "r13, a loop": (
        "six.xml", "</mujoco>", LOOP, "", {"TS405": "<connect> 'rod' (./arm.xml, line 41) closes"},
    ),
    "r15, an equality of joints": (
        "six.xml", "</mujoco>", LEVEL, "",
        {"TS412": "cannot get to the start: it misses it by 142.5 mm"},
    ),
    "r21, an argument that is not given": (
        "six.urdf.xacro", ROOT, ARGUED, "", {"TS402": "an argument 'name' that has no value"},
    ),
    "r21, given": ("six.urdf.xacro", ROOT, ARGUED, "xacro: {name: mine}, ", {}),
}  # fmt: skip


def found(folder: Path, text: str) -> dict[str, str]:
    """The messages of a task by their codes, what is only for information left out."""
    (folder / "press.yaml").write_text(text)
    try:
        diagnostics = examine(load_task(folder / "press.yaml")).findings
    except SpecError as error:
        diagnostics = error.diagnostics
    return {each.code: each.message for each in diagnostics if each.code not in ("TS442", "TS446")}


def written(folder: Path, file: str, old: str, new: str) -> str:
    text = (DATA / file.removesuffix(".xacro")).read_text()
    assert old in text
    name = file.replace("six", "arm")
    (folder / name).write_text(text.replace(old, new, 1))
    return name


@pytest.mark.parametrize("name", CASES)
def test_what_is_found(tmp_path: Path, name: str) -> None:
    file, old, new, keys, expected = CASES[name]
    model = written(tmp_path, file, old, new)
    flange = "" if file == "six.xml" else "flange: tool0, "
    text = PRESS.format(model=model, keys=flange + keys, start=350, bench=300)
    reported = found(tmp_path, text)
    assert set(reported) == set(expected)
    for code, message in expected.items():
        assert message in reported[code]


def test_r08_and_r15_are_the_same_arm_where_they_reach(tmp_path: Path) -> None:
    """Of 250 mm more both get a warning of a joint near its limit, and of nothing else."""
    for case in ("r08, a joint that mimics", "r15, an equality of joints"):
        file, old, new, *_ = CASES[case]
        keys = "" if file == "six.xml" else "flange: tool0, "
        model = written(tmp_path, file, old, new)
        reported = found(tmp_path, PRESS.format(model=model, keys=keys, start=600, bench=550))
        assert set(reported) == {"TS417"}


def test_r22_a_package_that_is_its_own(tmp_path: Path) -> None:
    urdf = tmp_path / "arm_description" / "urdf"
    urdf.mkdir(parents=True)
    manifest = "<package format='3'><name>arm_description</name></package>"
    (urdf.parent / "package.xml").write_text(manifest)
    body = (DATA / "six.urdf").read_text().split(ROOT)[1].removesuffix("</robot>\n")
    macro = f'<robot {SPACE}><xacro:macro name="arm" params="prefix">{body}</xacro:macro></robot>'
    (urdf / "arm_macro.xacro").write_text(macro)
    include = '<xacro:include filename="$(find arm_description)/urdf/arm_macro.xacro"/>'
    top = f'{ROOT[:-1]} {SPACE}>{include}<xacro:arm prefix=""/></robot>'
    (urdf / "arm.urdf.xacro").write_text(top)
    model = "arm_description/urdf/arm.urdf.xacro"
    text = PRESS.format(model=model, keys="flange: tool0, ", start=350, bench=300)
    assert found(tmp_path, text) == {}
    shutil.rmtree(urdf.parent)
    assert set(found(tmp_path, text)) == {"TS401"}
