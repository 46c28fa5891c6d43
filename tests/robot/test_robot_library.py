"""The built-in robots have the figures that were published."""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections.abc import Callable
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from taskspec.robot import RobotError, RobotModel, builtin_names, builtin_robots
from taskspec.robot.library import _MODELS

Load = Callable[..., RobotModel]
DEG = np.pi / 180


def tip(robot: RobotModel, q: object) -> pin.SE3:
    data = robot.pin.createData()
    pin.forwardKinematics(robot.pin, data, np.array(q, dtype=float))
    return data.oMi[robot.tip_joint] * robot.tip


def denavit_hartenberg(theta: float, d: float, a: float, alpha: float) -> pin.SE3:
    turn = pin.SE3(pin.utils.rotate("z", theta), np.array([0, 0, d]))
    return turn * pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0, 0]))


def test_names() -> None:
    assert builtin_names() == ("planar2", "planar3", "ur5e", "panda")


@pytest.mark.parametrize("name", builtin_names())
def test_summary_says_what_is_loaded(load: Load, name: str) -> None:
    robot = load(name)
    summary = {summary.name: summary for summary in builtin_robots()}[name]
    assert summary.axes == robot.axes
    assert summary.joints == robot.home.size == len(robot.joint_names)
    assert summary.source == robot.source
    assert summary.about
    assert robot.notes == ()


@pytest.mark.parametrize("name", builtin_names())
def test_home_is_inside_the_limits_and_not_singular(load: Load, name: str) -> None:
    robot = load(name)
    assert (robot.home > robot.lower).all()
    assert (robot.home < robot.upper).all()
    assert np.isfinite(robot.velocity_limit).all()
    assert np.isfinite(robot.torque_limit).all()
    data = robot.pin.createData()
    J = pin.computeFrameJacobian(
        robot.pin, data, robot.home, robot.pin.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED
    )
    rows = [("x", "y", "z", "rx", "ry", "rz").index(axis) for axis in robot.axes]
    assert np.linalg.svd(J[rows])[1][-1] > 0.05


@pytest.mark.parametrize("name", builtin_names())
def test_holds_its_own_weight(load: Load, name: str) -> None:
    robot = load(name)
    g = pin.computeGeneralizedGravity(robot.pin, robot.pin.createData(), robot.home)
    assert (np.abs(g) < 0.9 * robot.torque_limit).all()


@pytest.mark.parametrize("name", builtin_names())
def test_files_are_small_and_need_no_other(name: str) -> None:
    path = _MODELS / f"{name}.xml"
    root = ElementTree.parse(path).getroot()
    assert path.stat().st_size < 10_000
    assert not [element for element in root.iter() if element.get("file")]


@pytest.mark.parametrize("name", builtin_names())
def test_nothing_collides(load: Load, name: str) -> None:
    m = load(name).model
    assert not m.geom_contype.any()
    assert not m.geom_conaffinity.any()
    assert set(m.geom_group) == {1}


def test_panda_is_at_the_published_pose(load: Load) -> None:
    # Modified Denavit-Hartenberg table of the manufacturer: a, d, alpha of every joint.
    table = (
        (0, 0.333, 0), (0, 0, -90), (0, 0.316, 90), (0.0825, 0, 90),
        (-0.0825, 0.384, -90), (0, 0, 90), (0.088, 0, 90),
    )  # fmt: skip
    robot = load("panda", tool_length=0.0)
    q = np.array([0.3, -0.5, 0.7, -1.9, 0.2, 1.6, -0.4])
    flange = pin.SE3.Identity()
    for angle, (a, d, alpha) in zip(q, table, strict=True):
        flange *= pin.SE3(pin.utils.rotate("x", alpha * DEG), np.array([a, 0, 0]))
        flange *= pin.SE3(pin.utils.rotate("z", angle), np.array([0, 0, d]))
    flange *= pin.SE3(pin.utils.rotate("z", -45 * DEG), np.array([0, 0, 0.107]))
    assert tip(robot, q).isApprox(flange, 1e-9)


def test_panda_looks_straight_down_at_home(load: Load) -> None:
    np.testing.assert_allclose(
        tip(load("panda"), load("panda").home).rotation, np.diag([1, -1, -1]), atol=1e-9
    )


def test_panda_has_the_identified_masses(load: Load) -> None:
    robot = load("panda", tool_mass=0.0)
    masses = [inertia.mass for inertia in robot.pin.inertias][1:]
    identified = [4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522]
    np.testing.assert_allclose(masses, identified, rtol=1e-9)
    np.testing.assert_allclose(robot.torque_limit, [87, 87, 87, 87, 12, 12, 12])
    np.testing.assert_allclose(robot.velocity_limit, [2.175] * 4 + [2.61] * 3)


def test_ur5e_is_at_the_published_pose(load: Load) -> None:
    # Denavit-Hartenberg table of the manufacturer: d, a, alpha of every joint.
    table = (
        (0.1625, 0, 90), (0, -0.425, 0), (0, -0.3922, 0),
        (0.1333, 0, 90), (0.0997, 0, -90), (0.0996, 0, 0),
    )  # fmt: skip
    robot = load("ur5e", tool_length=0.0)
    q = np.array([0.3, -1.2, 1.4, -1.1, -0.8, 0.5])
    flange = pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3))
    for angle, (d, a, alpha) in zip(q, table, strict=True):
        flange *= denavit_hartenberg(angle, d, a, alpha * DEG)
    assert tip(robot, q).isApprox(flange, 1e-9)


