"""People's own MJCF files, as people have them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from taskspec.robot import RobotError, RobotModel

Load = Callable[..., RobotModel]


def noted(robot: RobotModel, text: str) -> bool:
    return any(text in note for note in robot.notes)


def test_home_keyframe_defaults_and_includes(load: Load) -> None:
    robot = load("own.xml", flange="grip")
    assert robot.joint_names == ("rail", "j1", "j2", "j3", "j3b", "j5", "j6", "j7")
    np.testing.assert_allclose(robot.home, [0.1, 0.2, 0.5, 1.1, 0.1, 0.3, 0.4, 0.1])
    np.testing.assert_allclose(robot.model.dof_armature, 0.07)
    np.testing.assert_allclose(robot.pin.armature, 0.07)
    np.testing.assert_allclose(robot.lower[[0, 1, 2]], [-0.3, *np.radians([-170, -100])])


def test_servos_become_motors_within_their_forces(load: Load) -> None:
    robot = load("own.xml", flange="grip")
    limits = [200, 87, 2 * 87, 40, np.inf, 12, 12, np.inf]
    np.testing.assert_array_equal(robot.torque_limit, limits)
    m = robot.model
    assert (m.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE).all()
    np.testing.assert_array_equal(m.actuator_gear[:, 0], 1)
    np.testing.assert_array_equal(m.actuator_ctrllimited, np.isfinite(limits))


def test_velocity_limits_are_read_from_the_custom_section(load: Load) -> None:
    robot = load("own.xml", flange="grip")
    np.testing.assert_array_equal(robot.velocity_limit, [0.5, 2, 2, 2, 2, 3, 3, 3])


def test_velocity_limits_are_counted(load: Load, folder: Path) -> None:
    path = folder / "own.xml"
    path.write_text(path.read_text().replace('data="0.5 2 ', 'data="0.5 '))
    with pytest.raises(RobotError, match="velocity_limit has 9 values, the file has 10"):
        load("own.xml", folder, flange="grip")


def test_what_is_left_out_is_noted(load: Load) -> None:
    robot = load("own.xml", flange="grip")
    for text in (
        "left out: absent.obj, absent_too.stl",
        "locked: left at 0.02, right at 0.03",
        "has none: joint damping, joint friction, joint springs, gravity compensation",
        "the file's gravity is not used",
        "the world is the task file's: obstacle, shapes that stand still",
    ):
        assert noted(robot, text), text


def test_nothing_of_the_files_world_is_left(load: Load) -> None:
    m = load("own.xml", flange="grip").model
    names = [m.geom(i).name for i in range(m.ngeom)] + [m.body(i).name for i in range(m.nbody)]
    assert not {"floor", "obstacle"}.intersection(names)
    counts = (
        m.nlight,
        m.ncam,
        m.nsensor,
        m.ntendon,
        m.neq,
        m.nkey,
        m.nexclude,
        m.ntex,
        m.nsite,
    )
    assert counts == (0,) * 9
    np.testing.assert_array_equal(m.opt.gravity, [0, 0, -9.81])


def test_frames_and_sites_carry_the_tool(load: Load) -> None:
    frame = load("own.xml", flange="tool_frame", tool_length=0.0)
    site = load("own.xml", flange="grip", tool_length=0.0)
    body = load("own.xml", flange="six", tool_length=0.0)
    between = body.tip.actInv(frame.tip)
    np.testing.assert_allclose(between.translation, [0, 0, 0.05], atol=1e-12)
    np.testing.assert_allclose(between.rotation[:2, 0], [np.cos(np.pi / 6), 0.5], atol=1e-12)
    np.testing.assert_allclose(frame.tip.actInv(site.tip).translation, [0, 0, 0.02], atol=1e-12)


def test_meshes_that_are_there_stay(load: Load, folder: Path, tetrahedron: bytes) -> None:
    (folder / "meshes").mkdir()
    (folder / "meshes" / "absent_too.stl").write_bytes(tetrahedron)
    robot = load("own.xml", folder, flange="grip")
    assert robot.model.nmesh == 1
    assert noted(robot, "left out: absent.obj")
    mesh = robot.model.mesh_vert + robot.model.mesh_pos[0] * 0
    assert np.ptp(mesh, axis=0).max() < 0.1


def test_misspelt_flange(load: Load) -> None:
    with pytest.raises(RobotError, match="no body, site or frame 'gripp'") as caught:
        load("own.xml", flange="gripp")
    assert (caught.value.hint, caught.value.field) == ("did you mean 'grip'?", ("flange",))


def test_flange_that_nothing_moves(load: Load) -> None:
    with pytest.raises(RobotError, match="no joint moves 'obstacle'"):
        load("own.xml", flange="obstacle")


def test_usual_site_name_need_not_be_said(load: Load, folder: Path) -> None:
    path = folder / "own.xml"
    text = path.read_text()
    tail = '<joint name="{}" type="slide" axis="0 {} 0" range="0 0.04"/>'
    for name, sign in (("left", "1"), ("right", "-1")):
        text = text.replace(tail.format(name, sign), "")
    text = re.sub(r"<tendon>.*</sensor>", "", text, flags=re.DOTALL)
    text = text.replace('"0 0 0 0 0 0 0 0 0 0"', '"0 0 0 0 0 0 0 0"').replace(" 0.02 0.03", "")
    path.write_text(text.replace('"grip"', '"attachment_site"').replace(" 0.2 0.2", ""))
    parts = folder / "parts" / "actuators.xml"
    parts.write_text(
        parts.read_text().replace(
            '<general name="split" tendon="split" forcerange="-100 100"/>', ""
        )
    )
    site = load("own.xml", folder)
    np.testing.assert_allclose(site.tip.translation, load("own.xml", flange="grip").tip.translation)


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        ('file="defaults.xml"', 'file="../outside.xml"', "TS403", "from outside of the task"),
        ('file="defaults.xml"', 'file="gone.xml"', "TS402", "'gone.xml', which is not there"),
        ('file="defaults.xml"', 'file="own.xml"', "TS403", "included twice"),
        ('file="defaults.xml"', 'file="parts"', "TS402", "'parts', which is not there"),
        ("<tendon>", "<extension><plugin plugin='x'/></extension><tendon>", "TS403", "<ext"),
        ("<tendon>", "<asset><model name='m' file='m'/></asset><tendon>", "TS403", "<model>"),
        ("<camera ", '<replicate count="9999"><geom size="1"/></replicate><camera ', "TS403",
         "replicates more than"),
        ('size="0.1"', 'size="nan"', "TS405", "has a NaN: size of <geom>"),
        ('name="rail" type="slide"', 'name="rail" type="ball"', "TS404", "cannot compile"),
        ('class="shown" mesh="absent"', 'class="hidden"', "TS404", "unknown default class"),
    ],
)  # fmt: skip
def test_spoiled(load: Load, folder: Path, old: str, new: str, code: str, message: str) -> None:
    (folder.parent / "outside.xml").write_text("<mujoco/>")
    path = folder / "own.xml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(RobotError, match=message) as caught:
        load("own.xml", folder, flange="grip")
    assert caught.value.code == code


def test_lines_are_told_where_nothing_is_included(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text("<mujoco>\n<worldbody>\n<bodi/>\n</worldbody>\n</mujoco>")
    with pytest.raises(RobotError, match="unrecognized element, Element 'bodi', line 3"):
        load("arm.xml", tmp_path)


def test_free_base(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(
        "<mujoco><worldbody><body name='a'><freejoint/><geom size='1'/><body name='b'>"
        "<joint name='j'/><geom size='1'/></body></body></worldbody></mujoco>"
    )
    with pytest.raises(RobotError, match="is a free joint") as caught:
        load("arm.xml", tmp_path)
    assert "remove the free joint" in caught.value.hint
