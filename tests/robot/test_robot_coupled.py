"""Joints that follow others, as files of palletizers and of driven linkages have them.

MuJoCo holds every case: its own inertia, bias and Jacobian of all joints, at q = A x + b with an A
and a b that are written here by hand, are what the robot's model has in its coordinates.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.robot import RobotError, RobotModel
from taskspec.robot.model_terms import PinocchioTerms

Load = Callable[..., RobotModel]

TOLERANCE = 1e-9


def tied(*joints: str) -> str:
    return f"<equality>{''.join(f'<joint {each}/>' for each in joints)}</equality>"


LEVEL = tied("joint1='j3' joint2='j2' polycoef='0 -1 0 0 0'")
#: A tendon of j2 and j3.
BOTH = "<joint joint='j2' coef='1'/><joint joint='j3' coef='1'/></fixed></tendon>"
#: The pitch of a wrist that linkages hold level: three joints, of which one follows both others.
WRIST = """
<tendon><fixed name='level'><joint joint='j2' coef='1'/><joint joint='j3' coef='1'/>
<joint joint='j5' coef='1'/></fixed></tendon>
<equality><tendon name='held' tendon1='level' polycoef='1.2 0 0 0 0'/></equality>
"""
TWO_TENDONS = """
<tendon><fixed name='one'><joint joint='j2' coef='2'/></fixed>
<fixed name='two'><joint joint='j3' coef='1'/></fixed></tendon>
<equality><tendon tendon1='two' tendon2='one' polycoef='0.1 0.25 0 0 0'/></equality>
"""
CHAINED = """
<equality><joint joint1='j3' joint2='j2' polycoef='0.2 -1 0 0 0'/>
<joint joint1='j5' joint2='j3' polycoef='0 -0.5 0 0 0'/></equality>
"""
LOCKED = "<equality><joint joint1='j4' polycoef='0.3 0 0 0 0'/></equality>"


def six(folder: Path, also: str = "", *edits: tuple[str, str]) -> str:
    """An MJCF arm of six joints with more at its end."""
    text = (folder / "six.xml").read_text().replace("</mujoco>", f"{also}</mujoco>")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    (folder / "arm.xml").write_text(text)
    return "arm.xml"


def rows(*rows: list[float]) -> np.ndarray:
    return np.array(rows, dtype=float)


def unit(n: int, *at: int) -> list[list[float]]:
    return [[float(i == k) for i in range(n)] for k in at]


#: Name: (what is added, free joints, A, b).
CASES = {
    "joint": (
        LEVEL,
        "j1 j2 j4 j5 j6",
        rows(*unit(5, 0, 1), [0, -1, 0, 0, 0], *unit(5, 2, 3, 4)),
        0,
    ),
    "tendon of three": (
        WRIST,
        "j1 j2 j3 j4 j6",
        rows(*unit(5, 0, 1, 2, 3), [0, -1, -1, 0, 0], *unit(5, 4)),
        [0, 0, 0, 0, 1.2, 0],
    ),
    "two tendons": (
        TWO_TENDONS,
        "j1 j2 j4 j5 j6",
        rows(*unit(5, 0, 1), [0, 0.5, 0, 0, 0], *unit(5, 2, 3, 4)),
        [0, 0, 0.1, 0, 0, 0],
    ),
    "one after the other": (
        CHAINED,
        "j1 j2 j4 j6",
        rows(*unit(4, 0, 1), [0, -1, 0, 0], *unit(4, 2), [0, 0.5, 0, 0], *unit(4, 3)),
        [0, 0, 0.2, 0, -0.1, 0],
    ),
    "locked": (
        LOCKED,
        "j1 j2 j3 j5 j6",
        rows(*unit(5, 0, 1, 2), [0] * 5, *unit(5, 3, 4)),
        [0, 0, 0, 0.3, 0, 0],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_coordinates_are_those_that_the_file_leaves(load: Load, folder: Path, name: str) -> None:
    also, free, A, b = CASES[name]
    robot = load(six(folder, also), folder)
    assert robot.joint_names == tuple(free.split())
    np.testing.assert_allclose(robot.coupling.ratios, A, atol=1e-12)
    np.testing.assert_allclose(robot.coupling.offsets, np.broadcast_to(b, 6), atol=1e-12)
    assert robot.n == A.shape[1] == len(robot.home) == len(robot.torque_limit)


@pytest.mark.parametrize("name", CASES)
def test_the_model_is_that_of_mujocos_joints(load: Load, folder: Path, name: str) -> None:
    """H, C q' + g, g, J and J' q' of the coordinates are MuJoCo's of all joints, mapped by hand."""
    also, _, A, b = CASES[name]
    robot = load(six(folder, also, ("<joint name=", "<joint armature='0.2' name=")), folder)
    m = robot.model
    d, rng = mujoco.MjData(m), np.random.default_rng(3)
    tip, n = m.body(robot.tip_body).id, robot.n
    for _ in range(20):
        x, v = rng.uniform(-1, 1, n), rng.normal(size=n)
        d.qpos[:], d.qvel[:] = A @ x + b, A @ v
        mujoco.mj_forward(m, d)
        H, J, drift = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
        mujoco.mj_fullM(m, d, H)
        mujoco.mj_jac(m, d, J[:3], J[3:], d.xpos[tip], tip)
        mujoco.mj_jacDot(m, d, drift[:3], drift[3:], d.xpos[tip], tip)
        for terms in (PinocchioTerms(robot), CompiledTerms(robot)):
            terms.at(x, v)
            np.testing.assert_allclose(terms.inertia, A.T @ H @ A, atol=TOLERANCE)
            np.testing.assert_allclose(terms.bias, A.T @ d.qfrc_bias, atol=TOLERANCE)
            np.testing.assert_allclose(terms.jacobian, J @ A, atol=TOLERANCE)
            np.testing.assert_allclose(terms.position, d.xpos[tip], atol=TOLERANCE)
            np.testing.assert_allclose(terms.arrays[6], drift @ A @ v, atol=1e-7)
        twin = robot.twin()
        np.testing.assert_allclose(twin.inertia(x), A.T @ H @ A, atol=TOLERANCE)
        np.testing.assert_allclose(twin.jacobian(x), J @ A, atol=TOLERANCE)
        np.testing.assert_allclose(twin.resolved_jacobian(x), J @ A, atol=TOLERANCE)
        np.testing.assert_allclose(twin.torque(x, v, 0 * v), A.T @ d.qfrc_bias, atol=TOLERANCE)
        d.qvel[:] = 0
        mujoco.mj_forward(m, d)
        np.testing.assert_allclose(twin.gravity(x), A.T @ d.qfrc_bias, atol=TOLERANCE)


def test_a_joint_may_slide_as_another_turns(load: Load, folder: Path) -> None:
    """A rack: 20 mm of travel for each radian of j3, counted from MuJoCo's `ref`."""
    slide = (
        '<joint name="j5" axis="0 1 0" range="-2.2 2.2"',
        '<joint name="j5" type="slide" ref="0.1" axis="0 1 0" range="-1 1"',
    )
    rack = "<equality><joint joint1='j5' joint2='j3' polycoef='0 0.02 0 0 0'/></equality>"
    robot = load(six(folder, rack, slide, ("1.3 0", "0.1 0")), folder)
    assert robot.coupling.relation(4) == "j5 = 0.02 * j3 + 0.1"
    assert not robot.coupling.turns[2]
    assert robot.coupling.turns[[0, 1, 3, 4]].all()


