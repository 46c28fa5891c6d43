"""xacro files as vendors ship them, expanded by xacro itself."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from taskspec.robot import RobotError, RobotModel
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError

Load = Callable[..., RobotModel]

SPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
TASK = "taskspec: 1\nrobot: {model: panda, xacro: WRITTEN}\nstages: {wait: {time: 1 s}}\n"
MANIFEST = "<package format='3'><name>{}</name></package>"


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)


def six(folder: Path, name: str, *edits: tuple[str, str]) -> str:
    """The arm of six joints in xacro's namespace, in a file of that name."""
    text = (
        (folder / "six.urdf")
        .read_text()
        .replace('<robot name="arm6">', f'<robot name="arm6" {SPACE}>')
    )
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    return name


ROOT = f'<robot name="arm6" {SPACE}>'
ARGUED = (
    (ROOT, f'<robot name="$(arg name)" {SPACE}><xacro:arg name="name"/>'
           '<xacro:arg name="payload" default="1.5"/>'),
    ('<mass value="1.5"/>', '<mass value="$(arg payload)"/>'),
)  # fmt: skip


@pytest.mark.parametrize(
    "unused",
    [
        "",
        '<xacro:property name="width" value=".2"/>',
        '<xacro:property name="width" value="${2 * 0.1}"/><xacro:arg name="hand" default="no"/>',
        '<xacro:macro name="box" params="size"><box size="${size}"/></xacro:macro>',
    ],
)
def test_a_finished_file_with_a_definition_that_nothing_uses_loads(
    load: Load, folder: Path, monkeypatch: pytest.MonkeyPatch, unused: str
) -> None:
    """r01: 27 of 28 files of a vendor have one; nothing in them is left to be expanded."""
    monkeypatch.setattr("taskspec.robot.xacro_file.find_spec", lambda _: None)
    for name in ("arm.urdf", "arm.urdf.xacro"):
        robot = load(six(folder, name, (ROOT, ROOT + unused)), folder, flange="tool0")
        assert robot.n == 6


@pytest.mark.parametrize(
    "used",
    [
        (ROOT, f'{ROOT}<xacro:property name="m" value="1.5"/><link name="${{m}}"/>'),
        (ROOT, f'{ROOT}<xacro:include filename="more.xacro"/>'),
        (ROOT, f'{ROOT}<xacro:if value="true"><link name="also"/></xacro:if>'),
    ],
)
def test_advice_without_xacro_does_not_empty_the_file(
    load: Load, folder: Path, monkeypatch: pytest.MonkeyPatch, used: tuple[str, str]
) -> None:
    """`xacro arm.urdf > arm.urdf` empties the file before xacro reads it."""
    monkeypatch.setattr("taskspec.robot.xacro_file.find_spec", lambda _: None)
    with pytest.raises(RobotError, match="is not installed") as caught:
        load(six(folder, "arm.urdf", used), folder, flange="tool0")
    assert caught.value.hint.endswith("xacro arm.urdf -o arm.expanded.urdf")
    assert ">" not in caught.value.hint


def test_arguments_of_the_file_are_given_in_the_task(load: Load, folder: Path) -> None:
    name = six(folder, "arm.urdf.xacro", *ARGUED)
    mass = {}
    for payload in ("1.5", "2.5"):
        arguments = {"name": "mine", "payload": payload}
        mass[payload] = load(name, folder, flange="tool0", xacro=arguments).carried_mass(3)
    assert mass["2.5"] - mass["1.5"] == pytest.approx(1.0)
    left = load(name, folder, flange="tool0", xacro={"name": "mine"})
    assert left.carried_mass(3) == mass["1.5"]


def test_an_argument_without_a_value_is_named_with_all_others(load: Load, folder: Path) -> None:
    """r21, the form of UR's own top file: `name` has no default."""
    with pytest.raises(RobotError, match="argument 'name' that has no value") as caught:
        load(six(folder, "arm.urdf.xacro", *ARGUED), folder, flange="tool0")
    assert "xacro: {name: VALUE}" in caught.value.hint
    assert caught.value.hint.endswith("arguments of the file: name, payload (else 1.5)")


def test_an_argument_that_is_used_and_not_declared_is_named_too(load: Load, folder: Path) -> None:
    used = ('<mass value="1.5"/>', '<mass value="$(arg payload)"/>')
    name = six(folder, "arm.urdf.xacro", used)
    with pytest.raises(RobotError, match="argument 'payload' that has no value"):
        load(name, folder, flange="tool0")
    assert load(name, folder, flange="tool0", xacro={"payload": "1.5"}).n == 6


