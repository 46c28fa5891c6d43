"""Inertias that no body has: which link, what is wrong, and what is used instead.

What is used is read off MuJoCo's and Pinocchio's model, not off the words.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from taskspec.robot import RobotError, RobotModel

Load = Callable[..., RobotModel]

URDF = '<inertia ixx="0.003" iyy="0.003" izz="0.002" ixy="0" ixz="0" iyz="0"/>'
MJCF = 'mass="1.5" diaginertia="0.003 0.003 0.002"'


def tensor(xx: float, yy: float, zz: float, xy: float = 0.0) -> str:
    return f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="0" iyz="0"/>'


def edited(folder: Path, base: str, old: str, new: str) -> str:
    text = (folder / base).read_text()
    assert old in text
    (folder / f"arm{Path(base).suffix}").write_text(text.replace(old, new, 1))
    return f"arm{Path(base).suffix}"


def moments(robot: RobotModel, link: str = "l4") -> list[float]:
    """Of a link, as both engines have them, ascending."""
    found = sorted(robot.model.body(link).inertia.tolist())
    joint = robot.pin.getJointId(link.replace("l", "j"))
    twin = np.linalg.eigvalsh(robot.pin.inertias[joint].inertia)
    np.testing.assert_allclose(twin, found, rtol=1e-9, atol=1e-15)
    return found


def remarked(robot: RobotModel) -> list[str]:
    return [remark.message for remark in robot.remarks if remark.code == "TS448"]


@pytest.mark.parametrize(
    ("given", "used", "said"),
    [
        # r02: the triangle is broken, 0.007 > 0.003 + 0.002.
        (tensor(0.007, 0.003, 0.002), 0.004,
         "link 'l4' has principal moments of inertia 0.007, 0.003, 0.002 kg*m^2, and of no body "
         "is the largest more than the sum of the other two: 0.004 kg*m^2, their mean, is used "
         "about every axis"),
        # r03: two moments are negative.
        (tensor(-0.003, -0.003, 0.002), 0.002 / 3,
         "link 'l4' has principal moments of inertia 0.002, -0.003, -0.003 kg*m^2, and no body has "
         "a negative one: 0.0006667 kg*m^2, the mean of the three with negative ones taken as "
         "zero, is used about every axis"),
        # A product of inertia larger than its moments: principal ones are 0.013, 0.002, -0.007.
        (tensor(0.003, 0.003, 0.002, 0.01), 0.005, "0.013, 0.002, -0.007 kg*m^2, and no body has"),
        # Each moment by itself is fine, but not about the principal axes: 0.006, 0.003, 0.001.
        (tensor(0.0035, 0.0035, 0.003, 0.0025), 0.01 / 3, "0.006, 0.003, 0.001 kg*m^2, and of no"),
        # Given in g*mm^2 for one axis, as when a column was mixed up.
        (tensor(3000, 0.003, 0.002), 3000.005 / 3, "3000, 0.003, 0.002 kg*m^2, and of no body"),
    ],
)  # fmt: skip
def test_the_link_and_what_is_used_are_named(
    load: Load, folder: Path, given: str, used: float, said: str
) -> None:
    robot = load(edited(folder, "six.urdf", URDF, given), folder, flange="tool0")
    np.testing.assert_allclose(moments(robot), [used] * 3, rtol=1e-9)
    (found,) = remarked(robot)
    assert said in found


@pytest.mark.parametrize(
    ("given", "used"),
    [
        ('mass="1.5" diaginertia="0.007 0.003 0.002"', 0.004),
        ('mass="1.5" diaginertia="-0.003 -0.003 0.002"', 0.002 / 3),
        ('mass="1.5" fullinertia="0.003 0.003 0.002 0.01 0 0"', 0.005),
        ('mass="1.5" euler="0.3 0 0" diaginertia="0.007 0.003 0.002"', 0.004),
    ],
)
def test_of_mjcf_too(load: Load, folder: Path, given: str, used: float) -> None:
    robot = load(edited(folder, "six.xml", MJCF, given), folder)
    np.testing.assert_allclose(moments(robot), [used] * 3, rtol=1e-9)
    assert len(remarked(robot)) == 1


@pytest.mark.parametrize(
    "given",
    [
        tensor(0.003, 0.003, 0.006),  # A flat plate: the largest is the sum of the others.
        tensor(0.004, 0.004, 0.0),  # A rod.
        tensor(0.0, 0.0, 0.0),  # A point mass.
        tensor(2.4e-35, 0.0, -2.4e-35),  # A point, but for rounding, as a CAD export has it.
        tensor(0.1 + 0.2, 0.1, 0.2),  # A plate, but for rounding.
    ],
)
def test_plates_rods_and_points_are_bodies(load: Load, folder: Path, given: str) -> None:
    robot = load(edited(folder, "six.urdf", URDF, given), folder, flange="tool0")
    assert not remarked(robot)


def test_digits_that_a_file_has_left_out_are_no_fault(load: Load, folder: Path) -> None:
    """A plate in three digits: 0.00301 > 0.002 + 0.001, which rounds by 1e-5 and is noted."""
    name = edited(folder, "six.urdf", URDF, tensor(0.001, 0.002, 0.003001))
    robot = load(name, folder, flange="tool0")
    assert not remarked(robot)
    np.testing.assert_allclose(moments(robot), [0.001, 0.002, 0.003], rtol=1e-6)
    assert any("'l4' are rounded by 1e-06" in note for note in robot.notes)
    # Its axes stay: z is the one of the largest.
    turned = robot.pin.inertias[robot.pin.getJointId("j4")].inertia
    np.testing.assert_allclose(np.diag(turned), [0.001, 0.002, 0.003], rtol=1e-6)


def test_links_that_the_arm_does_not_move_have_no_inertia_that_matters(
    load: Load, folder: Path
) -> None:
    base = '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>'
    robot = load(edited(folder, "six.urdf", base, tensor(-1, 1, 1)), folder, flange="tool0")
    assert not remarked(robot)


def test_inertias_that_the_file_takes_from_its_shapes_are_not_judged(
    load: Load, folder: Path
) -> None:
    """MuJoCo does not read the <inertial> then."""
    text = (folder / "six.xml").read_text().replace(MJCF, 'mass="1.5" diaginertia="1 -1 1"')
    text = text.replace('angle="radian"', 'angle="radian" inertiafromgeom="true"')
    text = text.replace("<joint name=", '<geom size="0.05" mass="1"/><joint name=')
    (folder / "arm.xml").write_text(text)
    robot = load("arm.xml", folder)
    assert not remarked(robot)
    assert robot.model.body("l4").mass[0] == pytest.approx(1.0)


def test_a_negative_mass_is_an_error(load: Load, folder: Path) -> None:
    name = edited(folder, "six.xml", MJCF, MJCF.replace("1.5", "-1.5"))
    with pytest.raises(RobotError, match=r"link 'l4' has a negative mass, -1.5 kg"):
        load(name, folder)