def test_limits_are_those_of_all_joints_that_follow(load: Load, folder: Path) -> None:
    """j3 = 0.5 - 2 j2 in -2.6 .. 2.6 at 2 rad/s leaves j2 -1.05 .. 1.55 at 1 rad/s."""
    text = (
        (folder / "six.urdf")
        .read_text()
        .replace(
            'velocity="2" effort="100"/>',
            'velocity="2" effort="100"/><mimic joint="j2" multiplier="-2" offset="0.5"/>',
        )
    )
    (folder / "arm.urdf").write_text(text)
    robot = load("arm.urdf", folder, flange="tool0")
    np.testing.assert_allclose((robot.lower[1], robot.upper[1]), (-1.05, 1.55))
    assert robot.velocity_limit[1] == 1.0
    # A joint that mimics has no motor, whatever effort its file gives: the format requires one.
    assert robot.torque_limit[1] == 150.0


@pytest.mark.parametrize(
    ("motors", "most"),
    [("j2 j3", 150 + 2 * 100), ("j2", 150), ("", 150)],
)
def test_torques_of_all_motors_of_a_coordinate_add_up(
    load: Load, folder: Path, motors: str, most: float
) -> None:
    """By virtual work a motor at j3 = -2 j2 brings j2 twice its torque."""
    twice = LEVEL.replace("-1", "-2")
    gone = [(f'<motor name="m{j[1]}" joint="{j}"/>', "") for j in ("j2", "j3") if j not in motors]
    robot = load(six(folder, twice, *gone), folder)
    assert robot.torque_limit[1] == most
    assert robot.model.actuator_ctrlrange[1].tolist() == [-most, most]


