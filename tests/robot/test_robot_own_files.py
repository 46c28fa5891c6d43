"""People's own MJCF and URDF files, as people have them."""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from taskspec.robot import RobotError, RobotModel

Load = Callable[..., RobotModel]


@pytest.fixture
def folder(tmp_path: Path, data: Path) -> Path:
    """A folder of its own with the test's robot files."""
    shutil.copytree(data, tmp_path / "task")
    return tmp_path / "task"


def noted(robot: RobotModel, text: str) -> bool:
    return any(text in note for note in robot.notes)


class TestUrdf:
    def test_joints_and_limits(self, load: Load) -> None:
        robot = load("own.urdf", flange="palm")
        assert robot.joint_names == ("pan", "lift", "elbow", "roll", "pitch", "turn")
        np.testing.assert_array_equal(robot.lower, [-2.9, -2.2, 0.2, -np.inf, -2, -3])
        np.testing.assert_array_equal(robot.upper, [2.9, 2.2, 2.6, np.inf, 2, 3])
        np.testing.assert_array_equal(robot.torque_limit, [90, 90, 60, 12, 12, 8])
        np.testing.assert_array_equal(robot.velocity_limit, [2.5, 2.5, 2.5, 3, 3, 3])
        np.testing.assert_array_equal(robot.model.actuator_ctrlrange[:, 1], robot.torque_limit)

    def test_zero_out_of_range_becomes_the_middle(self, load: Load) -> None:
        np.testing.assert_allclose(load("own.urdf", flange="palm").home, [0, 0, 1.4, 0, 0, 0])

    def test_fixed_links_stay(self, load: Load) -> None:
        robot = load("own.urdf", flange="palm")
        names = [robot.model.body(i).name for i in range(robot.model.nbody)]
        assert {"base_link", "mount", "palm"} <= set(names)

    def test_fingers_are_locked(self, load: Load) -> None:
        robot = load("own.urdf", flange="palm")
        assert noted(robot, "locked: left at 0.025, right at 0.025")
        m = robot.model
        np.testing.assert_allclose(m.body("left_finger").pos, [0, 0.025, 0.01], atol=1e-12)
        np.testing.assert_allclose(m.body("right_finger").pos, [0, -0.025, 0.01], atol=1e-12)
        assert m.body_subtreemass[m.body("palm").id] == pytest.approx(0.1 + 0.3)

    def test_inertias_are_those_of_the_file_alone(self, load: Load) -> None:
        m = load("own.urdf", flange="palm", tool_mass=0.0).model
        assert m.body("base_link").mass == 0
        assert m.body("mount").mass == 0
        assert m.body_mass.sum() == pytest.approx(3.5 + 4 + 2 + 0.8 + 0.6 + 0.7 + 0.1)

    def test_damping_and_friction_are_left_out_and_noted(self, load: Load) -> None:
        robot = load("own.urdf", flange="palm")
        assert noted(robot, "has none: joint damping, joint friction")
        assert not robot.model.dof_damping.any()
        assert not robot.model.dof_frictionloss.any()

    def test_absent_meshes_are_noted(self, load: Load) -> None:
        robot = load("own.urdf", flange="palm")
        assert noted(robot, "left out: absent.stl, tetra.stl")
        assert robot.model.nmesh == 0

    @pytest.mark.parametrize(
        "place",
        ["arm_description/meshes", "meshes", "../arm_description/meshes", "../../meshes"],
    )
    def test_package_meshes_are_found_around(
        self, load: Load, folder: Path, tetrahedron: bytes, place: str
    ) -> None:
        folder = folder / "deep" if place.startswith("../..") else folder
        folder.mkdir(exist_ok=True)
        shutil.copy(Path(__file__).parent / "data" / "own.urdf", folder)
        (folder / place).mkdir(parents=True)
        (folder / place / "tetra.stl").write_bytes(tetrahedron)
        robot = load("own.urdf", folder, flange="palm")
        assert robot.model.nmesh == 1
        assert noted(robot, "left out: absent.stl")
        assert robot.spec.copy().compile().nmesh == 1

    def test_broken_meshes_are_left_out(self, load: Load, folder: Path) -> None:
        (folder / "meshes").mkdir()
        (folder / "meshes" / "tetra.stl").write_bytes(b"no mesh at all")
        robot = load("own.urdf", folder, flange="palm")
        assert robot.model.nmesh == 0
        assert noted(robot, "meshes are left out")

    def test_a_link_shows_its_visual_or_else_its_collision_shape(self, load: Load) -> None:
        m = load("own.urdf", flange="palm").model
        assert m.body("shoulder").geomnum == 1
        assert m.body("upper").geomnum == 1
        assert m.geom(m.body("upper").geomadr[0]).type == mujoco.mjtGeom.mjGEOM_CYLINDER
        assert not m.geom_contype.any()
        assert set(m.geom_group) == {1}

    def test_without_a_flange_the_candidates_are_listed(self, load: Load) -> None:
        with pytest.raises(RobotError, match="ends in 2 places") as caught:
            load("own.urdf")
        assert caught.value.code == "TS406"
        assert caught.value.hint.endswith("flange: palm, left_finger, right_finger")

    def test_usual_flange_names_need_not_be_said(self, load: Load, folder: Path) -> None:
        text = (folder / "own.urdf").read_text()
        (folder / "own.urdf").write_text(re.sub(r'"(left|right)"', r'"x_\1"', text))
        names = ("flange", "tool0")
        for name in names:
            changed = re.sub(r'(<link name="(left|right)_finger">)', r"\1", text)
            changed = re.sub(r'<joint name="(left|right)" type="prismatic">',
                             r'<joint name="\1" type="fixed">', changed)  # fmt: skip
            (folder / "own.urdf").write_text(changed.replace("palm", name))
            robot = load("own.urdf", folder)
            assert robot.model.body(robot.model.body(robot.tip_body).parentid[0]).name == name

    def test_a_joint_that_mimics_cannot_be_in_the_arm(self, load: Load) -> None:
        with pytest.raises(RobotError, match="'right' mimics another joint"):
            load("own.urdf", flange="right_finger")

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
            ("<gazebo reference", '<x:arm xmlns:x="http://wiki.ros.org/xacro"/><gazebo reference',
             "TS402", "not expanded yet"),
            ("</robot>", "", "TS402", "not well-formed XML: line"),
            ("robot", "arm", "TS402", "it begins with <arm>"),
        ],
    )  # fmt: skip
    def test_spoiled(
        self, load: Load, folder: Path, old: str, new: str, code: str, message: str
    ) -> None:
        path = folder / "own.urdf"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        with pytest.raises(RobotError, match=message) as caught:
            load("own.urdf", folder, flange="palm")
        assert caught.value.code == code

    def test_inertias_that_no_body_has_are_mended_and_noted(self, load: Load, folder: Path) -> None:
        path = folder / "own.urdf"
        text = path.read_text()
        path.write_text(
            text.replace('iyy="0.06" iyz="0" izz="0.06"', 'iyy="0.06" iyz="0.5" izz="0.06"')
        )
        robot = load("own.urdf", folder, flange="palm")
        assert noted(robot, "inertia of 'upper' is not positive")
        path.write_text(
            text.replace(
                'ixx="0.01" ixy="0" ixz="0" iyy="0.06"', 'ixx="0.3" ixy="0" ixz="0" iyy="0.06"'
            )
        )
        assert noted(load("own.urdf", folder, flange="palm"), "replaced by their mean")

    def test_a_joint_that_moves_no_mass(self, load: Load, folder: Path) -> None:
        path = folder / "own.urdf"
        text = re.sub(r"<inertial>.*?</inertial>", "", path.read_text(), flags=re.DOTALL)
        path.write_text(text)
        with pytest.raises(RobotError, match="moves nothing that has a mass") as caught:
            load("own.urdf", folder, flange="palm", tool_mass=0.0)
        assert caught.value.code == "TS405"

    def test_zero_effort_and_velocity_mean_not_given(self, load: Load, folder: Path) -> None:
        path = folder / "own.urdf"
        path.write_text(
            path.read_text().replace('effort="60" velocity="2.5"', 'effort="0" velocity="0"')
        )
        robot = load("own.urdf", folder, flange="palm")
        assert robot.torque_limit[2] == robot.velocity_limit[2] == np.inf
        assert not robot.model.actuator_ctrllimited[2]