def test_ur5e_has_the_published_masses(load: Load) -> None:
    robot = load("ur5e", tool_mass=0.0)
    masses = [inertia.mass for inertia in robot.pin.inertias][1:]
    np.testing.assert_allclose(masses, [3.761, 8.058, 2.846, 1.37, 1.3, 0.365])
    np.testing.assert_allclose(robot.torque_limit, [150, 150, 150, 28, 28, 28])
    np.testing.assert_allclose(robot.velocity_limit, np.pi, rtol=1e-8)
    # The links' centres of mass in the Denavit-Hartenberg frames, as published.
    published = (
        (0, -0.02561, 0.00193), (0.2125, 0, 0.11336), (0.15, 0, 0.0265),
        (0, -0.0018, 0.01634), (0, 0.0018, 0.01634), (0, 0, -0.001159),
    )  # fmt: skip
    frame = pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3))
    table = (
        (0.1625, 0, 90), (0, -0.425, 0), (0, -0.3922, 0),
        (0.1333, 0, 90), (0.0997, 0, -90), (0.0996, 0, 0),
    )  # fmt: skip
    data = robot.pin.createData()
    pin.forwardKinematics(robot.pin, data, np.zeros(6))
    for i, (row, lever) in enumerate(zip(table, published, strict=True)):
        frame *= denavit_hartenberg(0.0, row[0], row[1], row[2] * DEG)
        center = data.oMi[i + 1].act(robot.pin.inertias[i + 1].lever)
        np.testing.assert_allclose(frame.act(np.array(lever)), center, atol=1e-9)


def test_planar_arms_move_in_the_plane_and_end_where_the_last_link_does(load: Load) -> None:
    for name, lengths in (("planar2", (0.3, 0.3)), ("planar3", (0.3, 0.3, 0.15))):
        robot = load(name)
        q = np.linspace(0.3, 0.9, len(lengths))
        heading = np.cumsum(q)
        at = tip(robot, q)
        x, y = (np.dot(lengths, f(heading)) for f in (np.cos, np.sin))
        np.testing.assert_allclose(at.translation, [x, y, 0], atol=1e-12)
        along = [np.cos(heading[-1]), np.sin(heading[-1]), 0]
        np.testing.assert_allclose(at.rotation[:, 2], along, atol=1e-12)
        gravity = pin.computeGeneralizedGravity(robot.pin, robot.pin.createData(), q)
        np.testing.assert_allclose(gravity, 0, atol=1e-12)


def test_axes(load: Load) -> None:
    assert load("planar2").axes == ("x", "y")
    assert load("planar3").axes == ("x", "y", "rz")
    assert load("ur5e").axes == load("panda").axes == ("x", "y", "z", "rx", "ry", "rz")
    assert load("planar3", base_rpy=(np.pi / 2, 0, 0)).axes == ("x", "z", "ry")


def test_a_plane_that_is_not_the_worlds_is_an_error(load: Load) -> None:
    with pytest.raises(RobotError, match="cannot move the tip along the world's x, y, z") as caught:
        load("planar2", base_rpy=(0.5, 0.3, 0))
    assert caught.value.code == "TS408"
    assert caught.value.field == ("base",)


def test_a_misspelt_name_is_an_error(load: Load) -> None:
    with pytest.raises(RobotError, match="no robot 'pnada'") as caught:
        load("pnada")
    assert (caught.value.code, caught.value.hint) == ("TS401", "did you mean 'panda'?")
    for another in ("kuka", "ur10e", "planar4"):
        with pytest.raises(RobotError) as caught:
            load(another)
        assert "planar2, planar3, ur5e, panda" in caught.value.hint


def test_specification_can_be_copied_and_extended(load: Load) -> None:
    robot = load("panda")
    spec = robot.spec.copy()
    spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], contype=0, conaffinity=0
    )
    spec.add_pair(geomname1="table", geomname2=robot.tool_geoms[0])
    m = spec.compile()
    assert (m.ngeom, m.npair) == (robot.model.ngeom + 1, 1)
    assert robot.spec.compile().ngeom == robot.model.ngeom


def test_loading_is_repeatable(load: Load) -> None:
    one, two = load("panda"), load("panda")
    for field in ("body_pos", "body_quat", "body_inertia", "body_iquat", "geom_pos", "geom_quat"):
        np.testing.assert_array_equal(getattr(one.model, field), getattr(two.model, field))


def test_loading_is_quick(load: Load) -> None:
    load("panda")
    times = []
    for _ in range(5):
        start = time.perf_counter()
        load("panda")
        times.append(time.perf_counter() - start)
    assert min(times) < 0.03


def test_import_brings_no_other_heavy_package() -> None:
    code = "import sys, taskspec.robot; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(done.stdout.split())
    heavy = ("casadi", "scipy", "pydantic", "pyarrow", "rich", "pandas")
    assert not modules.intersection(heavy)


def test_no_geom_of_a_link_reaches_far_from_it(load: Load) -> None:
    for name, at_home in itertools.product(builtin_names(), (True, False)):
        robot = load(name)
        d = mujoco.MjData(robot.model)
        d.qpos[:] = robot.home if at_home else (robot.lower + robot.upper) / 2
        mujoco.mj_kinematics(robot.model, d)
        span = d.geom_xpos - d.xpos[robot.model.geom_bodyid]
        assert np.linalg.norm(span, axis=1).max() < 0.5
