"""Limits of URDF joints are those of the file; what they lock is held against Pinocchio."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from taskspec.robot import RobotError, RobotModel
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.spec import load_task
from taskspec_runner.session import execute

Load = Callable[..., RobotModel]

INERTIAL = (
    '<inertial><origin xyz="{x} 0.01 0.1"/><mass value="{m}"/>'
    '<inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial>'
)
FULL = '<limit lower="-3" upper="3" effort="90" velocity="2"/>'
#: Origins and axes of the joints of an arm with six.
JOINTS = (
    ("0 0 0.16", "0 0 0", "0 0 1"), ("0 0.14 0", "0 1.5708 0", "0 1 0"),
    ("0 -0.13 0.42", "0 0 0", "0 1 0"), ("0 0 0.39", "0 1.5708 0", "0 1 0"),
    ("0 0.13 0", "0 0 0", "0 0 1"), ("0 0 0.1", "0 0 0", "0 1 0"),
)  # fmt: skip


def arm(limits: dict[int, str], kinds: dict[int, str] | None = None, more: str = "") -> str:
    """A URDF file of six joints, j1 to j6, with limits of some of them (counted from 1)."""
    parts = ['<robot name="six"><link name="l0"/>']
    for i, (xyz, rpy, axis) in enumerate(JOINTS, 1):
        parts.append(f'<link name="l{i}">{INERTIAL.format(x=0.01 * i, m=8 - i)}</link>')
        kind = (kinds or {}).get(i, "revolute")
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limits.get(i, FULL)}</joint>'
        )
    return "".join([*parts, more, "</robot>"])


LOCKED = {
    "equal limits": ('<limit lower="0.5" upper="0.5" effort="28" velocity="3"/>', 0.5),
    "no lower and upper": ('<limit effort="28" velocity="3"/>', 0.0),
    "negative": ('<limit lower="-1.2" upper="-1.2" effort="28" velocity="3"/>', -1.2),
}


@pytest.mark.parametrize("case", LOCKED)
@pytest.mark.parametrize("joint", [1, 4, 6])
def test_a_locked_joint_is_pinocchios_at_its_limit(
    load: Load, tmp_path: Path, case: str, joint: int
) -> None:
    """Pinocchio keeps such a joint, with the two limits; here its coordinate is gone."""
    limit, value = LOCKED[case]
    (tmp_path / "arm.urdf").write_text(arm({joint: limit}))
    robot = load("arm.urdf", tmp_path, tool_mass=0.0)
    whole = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    at = whole.joints[whole.getJointId(f"j{joint}")].idx_q
    assert whole.lowerPositionLimit[at] == whole.upperPositionLimit[at] == value
    left = [i for i in range(6) if i != at]
    assert robot.joint_names == tuple(f"j{i + 1}" for i in left)
    np.testing.assert_array_equal(robot.lower, whole.lowerPositionLimit[left])
    np.testing.assert_array_equal(robot.upper, whole.upperPositionLimit[left])
    assert robot.model.nq == robot.pin.nq == 5
    terms, data, random = PinocchioTerms(robot), whole.createData(), np.random.default_rng(joint)
    flange = whole.addFrame(
        pin.Frame("tip", 6, 0, robot.tip if joint != 6 else pin.SE3.Identity(), pin.OP_FRAME)
    )
    data = whole.createData()
    for _ in range(10):
        q, v = np.zeros(6), np.zeros(6)
        q[left], v[left] = random.uniform(-2, 2, 5), random.uniform(-1, 1, 5)
        q[at] = value
        terms.at(q[left], v[left])
        pin.computeAllTerms(whole, data, q, v)
        pin.updateFramePlacements(whole, data)
        np.testing.assert_allclose(terms.inertia, data.M[np.ix_(left, left)], atol=1e-9)
        np.testing.assert_allclose(terms.bias, data.nle[left], atol=1e-9)
        if joint != 6:
            np.testing.assert_allclose(terms.position, data.oMf[flange].translation, atol=1e-9)
    (remark,) = (each for each in robot.remarks if each.code == "TS449")
    assert f"joint 'j{joint}' is locked at {value:g}" in remark.message
    assert any(f"locked: j{joint} at {value:g}" in note for note in robot.notes)
    assert not any("equal lower and upper" in note for note in robot.notes)


def test_a_robot_with_a_locked_joint_is_planned_and_run_with_it_locked(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(arm({4: LOCKED["equal limits"][0]}))
    text = """\
taskspec: 1
name: held
robot: {model: arm.urdf, tool: {length: 100 mm, mass: 0}, start: {joints: START}}
stages:
  move: {axes: {x: {move: 40 mm}, y: {move: -30 mm}, z: {move: 20 mm}}}
  wait: {axes: {x: hold, y: hold, z: hold}, time: 0.2 s}