def test_who_has_the_motor_is_followed(load: Load, folder: Path) -> None:
    driven = six(folder, LEVEL, ('<motor name="m2" joint="j2"/>', ""))
    robot = load(driven, folder)
    assert robot.joint_names == ("j1", "j3", "j4", "j5", "j6")
    assert robot.torque_limit[1] == 100


def test_home_is_where_the_coupling_allows_it(load: Load, folder: Path) -> None:
    """The file's keyframe has j3 at 1.4, where j3 = -j2 does not: that is said."""
    robot = load(six(folder, LEVEL), folder)
    np.testing.assert_allclose(robot.coupling.joints(robot.home), [0, 0.4, -0.4, 0, 1.3, 0])
    (remark,) = (each for each in robot.remarks if each.code == "TS446")
    assert "the others follow: j3 = -j2; 'j3' is at -0.4 at home, not at 1.4" in remark.message
    assert "(arm.xml, line 41)" in remark.hint


def test_a_motor_and_a_range_of_what_follows_several_are_left_out_aloud(
    load: Load, folder: Path
) -> None:
    robot = load(six(folder, WRIST), folder)
    (remark,) = (each for each in robot.remarks if each.code == "TS447")
    assert "its range, -2.2 to 2.2 and its motor" in remark.message.replace(",  ", ", ")
    assert robot.torque_limit[1] == 150


def test_a_crank_that_drives_an_arms_joint(load: Load, folder: Path) -> None:
    """The crank is beside the chain, and its motor is what moves j3: at half its speed."""
    crank = (
        '<body name="l2" pos="0 0 0.2" >',
        '<body name="crank" pos="0 0.1 0.2"><joint name="jc" axis="0 1 0"'
        ' actuatorfrcrange="-30 30"/><inertial pos="0 0 0" mass="0.5"'
        ' diaginertia="0.001 0.001 0.001"/></body><body name="l2" pos="0 0 0.2" >',
    )
    motor = ('<motor name="m3" joint="j3"/>', '<motor name="m3" joint="jc"/>')
    driven = tied("joint1='j3' joint2='jc' polycoef='0 0.5 0 0 0'")
    robot = load(six(folder, driven, crank, motor), folder)
    assert robot.joint_names == ("j1", "j2", "j3", "j4", "j5", "j6")
    assert robot.torque_limit[2] == 60
    (remark,) = (each for each in robot.remarks if each.code == "TS447")
    assert "joint 'jc' follows j3, and does not move the flange: what follows is" in remark.message


CRANK = (
    '<body name="l2" pos="0 0 0.2" >',
    '<body name="crank" pos="0 0.1 0.2"><joint name="jc" axis="0 1 0"/><inertial pos="0 0 0"'
    ' mass="0.5" diaginertia="0.001 0.001 0.001"/></body><body name="l2" pos="0 0 0.2" >',
)
CURVED = "joint1='jc' joint2='j2' polycoef='0 1 0.2 0 0'"


def test_what_follows_beside_the_arm_by_a_curve_is_left_out_aloud(load: Load, folder: Path) -> None:
    robot = load(six(folder, tied(CURVED), CRANK), folder)
    assert robot.n == 6
    (remark,) = (each for each in robot.remarks if each.code == "TS447")
    assert 'is not linear, polycoef="0 1 0.2 0 0", and does not move the flange' in remark.message


