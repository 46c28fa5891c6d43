"""The tool: where it ends, what it touches with, what it weighs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from taskspec.robot import RobotError, RobotModel

Load = Callable[..., RobotModel]


def tip_above_flange(robot: RobotModel, bare: RobotModel) -> np.ndarray:
    return bare.tip.actInv(robot.tip).translation


def test_default_is_a_sphere_on_a_stem(load: Load) -> None:
    robot = load("panda", tool_mass=0.0)
    bare = load("panda", tool_length=0.0)
    np.testing.assert_allclose(tip_above_flange(robot, bare), [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(robot.tool.centers, [[0, 0, -0.01]])
    np.testing.assert_allclose(robot.tool.radii, [0.01])
    assert not robot.tool.flat
    assert robot.model.body(robot.tip_body).mass == 0


def test_planar_tool_ends_where_the_link_does(load: Load) -> None:
    robot = load("planar2")
    d = mujoco.MjData(robot.model)
    d.qpos[:] = 0
    mujoco.mj_forward(robot.model, d)
    np.testing.assert_allclose(d.body(robot.tip_body).xpos, [0.6, 0, 0], atol=1e-12)
    longer = load("planar2", tool_length=0.05)
    mujoco.mj_forward(longer.model, d := mujoco.MjData(longer.model))
    np.testing.assert_allclose(d.body(longer.tip_body).xpos, [0.65, 0, 0], atol=1e-12)


CYLINDER = {"tool_shape": "cylinder", "tool_radius": 0.03}
BOX = {"tool_shape": "box", "tool_size": (0.06, 0.04, 0.02)}


@pytest.mark.parametrize(("keys", "points"), [(CYLINDER, 8), (BOX, 4)])
def test_flat_tools_touch_with_small_spheres_in_their_face(
    load: Load, keys: dict[str, Any], points: int
) -> None:
    tool = load("panda", **keys).tool
    assert tool.flat
    assert tool.centers.shape == (points, 3)
    assert tool.radii.shape == (points,)
    np.testing.assert_allclose(tool.centers[:, 2] - tool.radii, -2 * tool.radii)
    np.testing.assert_allclose(tool.centers[:, 2] + tool.radii, 0, atol=1e-15)
    assert (tool.radii <= 0.0005).all()
    np.testing.assert_allclose(tool.centers[:, :2].mean(axis=0), 0, atol=1e-15)


def test_spheres_touch_the_edge_of_the_face(load: Load) -> None:
    tool = load("panda", **CYLINDER).tool
    np.testing.assert_allclose(np.linalg.norm(tool.centers[:, :2], axis=1) + tool.radii, 0.03)
    tool = load("panda", **BOX).tool
    np.testing.assert_allclose(
        (np.abs(tool.centers[:, :2]) + tool.radii[:, None]).max(axis=0), [0.03, 0.02]
    )


@pytest.mark.parametrize("keys", [{}, CYLINDER, BOX])
def test_geoms_are_the_spheres(load: Load, keys: dict[str, Any]) -> None:
    robot = load("panda", **keys)
    m = robot.model
    assert len(robot.tool_geoms) == len(robot.tool.radii)
    for name, center, radius in zip(
        robot.tool_geoms, robot.tool.centers, robot.tool.radii, strict=True
    ):
        geom = m.geom(name)
        assert geom.type == mujoco.mjtGeom.mjGEOM_SPHERE
        assert m.body(geom.bodyid[0]).name == robot.tip_body
        np.testing.assert_allclose(geom.pos, center, atol=1e-15)
        assert geom.size[0] == radius


@pytest.mark.parametrize("keys", [{}, CYLINDER, BOX, {"tool_length": 0.0}])
def test_mass_is_that_of_uniform_solids(load: Load, keys: dict[str, Any]) -> None:
    robot = load("panda", tool_mass=0.4, **keys)
    body = robot.model.body(robot.tip_body)
    assert body.mass == pytest.approx(0.4)
    length = keys.get("tool_length", 0.1)
    assert -max(length, 0.02) < body.ipos[2] < 0
    inertia = np.sort(body.inertia)
    assert inertia[0] > 0
    assert inertia[0] + inertia[1] >= inertia[2]


def test_a_box_weighs_as_a_box_and_stem(load: Load) -> None:
    robot = load("panda", tool_mass=1.0, tool_length=0.02, **BOX)
    body = robot.model.body(robot.tip_body)
    np.testing.assert_allclose(body.ipos, [0, 0, -0.01], atol=1e-12)
    x, y, z = BOX["tool_size"]
    expected = np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2]) / 12
    np.testing.assert_allclose(body.inertia, expected)


def test_a_cylinder_is_one_over_its_whole_length(load: Load) -> None:
    robot = load("panda", tool_mass=1.0, tool_length=0.15, **CYLINDER)
    body = robot.model.body(robot.tip_body)
    np.testing.assert_allclose(body.ipos, [0, 0, -0.075], atol=1e-12)
    across = 0.03**2 / 4 + 0.15**2 / 12
    np.testing.assert_allclose(body.inertia, [across, across, 0.03**2 / 2])
    assert robot.tool.solid.length == 0.15
    disc = load("panda", tool_length=0.0, **CYLINDER)
    assert disc.tool.solid.length == 0.015


@pytest.mark.parametrize(
    "inertia", [None, (3e-3, 2e-3, 2.5e-3), (3e-3, 2e-3, 2.5e-3, 4e-4, -3e-4, 2e-4)]
)
def test_mass_properties_of_a_data_sheet(load: Load, inertia: tuple[float, ...] | None) -> None:
    """MuJoCo's and Pinocchio's tool have the centre of mass and the moments that the file has."""
    com = (0.01, 0.06, 0.055)
    keys = {"tool_mass": 1.2, "tool_com": com, "tool_inertia": inertia, "tool_length": 0.13}
    robot = load("ur5e", **CYLINDER, **keys)
    body = robot.model.body(robot.tip_body)
    np.testing.assert_allclose(body.ipos, np.array(com) - [0, 0, 0.13], atol=1e-15)
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, body.iquat)
    axes = axes.reshape(3, 3)
    moments = axes @ np.diag(body.inertia) @ axes.T
    if inertia is not None:
        xx, yy, zz, xy, xz, yz = (*inertia, 0, 0, 0)[:6]
        expected = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        np.testing.assert_allclose(moments, expected, atol=1e-12)
    # Pinocchio's last body is the last link with the tool on it.
    bare = load("ur5e", **CYLINDER, tool_mass=0.0, tool_length=0.13)
    last = robot.tip_joint
    tool = robot.pin.inertias[last] - bare.pin.inertias[last]
    own = robot.tip.actInv(tool)
    assert own.mass == pytest.approx(1.2)
    np.testing.assert_allclose(own.lever, body.ipos, atol=1e-12)
    np.testing.assert_allclose(own.inertia, moments, atol=1e-12)


def test_total_mass_is_the_arms_and_the_tools(load: Load) -> None:
    with_tool, without = load("ur5e", tool_mass=0.7), load("ur5e", tool_mass=0.0)
    assert with_tool.model.body_mass.sum() - without.model.body_mass.sum() == pytest.approx(0.7)


def test_tool_name_gives_way_to_a_body_of_that_name(load: Load, tmp_path: Any) -> None:
    text = """<mujoco><worldbody><body name="tool"><joint name="a" type="slide" axis="1 0 0"/>
      <geom size="0.1"/><body name="end" pos="0 0 1"><joint name="b" type="slide" axis="0 1 0"/>
      <geom size="0.1"/><body name="tip" pos="0 0 1"/></body></body></worldbody></mujoco>"""
    (tmp_path / "arm.xml").write_text(text)
    assert load("arm.xml", tmp_path).tip_body == "tool2"


@pytest.mark.parametrize(
    ("keys", "message", "field"),
    [
        ({"tool_shape": "box"}, "a box needs its size", "size"),
        ({"tool_radius": -0.01}, "the tool's radius is -0.01", "radius"),
        ({"tool_radius": 0.0}, "the tool's radius is 0", "radius"),
        ({"tool_length": float("nan")}, "the tool's length is nan", "length"),
        ({"tool_mass": -1.0}, "the tool's mass is -1", "mass"),
        ({"tool_shape": "box", "tool_size": (0.1, 0.0, 0.1)}, "the tool's size is 0", "size"),
        ({"tool_inertia": (1e-3, 1e-3, 3e-3)}, "no body has the principal moments", "inertia"),
        ({"tool_inertia": (-1e-3, 1e-3, 1e-3)}, "no body has the principal moments", "inertia"),
        ({"tool_inertia": (1e-3,) * 3 + (2e-3, 0, 0)}, "no body has the principal", "inertia"),
    ],
)
def test_impossible_tools(load: Load, keys: dict[str, Any], message: str, field: str) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        load("panda", **keys)
    assert caught.value.code == "TS407"
    assert caught.value.field == ("tool", field)
