"""What people's files leave open: grippers, flanges, two arms, installed packages."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from taskspec.robot import RobotError, RobotModel
from taskspec.robot.inverse_kinematics import InverseKinematics
from taskspec.robot.packages import _robots, packaged_robots
from taskspec.spec import load_task

Load = Callable[..., RobotModel]
ERR = Path(__file__).parents[1] / "corpus" / "err"


def remarked(robot: RobotModel) -> dict[str, str]:
    return {remark.code: remark.message for remark in robot.remarks}


def tip(robot: RobotModel) -> pin.SE3:
    return InverseKinematics(robot).pose(robot.home)


def test_a_pose_in_the_flange_moves_the_tool(load: Load) -> None:
    mount = {"flange_xyz": (0.01, 0.02, 0.03), "flange_rpy": (0.0, np.pi / 2, 0.0)}
    plain = load("own.urdf", flange="palm", tool_length=0.0)
    turned = load("own.urdf", flange="palm", tool_length=0.0, **mount)
    found = tip(plain).inverse() * tip(turned)
    np.testing.assert_allclose(found.translation, mount["flange_xyz"], atol=1e-12)
    np.testing.assert_allclose(found.rotation[:, 2], [1, 0, 0], atol=1e-12)


def test_a_pose_needs_no_name(load: Load) -> None:
    found = load("bent.urdf", ERR, flange_rpy=(0.0, np.pi / 2, 0.0))
    assert found.flange == "hand"
    np.testing.assert_allclose(tip(found).translation, [1.0, 0, 0.3], atol=0.1 + 1e-9)


def test_a_flange_that_points_aside_is_remarked_with_its_cure(load: Load) -> None:
    (remark,) = load("bent.urdf", ERR).remarks
    assert remark.code == "TS441"
    assert remark.line == "flange: {body: hand, rpy: [0, 90 deg, 0]}"
    assert not load("bent.urdf", ERR, flange_rpy=(0.0, np.pi / 2, 0.0)).remarks


@pytest.mark.parametrize("name", ["panda", "ur5e", "planar2", "planar3"])
def test_nothing_is_remarked_of_built_in_arms(load: Load, name: str) -> None:
    assert not load(name).remarks


def test_an_arm_ends_before_its_gripper(load: Load) -> None:
    found = load("gripping.urdf", ERR)
    assert found.joint_names == ("lift", "reach", "wrist")
    assert "'jaw'" in remarked(found)["TS440"]
    named = load("gripping.urdf", ERR, flange="finger")
    assert named.joint_names[-1] == "jaw"
    assert "looks like a gripper's" in remarked(named)["TS440"]


def test_joints_of_a_wrist_are_none_of_a_gripper_by_their_link(load: Load, folder: Path) -> None:
    """Only the joint's own name counts, and only behind all others."""
    text = (ERR / "gripping.urdf").read_text().replace('name="lift"', 'name="finger_lift"')
    (folder / "arm.urdf").write_text(text.replace('"hand"', '"gripper"'))
    assert load("arm.urdf", folder).joint_names == ("finger_lift", "reach", "wrist")


def test_of_two_arms_one_is_asked_for(load: Load, folder: Path) -> None:
    text = (ERR / "bent.urdf").read_text()
    inner = text[text.index("  <joint") : text.index("</robot>")]
    other = inner
    for name in ("lift", "upper", "reach", "fore", "wrist", "hand"):
        other = other.replace(f'"{name}"', f'"{name}_2"')
    (folder / "two.urdf").write_text(text.replace("</robot>", other + "</robot>"))
    with pytest.raises(RobotError, match="has 2 arms of 3 joints") as caught:
        load("two.urdf", folder)
    assert caught.value.hint.endswith("flange: hand, hand_2")


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed package with three robots, two of one name."""
    site = tmp_path / "site"
    files = {
        "arms/bent_description/bent_robot.urdf": "bent.urdf",
        "arms/left/robot.urdf": "bent.urdf",
        "arms/right/left.urdf": "gripping.urdf",
    }
    for name, source in files.items():
        (site / name).parent.mkdir(parents=True)
        (site / name).write_text((ERR / source).read_text())
    info = site / "some_arms-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: some-arms\nVersion: 1.0\n")
    (info / "RECORD").write_text("".join(f"{name},,\n" for name in files))
    monkeypatch.syspath_prepend(site)
    _robots.cache_clear()
    yield site
    _robots.cache_clear()


def test_robots_of_packages_are_found_by_name(load: Load, package: Path) -> None:
    found = load("some-arms:bent")
    assert found.joint_names == ("lift", "reach", "wrist")
    assert found.source == "some-arms:bent"
    assert list(found.files) == [package / "arms/bent_description/bent_robot.urdf"]
    listed = [r.name for r in packaged_robots() if r.package == "some-arms"]
    assert listed == ["bent", "left", "left"]


def test_the_end_of_a_path_tells_robots_of_one_name_apart(load: Load, package: Path) -> None:
    assert package.is_dir()
    with pytest.raises(RobotError, match="has 2 robots 'left'") as caught:
        load("some-arms:left")
    assert "some-arms:left/robot.urdf" in caught.value.hint
    assert load("some-arms:right/left.urdf").remarks[0].code == "TS440"


def test_an_included_robot_of_a_package_keeps_its_name(tmp_path: Path) -> None:
    cell = tmp_path / "parts" / "cell.yaml"
    cell.parent.mkdir()
    cell.write_text("robot: {model: 'some-arms:right/left.urdf'}\n")
    task = tmp_path / "task.yaml"
    task.write_text("taskspec: 1\ninclude: [parts/cell.yaml]\nstages: {wait: {time: 1 s}}\n")
    assert load_task(task).task.robot.model == "some-arms:right/left.urdf"


@pytest.mark.parametrize(
    ("model", "message", "hint"),
    [
        ("some-arms:bend", "'some-arms' has no robot 'bend'", "did you mean 'bent'"),
        ("nowhere:arm", "no package 'nowhere' is installed", "pip install nowhere"),
    ],
)
def test_robots_that_no_package_has(
    load: Load, package: Path, model: str, message: str, hint: str
) -> None:
    assert str(package) in sys.path
    with pytest.raises(RobotError, match=message) as caught:
        load(model)
    assert hint in caught.value.hint


def test_bodies_without_mass_are_counted(load: Load, folder: Path) -> None:
    """A weightless tool may be what lacks a mass; where it has one, that is not said."""
    text = re.sub(r"<inertial>.*?</inertial>", "", (ERR / "bent.urdf").read_text(), flags=re.DOTALL)
    (folder / "bare.urdf").write_text(text)
    for mass, also in ((0.0, True), (1e-9, False)):
        with pytest.raises(RobotError, match="4 of the robot's 4 bodies have none") as caught:
            load("bare.urdf", folder, tool_mass=mass)
        assert ("or the tool a mass" in caught.value.hint) == also