expect: [max(abs(wait.error.x)) < 0.5 mm, max(abs(wait.error.z)) < 0.5 mm]
"""
    text = text.replace("START", "[11 deg, -34 deg, 80 deg, 63 deg, 23 deg]")
    (tmp_path / "held.yaml").write_text(text)
    run = execute(load_task(tmp_path / "held.yaml"), tmp_path / "run", report=False)
    assert run.exit_code == 0, run.summary["ending"]
    columns, whole = run.history.columns, pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    assert "joint.6.position" not in columns
    data, six = whole.createData(), np.full((len(run.history), 6), 0.5)
    for i, at in enumerate((0, 1, 2, 4, 5), 1):
        six[:, at] = columns[f"joint.{i}.position"]
    tips = []
    for q in six:
        pin.forwardKinematics(whole, data, q)
        tips.append((data.oMi[6] * pin.SE3(np.eye(3), np.array([0, 0, 0.1]))).translation)
    moved = np.array(tips) - tips[0]
    # Pinocchio's arm, held at its limit, goes where the task says.
    np.testing.assert_allclose(moved[-1], [0.04, -0.03, 0.02], atol=5e-4)


def test_arm_whose_joints_are_all_locked_is_none(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(
        arm({i: '<limit effort="9" velocity="1"/>' for i in range(7)})
    )
    with pytest.raises(RobotError, match="every joint of the arm is locked") as error:
        load("arm.urdf", tmp_path)
    assert error.value.code == "TS405"


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_without_limit_is_refused_as_urdf_does(
    load: Load, tmp_path: Path, kind: str
) -> None:
    (tmp_path / "arm.urdf").write_text(arm({4: ""}, {4: kind}))
    with pytest.raises(RobotError, match=f"joint 'j4' is {kind} and has no <limit>") as error:
        load("arm.urdf", tmp_path)
    assert error.value.code == "TS405"
    assert 'type="continuous"' in error.value.hint


def test_a_joint_that_follows_a_locked_one_is_locked_too(load: Load, tmp_path: Path) -> None:
    follows = f'{FULL}<mimic joint="j2" multiplier="-2" offset="0.1"/>'
    limits = {2: '<limit lower="0.3" upper="0.3" effort="9" velocity="1"/>', 3: follows}
    (tmp_path / "arm.urdf").write_text(arm(limits))
    robot = load("arm.urdf", tmp_path)
    assert robot.joint_names == ("j1", "j4", "j5", "j6")
    (remark,) = (each for each in robot.remarks if each.code == "TS446")
    assert "j3 = -0.5" in remark.message
    q = robot.coupling.joints(np.zeros(4))
    np.testing.assert_allclose(q, [0, -0.5, 0, 0, 0])


def test_a_follower_without_a_range_of_its_own_locks_nothing(load: Load, tmp_path: Path) -> None:
    follows = '<limit effort="9" velocity="1"/><mimic joint="j2" multiplier="-1"/>'
    (tmp_path / "arm.urdf").write_text(arm({3: follows}))
    robot = load("arm.urdf", tmp_path)
    assert robot.joint_names == ("j1", "j2", "j4", "j5", "j6")
    np.testing.assert_array_equal(robot.lower, -3.0)


def test_locked_fingers_stay_where_their_file_has_them(load: Load, tmp_path: Path) -> None:
    finger = (
        f'<link name="finger">{INERTIAL.format(x=0, m=0.1)}</link>'
        '<joint name="grip" type="prismatic"><parent link="l6"/><child link="finger"/>'
        '<origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>'
        '<limit lower="0.02" upper="0.02" effort="9" velocity="1"/></joint>'
    )
    (tmp_path / "arm.urdf").write_text(arm({}, more=finger))
    robot = load("arm.urdf", tmp_path, flange="l6")
    np.testing.assert_allclose(robot.model.body("finger").pos, [0, 0.02, 0.1], atol=1e-12)
    assert not [each for each in robot.remarks if each.code == "TS449"]


def test_planar_joints_have_their_limits_on_every_coordinate(load: Load, tmp_path: Path) -> None:
    limit = '<limit lower="-1" upper="1.5" effort="50" velocity="2"/>'
    (tmp_path / "arm.urdf").write_text(arm({1: limit}, {1: "planar"}))
    robot = load("arm.urdf", tmp_path)
    assert robot.joint_names[:3] == ("j1_TX", "j1_TY", "j1_RZ")
    np.testing.assert_array_equal(robot.lower[:3], -1)
    np.testing.assert_array_equal(robot.upper[:3], 1.5)
    np.testing.assert_array_equal(robot.velocity_limit[:3], 2)
    np.testing.assert_array_equal(robot.torque_limit[:3], 50)
    (tmp_path / "arm.urdf").write_text(arm({1: ""}, {1: "planar"}))
    free = load("arm.urdf", tmp_path)
    np.testing.assert_array_equal(free.upper[:3], np.inf)
    np.testing.assert_array_equal(free.upper[3:], 3)


def test_soft_limits_and_rotors_that_are_left_out_are_noted(load: Load, tmp_path: Path) -> None:
    soft = '<safety_controller soft_lower_limit="-1" soft_upper_limit="1" k_velocity="9"/>'
    transmission = (
        '<transmission name="t"><type>x/SimpleTransmission</type><joint name="j3"/>'
        '<actuator name="m"><mechanicalReduction>{}</mechanicalReduction></actuator></transmission>'
    )
    (tmp_path / "arm.urdf").write_text(arm({2: FULL + soft}, more=transmission.format(101)))
    robot = load("arm.urdf", tmp_path)
    assert any(
        note.startswith("the soft limits of") and note.endswith(": j2") for note in robot.notes
    )
    assert any("rotors" in note and note.endswith(": j3") for note in robot.notes)
    assert robot.upper[1] == 3
    (tmp_path / "arm.urdf").write_text(arm({}))
    assert not any("soft" in note or "rotors" in note for note in load("arm.urdf", tmp_path).notes)