@pytest.mark.parametrize(
    "also",
    [
        tied(CURVED, "joint1='j3' joint2='jc' polycoef='0 1 0 0 0'"),
        tied(CURVED, "joint1='jc' joint2='j3' polycoef='0 1 0.1 0 0'"),
        tied("joint1='jc' joint2='j3'")
        + "<equality><connect body1='crank' body2='world' anchor='0 0 0.1'/></equality>",
    ],
)
def test_a_curve_by_way_of_a_crank_is_a_curve(load: Load, folder: Path, also: str) -> None:
    """The crank does not move the flange, but j2 and j3 are tied to each other through it."""
    with pytest.raises(RobotError, match=r"is not linear|closes a loop") as caught:
        load(six(folder, also, CRANK), folder)
    assert caught.value.code == "TS405"


def test_a_joint_without_a_motor_among_others_is_named(load: Load, folder: Path) -> None:
    gone = ('<motor name="m3" joint="j3"/>', "")
    (remark,) = (each for each in load(six(folder, "", gone), folder).remarks)
    assert (remark.code, "joint 'j3' has no motor in the file" in remark.message) == ("TS447", True)
    text = re.sub("<actuator>.*</actuator>", "", (folder / "six.xml").read_text(), flags=re.DOTALL)
    (folder / "arm.xml").write_text(text)
    assert not load("arm.xml", folder).remarks


FINGERS = (
    '<site name="attachment_site" pos="0 0 0.06"/>',
    '<site name="attachment_site" pos="0 0 0.06"/>'
    + "".join(
        f'<body name="{side}"><joint name="{side}_finger" type="slide"/><inertial pos="0 0 0.1" '
        f'mass="0.1" diaginertia="1e-4 1e-4 1e-4"/></body>'
        for side in ("left", "right")
    ),
)


@pytest.mark.parametrize(
    "also",
    [
        tied("joint1='left_finger' joint2='right_finger' polycoef='0 1 0.3 0 0'"),
        "<equality><connect body1='left' body2='right' anchor='0 0 0'/></equality>",
        tied("joint1='j3' joint2='j2' active='false'"),
        "<equality><weld body1='l6' body2='world' active='false'/></equality>",
        "<tendon><fixed name='t'><joint joint='left_finger' coef='1'/></fixed></tendon>"
        "<equality><tendon tendon1='t' polycoef='0.01 0 0 0 0'/></equality>",
    ],
)
def test_what_does_not_move_the_flange_or_is_switched_off_stays_unsaid(
    load: Load, folder: Path, also: str
) -> None:
    robot = load(six(folder, also, FINGERS), folder)
    assert robot.n == 6
    assert not {"TS446", "TS447"} & {remark.code for remark in robot.remarks}


LOOP = "<connect name='rod' body1='l2' body2='l4' anchor='0 0 0.1'/>"
ROPE = """
<tendon><spatial name='t'><site site='low'/><site site='attachment_site'/></spatial></tendon>
<equality><tendon name='rope' tendon1='t'/></equality>
"""


@pytest.mark.parametrize(
    ("also", "message"),
    [
        (f"<equality>{LOOP}</equality>",
         r"<connect> 'rod' \(arm.xml, line 41\) closes a loop, and joints 'j3', 'j4' move"),
        ("<equality><weld body1='l6'/></equality>", r"<weld> of 'l6' and 'world' .*closes a loop"),
        ("<equality><connect site1='attachment_site' site2='low'/></equality>", "closes a loop"),
        (tied("joint1='j3' joint2='j2' polycoef='0 -1 0.2 0 0'"),
         r'is not linear, polycoef="0 -1 0.2 0 0", and joints .j2., .j3. move the flange'),
        (ROPE, "<tendon> 'rope' .* spatial tendon"),
        (LEVEL + tied("joint1='j3' joint2='j2' polycoef='0.5 -1 0 0 0'"),
         "contradicts the constraints before it"),
        (tied(*(f"joint1='j{i}'" for i in range(1, 7))), "leave no joint of the arm free"),
        (tied("joint1='j3' polycoef='3 0 0 0 0'"), "range of joint 'j3', -2.6 to 2.6"),
    ],
)  # fmt: skip
def test_what_cannot_be_mapped_is_refused_by_name_and_line(
    load: Load, folder: Path, also: str, message: str
) -> None:
    low = ('<body name="l2" pos="0 0 0.2" >', '<site name="low"/><body name="l2" pos="0 0 0.2" >')
    with pytest.raises(RobotError, match=message) as caught:
        load(six(folder, also, low), folder)
    assert caught.value.code == "TS405"
    assert caught.value.hint