@pytest.mark.parametrize(
    ("model", "given", "message", "field"),
    [
        ("arm.urdf.xacro", {"name": "a", "paylod": "2"}, "has no argument 'paylod'", "paylod"),
        ("plain.urdf.xacro", {"name": "a"}, "has no argument 'name'", "name"),
        ("six.urdf", {"name": "a"}, "is not xacro: it has no arguments", "xacro"),
        ("six.xml", {"name": "a"}, "is not xacro: it has no arguments", "xacro"),
        ("panda", {"name": "a"}, "is built in: it has no arguments", "xacro"),
    ],
)
def test_arguments_that_a_file_does_not_have_are_refused(
    load: Load, folder: Path, model: str, given: dict[str, str], message: str, field: str
) -> None:
    six(folder, "arm.urdf.xacro", *ARGUED)
    six(folder, "plain.urdf.xacro")
    with pytest.raises(RobotError, match=message) as caught:
        load(model, folder, xacro=given)
    assert (caught.value.code, caught.value.field[-1]) == ("TS402", field)


def packaged(folder: Path, package: Path, name: str) -> str:
    """A top file that includes its macro by the name of a package, which lies at `package`."""
    macro = six(
        package,
        "urdf/macro.xacro",
        (ROOT, f'<robot {SPACE}><xacro:macro name="arm6" params="prefix">'),
        ("</robot>", "</xacro:macro></robot>"),
    )
    assert (package / macro).is_file()
    (package / "package.xml").write_text(MANIFEST.format(name))
    included = f'<xacro:include filename="$(find {name})/urdf/macro.xacro"/>'
    (folder / "top.urdf.xacro").write_text(f'{ROOT}{included}<xacro:arm6 prefix=""/></robot>')
    return "top.urdf.xacro"


@pytest.mark.parametrize(
    ("at", "top"),
    [
        ("robots/arm_description", "robots/arm_description/urdf"),
        ("robots/arm_description", "robots"),
        ("robots/checkout-of-it", "robots/checkout-of-it/urdf"),
        ("robots/checkout-of-it", "robots"),
        (".", "robots"),
    ],
)
def test_a_package_is_found_beside_and_above_the_file(
    load: Load, folder: Path, at: str, top: str
) -> None:
    """r22: by its folder's name, or by the name in its package.xml."""
    (folder / at).mkdir(parents=True, exist_ok=True)
    (folder / at / "six.urdf").write_text((folder / "six.urdf").read_text())
    (folder / top).mkdir(parents=True, exist_ok=True)
    name = packaged(folder / top, folder / at, "arm_description")
    robot = load(f"{top}/{name}", folder, flange="tool0")
    assert robot.n == 6
    assert any(path.name == "macro.xacro" for path in robot.files)


@pytest.mark.parametrize(
    ("variable", "below", "at"),
    [
        ("AMENT_PREFIX_PATH", "", "share/arm_description"),
        ("ROS_PACKAGE_PATH", "", "arm_description"),
        ("ROS_PACKAGE_PATH", "", "vendor/arm_description"),
        ("ROS_PACKAGE_PATH", "arm_description", "arm_description"),
    ],
)
def test_a_package_is_found_where_the_environment_says(
    load: Load, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    variable: str, below: str, at: str,
) -> None:  # fmt: skip
    workspace = tmp_path / "elsewhere"
    package = workspace / at
    package.mkdir(parents=True)
    (package / "six.urdf").write_text((folder / "six.urdf").read_text())
    name = packaged(folder, package, "arm_description")
    with pytest.raises(RobotError, match=r"needs the package 'arm_description'") as caught:
        load(name, folder, flange="tool0")
    assert "ROS_PACKAGE_PATH or AMENT_PREFIX_PATH" in caught.value.hint
    monkeypatch.setenv(variable, os.pathsep.join((str(tmp_path / "no"), str(workspace / below))))
    robot = load(name, folder, flange="tool0")
    assert robot.n == 6
    # Which files that reads may be another matter another time.
    assert robot.absent is None