class TestMjcf:
    def test_home_keyframe_defaults_and_includes(self, load: Load) -> None:
        robot = load("own.xml", flange="grip")
        assert robot.joint_names == ("rail", "j1", "j2", "j3", "j3b", "j5", "j6", "j7")
        np.testing.assert_allclose(robot.home, [0.1, 0.2, 0.5, 1.1, 0.1, 0.3, 0.4, 0.1])
        np.testing.assert_allclose(robot.model.dof_armature, 0.07)
        np.testing.assert_allclose(robot.pin.armature, 0.07)
        np.testing.assert_allclose(robot.lower[[0, 1, 2]], [-0.3, *np.radians([-170, -100])])

    def test_servos_become_motors_within_their_forces(self, load: Load) -> None:
        robot = load("own.xml", flange="grip")
        limits = [200, 87, 2 * 87, 40, np.inf, 12, 12, np.inf]
        np.testing.assert_array_equal(robot.torque_limit, limits)
        m = robot.model
        assert (m.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE).all()
        np.testing.assert_array_equal(m.actuator_gear[:, 0], 1)
        np.testing.assert_array_equal(m.actuator_ctrllimited, np.isfinite(limits))

    def test_velocity_limits_are_read_from_the_custom_section(self, load: Load) -> None:
        robot = load("own.xml", flange="grip")
        np.testing.assert_array_equal(robot.velocity_limit, [0.5, 2, 2, 2, 2, 3, 3, 3])

    def test_velocity_limits_are_counted(self, load: Load, folder: Path) -> None:
        path = folder / "own.xml"
        path.write_text(path.read_text().replace('data="0.5 2 ', 'data="0.5 '))
        with pytest.raises(RobotError, match="velocity_limit has 9 values, the file has 10"):
            load("own.xml", folder, flange="grip")

    def test_what_is_left_out_is_noted(self, load: Load) -> None:
        robot = load("own.xml", flange="grip")
        for text in (
            "left out: absent.obj, absent_too.stl",
            "locked: left at 0.02, right at 0.03",
            "has none: joint damping, joint friction, joint springs, gravity compensation",
            "the file's gravity is not used",
            "the world is the task file's: obstacle, shapes that stand still",
        ):
            assert noted(robot, text), text

    def test_nothing_of_the_files_world_is_left(self, load: Load) -> None:
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

    def test_frames_and_sites_carry_the_tool(self, load: Load) -> None:
        frame = load("own.xml", flange="tool_frame", tool_length=0.0)
        site = load("own.xml", flange="grip", tool_length=0.0)
        body = load("own.xml", flange="six", tool_length=0.0)
        between = body.tip.actInv(frame.tip)
        np.testing.assert_allclose(between.translation, [0, 0, 0.05], atol=1e-12)
        np.testing.assert_allclose(between.rotation[:2, 0], [np.cos(np.pi / 6), 0.5], atol=1e-12)
        np.testing.assert_allclose(frame.tip.actInv(site.tip).translation, [0, 0, 0.02], atol=1e-12)

    def test_meshes_that_are_there_stay(self, load: Load, folder: Path, tetrahedron: bytes) -> None:
        (folder / "meshes").mkdir()
        (folder / "meshes" / "absent_too.stl").write_bytes(tetrahedron)
        robot = load("own.xml", folder, flange="grip")
        assert robot.model.nmesh == 1
        assert noted(robot, "left out: absent.obj")
        mesh = robot.model.mesh_vert + robot.model.mesh_pos[0] * 0
        assert np.ptp(mesh, axis=0).max() < 0.1

    def test_misspelt_flange(self, load: Load) -> None:
        with pytest.raises(RobotError, match="no body, site or frame 'gripp'") as caught:
            load("own.xml", flange="gripp")
        assert (caught.value.hint, caught.value.field) == ("did you mean 'grip'?", ("flange",))

    def test_flange_that_nothing_moves(self, load: Load) -> None:
        with pytest.raises(RobotError, match="no joint moves 'obstacle'"):
            load("own.xml", flange="obstacle")

    def test_usual_site_name_need_not_be_said(self, load: Load, folder: Path) -> None:
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
        np.testing.assert_allclose(
            site.tip.translation, load("own.xml", flange="grip").tip.translation
        )

    @pytest.mark.parametrize(
        ("old", "new", "code", "message"),
        [
            ('file="defaults.xml"', 'file="../outside.xml"', "TS403", "from outside its own"),
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
    def test_spoiled(
        self, load: Load, folder: Path, old: str, new: str, code: str, message: str
    ) -> None:
        (folder.parent / "outside.xml").write_text("<mujoco/>")
        path = folder / "own.xml"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        with pytest.raises(RobotError, match=message) as caught:
            load("own.xml", folder, flange="grip")
        assert caught.value.code == code

    def test_lines_are_told_where_nothing_is_included(self, load: Load, tmp_path: Path) -> None:
        (tmp_path / "arm.xml").write_text("<mujoco>\n<worldbody>\n<bodi/>\n</worldbody>\n</mujoco>")
        with pytest.raises(RobotError, match="unrecognized element, Element 'bodi', line 3"):
            load("arm.xml", tmp_path)

    def test_free_base(self, load: Load, tmp_path: Path) -> None:
        (tmp_path / "arm.xml").write_text(
            "<mujoco><worldbody><body name='a'><freejoint/><geom size='1'/><body name='b'>"
            "<joint name='j'/><geom size='1'/></body></body></worldbody></mujoco>"
        )
        with pytest.raises(RobotError, match="is a free joint") as caught:
            load("arm.xml", tmp_path)
        assert "remove the free joint" in caught.value.hint


class TestFiles:
    def test_paths_are_relative_to_the_task_file(self, load: Load, folder: Path) -> None:
        (folder / "robots").mkdir()
        shutil.copy(folder / "own.urdf", folder / "robots" / "arm.urdf")
        robot = load("robots/arm.urdf", folder, flange="palm")
        assert (robot.name, robot.source) == ("arm", "robots/arm.urdf")

    def test_absent(self, load: Load, tmp_path: Path) -> None:
        with pytest.raises(RobotError, match=r"no file 'arm\.urdf'") as caught:
            load("arm.urdf", tmp_path)
        assert caught.value.code == "TS401"

    @pytest.mark.parametrize("name", ["arm.txt", "arm.mjb", "arm.urdf.xacro", "robots/arm"])
    def test_other_endings(self, load: Load, tmp_path: Path, name: str) -> None:
        with pytest.raises(RobotError, match="neither MJCF nor URDF by its ending") as caught:
            load(name, tmp_path)
        assert caught.value.code == "TS402"
        assert ("xacro arm" in caught.value.hint) == name.endswith("xacro")

    def test_not_a_regular_file(self, load: Load, tmp_path: Path) -> None:
        (tmp_path / "arm.xml").mkdir()
        with pytest.raises(RobotError, match="not a regular file"):
            load("arm.xml", tmp_path)

    def test_a_pipe_does_not_hang(self, load: Load, tmp_path: Path) -> None:
        import os

        os.mkfifo(tmp_path / "arm.xml")
        os.mkfifo(tmp_path / "part.xml")
        with pytest.raises(RobotError, match="not a regular file"):
            load("arm.xml", tmp_path)
        (tmp_path / "other.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
        with pytest.raises(RobotError, match="not there"):
            load("other.xml", tmp_path)

    def test_too_large(self, load: Load, tmp_path: Path) -> None:
        (tmp_path / "arm.xml").write_bytes(b" " * (8 * 2**20 + 1))
        with pytest.raises(RobotError, match=r"8\.0 MiB, more than 8 MiB"):
            load("arm.xml", tmp_path)

    def test_too_deep(self, load: Load, tmp_path: Path) -> None:
        (tmp_path / "arm.xml").write_text(
            "<mujoco>" + "<body>" * 5000 + "</body>" * 5000 + "</mujoco>"
        )
        with pytest.raises(RobotError, match="nested deeper"):
            load("arm.xml", tmp_path)

    def test_not_text(self, load: Load, tmp_path: Path) -> None:
        (tmp_path / "arm.xml").write_bytes(b"<mujoco>\xff</mujoco>")
        with pytest.raises(RobotError, match=r"not UTF-8 text \(byte 8\)"):
            load("arm.xml", tmp_path)

    def test_links_do_not_lead_out(self, load: Load, folder: Path) -> None:
        secret = folder.parent / "secret.xml"
        secret.write_text("<mujoco/>")
        (folder / "defaults.xml").unlink()
        (folder / "defaults.xml").symlink_to(secret)
        with pytest.raises(RobotError, match="from outside its own"):
            load("own.xml", folder, flange="grip")

    def test_spoiled_at_random(
        self, load: Load, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Whatever a file says, it is a robot or a `RobotError`, and nothing is left behind."""
        monkeypatch.chdir(folder)
        before = sorted(folder.rglob("*"))
        texts = {"own.urdf": "palm", "own.xml": "grip"}
        words = ("nan", "inf", "-1", "0", "1e300", "", "a b", "../x", "1 2 3", "true")
        rng = random.Random(7)
        codes = set()
        for _ in range(200):
            name, flange = rng.choice(sorted(texts.items()))
            original = (folder / name).read_text()
            values = list(re.finditer(r'"[^"]*"', original))
            one, two = rng.choice(values), rng.choice(values)
            word = rng.choice((two.group(), f'"{rng.choice(words)}"'))
            (folder / name).write_text(original[: one.start()] + word + original[one.end() :])
            try:
                robot = load(name, folder, flange=flange)
                assert np.isfinite(robot.home).all()
            except RobotError as error:
                codes.add(error.code)
            (folder / name).write_text(original)
        assert {"TS404", "TS405"} <= codes
        assert sorted(folder.rglob("*")) == before


class TestOtherArms:
    """Arms with fewer joints than a tip has directions."""

    def arm(self, joints: str) -> str:
        bodies = joints.split()
        text = "".join(
            f'<body pos="0.2 0 0.1"><joint {kind}/><geom type="capsule" size="0.03" '
            'fromto="0 0 0 0.2 0 0"/>'
            for kind in (
                {
                    "X": 'type="slide" axis="1 0 0"', "Y": 'type="slide" axis="0 1 0"',
                    "Z": 'type="slide" axis="0 0 1"', "rx": 'axis="1 0 0"', "ry": 'axis="0 1 0"',
                    "rz": 'axis="0 0 1"',
                }[name] for name in bodies
            )
        )  # fmt: skip
        return f"<mujoco><worldbody>{text}{'</body>' * len(bodies)}</worldbody></mujoco>"

    @pytest.mark.parametrize(
        ("joints", "axes"),
        [
            ("X Y Z", "x y z"),
            ("X Y", "x y"),
            ("rz rz Z rz", "x y z rz"),
            ("rz rz rz", "x y rz"),
            ("X rz", "x y"),
            ("rz ry ry", "x y z"),
            ("rz ry ry rx ry", "x y z"),
            ("X rz ry ry rx ry rx", "x y z rx ry rz"),
        ],
    )
    def test_axes(self, load: Load, tmp_path: Path, joints: str, axes: str) -> None:
        (tmp_path / "arm.xml").write_text(self.arm(joints))
        robot = load("arm.xml", tmp_path, tool_length=0.15)
        assert robot.axes == tuple(axes.split())
        assert len(set(robot.joint_names)) == len(joints.split())

    def test_orientations_that_follow_are_noted(self, load: Load, tmp_path: Path) -> None:
        (tmp_path / "arm.xml").write_text(self.arm("rz ry ry rx ry"))
        assert noted(load("arm.xml", tmp_path), "only x, y, z of the tool tip can be controlled")

    def test_names_that_the_file_lacks(self, load: Load, tmp_path: Path) -> None:
        text = self.arm("X Y Z").replace("<joint ", '<joint name="joint1" ', 1)
        text = text.replace("<body ", '<body name="body2" ', 1)
        (tmp_path / "arm.xml").write_text(text)
        robot = load("arm.xml", tmp_path)
        assert robot.joint_names == ("joint1", "joint2", "joint3")
        bodies = [robot.model.body(i).name for i in range(robot.model.nbody)]
        assert bodies == ["world", "body2", "body1", "body3", "tool"]