@pytest.mark.parametrize("followed", ["j9", "tool"])
def test_a_joint_cannot_follow_what_is_no_joint(load: Load, folder: Path, followed: str) -> None:
    """MuJoCo passes over such a `<mimic>`; fingers that have one are locked as all are."""
    text = (folder / "six.urdf").read_text()
    mimic = f'effort="20"/><mimic joint="{followed}"/>'
    (folder / "arm.urdf").write_text(text.replace('effort="20"/>', mimic))
    message = rf"<mimic> of joint 'j6' \(arm.urdf, line 18\) is to follow '{followed}'"
    with pytest.raises(RobotError, match=message):
        load("arm.urdf", folder, flange="tool0")
    assert load("arm.urdf", folder, flange="l5").n == 5


@pytest.mark.parametrize("multiplier", ["inf", "1e9"])
def test_ratios_that_mean_nothing_are_refused(load: Load, folder: Path, multiplier: str) -> None:
    text = (folder / "six.urdf").read_text()
    mimic = f'effort="100"/><mimic joint="j2" multiplier="{multiplier}"/>'
    (folder / "arm.urdf").write_text(text.replace('effort="100"/>', mimic))
    with pytest.raises(RobotError, match="numbers beyond"):
        load("arm.urdf", folder, flange="tool0")


def test_lines_are_those_of_an_included_file(load: Load, folder: Path) -> None:
    (folder / "loop.xml").write_text(f"<mujoco>\n<equality>\n{LOOP}\n</equality></mujoco>")
    with pytest.raises(RobotError, match=re.escape("<connect> 'rod' (loop.xml, line 3)")):
        load(six(folder, "<include file='loop.xml'/>"), folder)


def test_a_coupling_that_is_said_twice_counts_once(load: Load, folder: Path) -> None:
    twice = LEVEL + tied("joint1='j2' joint2='j3' polycoef='0 -1 0 0 0'")
    assert load(six(folder, twice), folder).n == 5


@pytest.mark.parametrize(
    ("has", "left"),
    [
        ("range='-1 1' limited='true'", "its range is left out"),
        ("stiffness='10' damping='2'", "its spring, its damping are left out"),
        ("frictionloss='1'", "its friction is left out"),
    ],
)
def test_tendons_at_an_arms_joints_are_left_out_aloud(
    load: Load, folder: Path, has: str, left: str
) -> None:
    tendon = f"<tendon><fixed name='spring' {has}>{BOTH}"
    robot = load(six(folder, tendon), folder)
    (remark,) = (each for each in robot.remarks if each.code == "TS447")
    assert remark.message == f"tendon 'spring' acts on j2, j3: {left}"


def test_a_motor_on_a_tendon_is_left_out_aloud(load: Load, folder: Path) -> None:
    tendon = f"<tendon><fixed name='drive'>{BOTH}"
    motor = ('<motor name="m3" joint="j3"/>', '<motor name="m3" tendon="drive"/>')
    (remark,) = (
        each for each in load(six(folder, tendon, motor), folder).remarks if each.code == "TS447"
    )
    assert remark.message == "tendon 'drive' acts on j2, j3: its motor is left out"
    assert "actuatorfrcrange" in remark.hint


def test_r08_cannot_get_down_to_its_bench(load: Load, folder: Path) -> None:
    """Its j3 = -j2 holds the third link upright, and with that the tip above 0.45 m at x = 0.55 m.

    So a start at 0.35 m is out of reach (TS412), which a model of six free joints says nothing of.
    """
    text = (folder / "six.urdf").read_text()
    (folder / "arm.urdf").write_text(
        text.replace('effort="100"/>', 'effort="100"/><mimic joint="j2" multiplier="-1"/>')
    )
    robot = load("arm.urdf", folder, flange="tool0")
    assert robot.joint_names == ("j1", "j2", "j4", "j5", "j6")
    m, rng = robot.model, np.random.default_rng(0)
    d, lowest = mujoco.MjData(m), np.inf
    for _ in range(20000):
        q = np.insert(rng.uniform(robot.lower, robot.upper), 2, 0.0)
        q[2] = -q[1]
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        p = d.xpos[m.body(robot.tip_body).id]
        if np.hypot(p[0], p[1]) > 0.55:
            lowest = min(lowest, p[2])
    assert 0.4 < lowest < 0.6