def test_a_package_is_found_among_installed_ones(
    load: Load, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    package = site / "some_arms" / "arm_description"
    package.mkdir(parents=True)
    (package / "six.urdf").write_text((folder / "six.urdf").read_text())
    name = packaged(folder, package, "arm_description")
    info = site / "some_arms-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: some-arms\nVersion: 1.0\n")
    (info / "RECORD").write_text(
        "some_arms/arm_description/package.xml,,\nsome_arms/arm_description/urdf/macro.xacro,,\n"
    )
    monkeypatch.syspath_prepend(site)
    assert load(name, folder, flange="tool0").n == 6


def test_meshes_of_a_package_are_found_where_the_environment_says(
    load: Load, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tetrahedron: bytes
) -> None:
    meshes = tmp_path / "ros" / "share" / "arm_description" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "hand.stl").write_bytes(tetrahedron)
    (meshes.parent / "package.xml").write_text(MANIFEST.format("arm_description"))
    drawn = (
        '<link name="tool0"/>',
        '<link name="tool0"><visual><geometry><mesh filename='
        '"package://arm_description/meshes/hand.stl"/></geometry></visual></link>',
    )
    name = six(folder, "arm.urdf", drawn)
    assert any("hand.stl" in note for note in load(name, folder, flange="tool0").notes)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    assert not any("hand.stl" in note for note in load(name, folder, flange="tool0").notes)


def test_a_file_from_elsewhere_is_still_refused(load: Load, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "secret.xacro").write_text(f"<robot {SPACE}/>")
    included = (ROOT, f'{ROOT}<xacro:include filename="../secret.xacro"/>')
    with pytest.raises(RobotError) as caught:
        load(six(folder, "arm.urdf.xacro", included), folder, flange="tool0")
    assert caught.value.code == "TS409"


def test_what_xacro_says_is_shown(load: Load, folder: Path) -> None:
    broken = ('<mass value="1.5"/>', '<mass value="${heavy}"/>')
    with pytest.raises(RobotError, match=r"cannot expand 'arm\.urdf\.xacro': .*heavy"):
        load(six(folder, "arm.urdf.xacro", broken), folder, flange="tool0")


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("{name: ur5e, safe: true, load: 1.50}", {"name": "ur5e", "safe": "true", "load": "1.50"}),
        ("{}", {}),
    ],
)  # fmt: skip
def test_values_are_taken_as_they_are_written(written: str, read: dict[str, str]) -> None:
    text = (
        f"taskspec: 1\nrobot: {{model: panda, xacro: {written}}}\nstages: {{wait: {{time: 1 s}}}}\n"
    )
    assert load_text(text, "task.yaml").task.robot.xacro == read


@pytest.mark.parametrize("written", ["ur5e", "[name]", "{name: [a]}"])
def test_arguments_are_names_with_values(written: str) -> None:
    text = (
        f"taskspec: 1\nrobot: {{model: panda, xacro: {written}}}\nstages: {{wait: {{time: 1 s}}}}\n"
    )
    with pytest.raises(SpecError) as caught:
        load_text(text, "task.yaml")
    (found,) = caught.value.diagnostics
    assert found.code == "TS022"
    assert "xacro: {name: ur5e}" in found.hint


#: Modules that the process which expands a file imports, or may.
IMPORTED = ("contextlib", "json", "sys", "xacro", "yaml", "ast", "glob", "math", "re",
            "sitecustomize", "usercustomize", "xml", "copy", "random")  # fmt: skip


@pytest.mark.parametrize("place", ["beside it", "where it is called"])
def test_nothing_that_lies_beside_a_robot_is_imported(
    load: Load,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    place: str,
) -> None:
    """Each module leaves a mark if it is imported, and is found first by a path that has it."""
    six(folder, "arm.xacro", *ARGUED)
    mark = tmp_path / "imported"
    there = folder if place == "beside it" else tmp_path / "working"
    there.mkdir(exist_ok=True)
    for name in IMPORTED:
        (there / f"{name}.py").write_text(f"open({str(mark)!r}, 'a').write({name!r})\n")
    monkeypatch.chdir(there)
    # As `python -m` and an empty entry of PYTHONPATH have it.
    monkeypatch.setattr(sys, "path", ["", str(there), *sys.path])
    assert load("arm.xacro", folder, xacro={"name": "six"}).name == "arm"
    assert not mark.exists()
    # The mark is one that a process which looks there would leave.
    subprocess.run([sys.executable, "-c", "import yaml"], cwd=there, check=True)
    assert mark.read_text() == "yaml"
