"""People's own URDF files, as people have them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from taskspec.robot import RobotError, RobotModel

Load = Callable[..., RobotModel]


def remarked(robot: RobotModel) -> dict[str, str]:
    return {remark.code: remark.message for remark in robot.remarks}


def noted(robot: RobotModel, text: str) -> bool:
    return any(text in note for note in robot.notes)


def test_joints_and_limits(load: Load) -> None:
    robot = load("own.urdf", flange="palm")
    assert robot.joint_names == ("pan", "lift", "elbow", "roll", "pitch", "turn")
    np.testing.assert_array_equal(robot.lower, [-2.9, -2.2, 0.2, -np.inf, -2, -3])
    np.testing.assert_array_equal(robot.upper, [2.9, 2.2, 2.6, np.inf, 2, 3])
    np.testing.assert_array_equal(robot.torque_limit, [90, 90, 60, 12, 12, 8])
    np.testing.assert_array_equal(robot.velocity_limit, [2.5, 2.5, 2.5, 3, 3, 3])
    np.testing.assert_array_equal(robot.model.actuator_ctrlrange[:, 1], robot.torque_limit)


def test_zero_out_of_range_becomes_the_middle(load: Load) -> None:
    np.testing.assert_allclose(load("own.urdf", flange="palm").home, [0, 0, 1.4, 0, 0, 0])


def test_fixed_links_stay(load: Load) -> None:
    robot = load("own.urdf", flange="palm")
    names = [robot.model.body(i).name for i in range(robot.model.nbody)]
    assert {"base_link", "mount", "palm"} <= set(names)


def test_fingers_are_locked(load: Load) -> None:
    robot = load("own.urdf", flange="palm")
    assert noted(robot, "locked: left at 0.025, right at 0.025")
    m = robot.model
    np.testing.assert_allclose(m.body("left_finger").pos, [0, 0.025, 0.01], atol=1e-12)
    np.testing.assert_allclose(m.body("right_finger").pos, [0, -0.025, 0.01], atol=1e-12)
    assert m.body_subtreemass[m.body("palm").id] == pytest.approx(0.1 + 0.3)


def test_inertias_are_those_of_the_file_alone(load: Load) -> None:
    m = load("own.urdf", flange="palm", tool_mass=0.0).model
    assert m.body("base_link").mass == 0
    assert m.body("mount").mass == 0
    assert m.body_mass.sum() == pytest.approx(3.5 + 4 + 2 + 0.8 + 0.6 + 0.7 + 0.1)


def test_damping_and_friction_are_left_out_and_noted(load: Load) -> None:
    robot = load("own.urdf", flange="palm")
    assert noted(robot, "has none: joint damping, joint friction")
    assert not robot.model.dof_damping.any()
    assert not robot.model.dof_frictionloss.any()


def test_absent_meshes_are_noted(load: Load) -> None:
    robot = load("own.urdf", flange="palm")
    assert noted(robot, "left out: absent.stl, tetra.stl")
    assert robot.model.nmesh == 0


@pytest.mark.parametrize(
    "place",
    ["arm_description/meshes", "meshes", "../arm_description/meshes", "../../meshes"],
)
def test_package_meshes_are_found_around(
    load: Load, folder: Path, tetrahedron: bytes, place: str
) -> None:
    (folder.parent / "package.xml").write_text("<package/>")
    folder = folder / "deep" if place.startswith("../..") else folder
    folder.mkdir(exist_ok=True)
    shutil.copy(Path(__file__).parent / "data" / "own.urdf", folder)
    (folder / place).mkdir(parents=True)
    (folder / place / "tetra.stl").write_bytes(tetrahedron)
    robot = load("own.urdf", folder, flange="palm")
    assert robot.model.nmesh == 1
    assert noted(robot, "left out: absent.stl")
    assert robot.flange == "palm"
    assert robot.spec.copy().compile().nmesh == 1


def test_package_meshes_outside_of_the_project_are_left_out(
    load: Load, folder: Path, tetrahedron: bytes
) -> None:
    (folder.parent / "meshes").mkdir()
    (folder.parent / "meshes" / "tetra.stl").write_bytes(tetrahedron)
    robot = load("own.urdf", folder, flange="palm")
    assert robot.model.nmesh == 0
    assert noted(robot, "lie outside of the project")


def test_broken_meshes_are_left_out(load: Load, folder: Path) -> None:
    (folder / "meshes").mkdir()
    (folder / "meshes" / "tetra.stl").write_bytes(b"no mesh at all")
    robot = load("own.urdf", folder, flange="palm")
    assert robot.model.nmesh == 0
    assert noted(robot, "meshes are left out")


def test_a_link_shows_its_visual_or_else_its_collision_shape(load: Load) -> None:
    m = load("own.urdf", flange="palm").model
    assert m.body("shoulder").geomnum == 1
    assert m.body("upper").geomnum == 1
    assert m.geom(m.body("upper").geomadr[0]).type == mujoco.mjtGeom.mjGEOM_CYLINDER
    assert not m.geom_contype.any()
    assert set(m.geom_group) == {1}


def test_without_a_flange_the_candidates_are_listed(load: Load, folder: Path) -> None:
    file = folder / "own.urdf"
    file.write_text(file.read_text().replace('<mimic joint="left"/>', ""))
    with pytest.raises(RobotError, match="ends in 2 places") as caught:
        load("own.urdf", folder)
    assert caught.value.code == "TS406"
    assert caught.value.hint.endswith("flange: palm, left_finger, right_finger")


def test_joints_that_follow_each_other_are_a_grippers(load: Load) -> None:
    robot = load("own.urdf")
    assert (robot.flange, len(robot.joint_names)) == ("palm", 6)
    assert [remark.code for remark in robot.remarks] == ["TS440"]


@pytest.mark.parametrize("name", ["flange", "tool0"])
def test_usual_flange_names_need_not_be_said(load: Load, folder: Path, name: str) -> None:
    path = folder / "own.urdf"
    text = re.sub(
        r'<joint name="(left|right)" type="prismatic">',
        r'<joint name="\1" type="fixed">',
        path.read_text(),
    )
    path.write_text(text)
    with pytest.raises(RobotError, match="ends in 2 places"):
        load("own.urdf", folder)
    path.write_text(text.replace("palm", name))
    assert load("own.urdf", folder).flange == name


def test_a_joint_that_mimics_follows_in_the_arm(load: Load) -> None:
    """`left` is no joint that moves this flange: a coordinate is what moves `right_finger`."""
    robot = load("own.urdf", flange="right_finger")
    assert robot.joint_names[-1] == "right"
    assert "'left' follows right" in remarked(robot)["TS447"]


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        ('lower="-2.9" upper="2.9"', 'lower="2.9" upper="-2.9"', "TS405", "lower 2.9 above"),
        ('mass value="4"', 'mass value="nan"', "TS405", "NaN: value of <mass>"),
        ('mass value="4"', 'mass value="-4"', "TS405", "link 'upper' has a negative"),
        ('mass value="4"', 'mass value="four"', "TS405", "value of <mass> is not a number"),
        ('mass value="4"', 'mass value="4e9"', "TS405", r"mass of 4e\+09 kg"),
        ('xyz="0 0 0.15"', 'xyz="0 0 150"', "TS405", "150 m from its parent"),
        ('xyz="0 0 0.15"', 'xyz="0 0"', "TS404", "does not have enough data"),
        ('parent link="fore"', 'parent link="four"', "TS404", "cannot compile 'own.urdf'"),
        ('"continuous"', '"floating"', "TS404", "free joint can only be used on top level"),
        ("<robot ", "<!DOCTYPE robot><robot ", "TS403", "document type"),
        ("<robot ", '<robot xmlns:xacro="http://wiki.ros.org/xacro"><xacro:x/></robot><robot ',
         "TS402", "not well-formed"),
        ("</robot>", "", "TS402", "not well-formed XML: line"),
        ("robot", "arm", "TS402", "it begins with <arm>"),
    ],
)  # fmt: skip
def test_spoiled(load: Load, folder: Path, old: str, new: str, code: str, message: str) -> None:
    path = folder / "own.urdf"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(RobotError, match=message) as caught:
        load("own.urdf", folder, flange="palm")
    assert caught.value.code == code


def test_inertias_that_no_body_has_are_mended_and_noted(load: Load, folder: Path) -> None:
    path = folder / "own.urdf"
    text = path.read_text()
    path.write_text(
        text.replace('iyy="0.06" iyz="0" izz="0.06"', 'iyy="0.06" iyz="0.5" izz="0.06"')
    )
    robot = load("own.urdf", folder, flange="palm")
    assert (
        "0.56, 0.01, -0.44 kg*m^2, and no body has a negative one: 0.19" in remarked(robot)["TS448"]
    )
    path.write_text(
        text.replace(
            'ixx="0.01" ixy="0" ixz="0" iyy="0.06"', 'ixx="0.3" ixy="0" ixz="0" iyy="0.06"'
        )
    )
    robot = load("own.urdf", folder, flange="palm")
    assert "link 'upper'" in remarked(robot)["TS448"]
    assert "0.3, 0.06, 0.06 kg*m^2" in remarked(robot)["TS448"]


def test_a_joint_that_moves_no_mass(load: Load, folder: Path) -> None:
    path = folder / "own.urdf"
    text = re.sub(r"<inertial>.*?</inertial>", "", path.read_text(), flags=re.DOTALL)
    path.write_text(text)
    with pytest.raises(RobotError, match="moves nothing that has a mass") as caught:
        load("own.urdf", folder, flange="palm", tool_mass=0.0)
    assert caught.value.code == "TS405"


def test_zero_effort_and_velocity_mean_not_given(load: Load, folder: Path) -> None:
    path = folder / "own.urdf"
    path.write_text(
        path.read_text().replace('effort="60" velocity="2.5"', 'effort="0" velocity="0"')
    )
    robot = load("own.urdf", folder, flange="palm")
    assert robot.torque_limit[2] == robot.velocity_limit[2] == np.inf
    assert not robot.model.actuator_ctrllimited[2]
