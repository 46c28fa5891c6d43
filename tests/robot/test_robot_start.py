"""Where a run starts."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from taskspec.robot import (
    RobotError,
    RobotModel,
    check_joints,
    inverse_kinematics,
    solve_start,
)
from taskspec.robot.inverse_kinematics import InverseKinematics, Target
from taskspec.spec.quantities import DimensionedNumber
from taskspec.text.units import ANGLE, LENGTH

Load = Callable[..., RobotModel]

ARMS = {
    "planar2": {"model": "planar2"},
    "planar3": {"model": "planar3"},
    "ur5e": {"model": "ur5e"},
    "panda": {"model": "panda"},
    "panda upside down": {"model": "panda", "base_xyz": (0, 0, 1.5), "base_rpy": (np.pi, 0, 0)},
    "own.urdf": {"model": "own.urdf", "flange": "palm"},
    "own.xml": {"model": "own.xml", "flange": "grip"},
}


@pytest.fixture(params=ARMS)
def robot(request: pytest.FixtureRequest, load: Load) -> RobotModel:
    return load(**ARMS[request.param])


def pose(robot: RobotModel, q: np.ndarray) -> pin.SE3:
    return InverseKinematics(robot).pose(q)


def test_nothing_asked_is_home(robot: RobotModel) -> None:
    q = solve_start(robot)
    np.testing.assert_array_equal(q, robot.home)
    assert q is not robot.home


def test_reachable_poses_are_reached(robot: RobotModel) -> None:
    rng = np.random.default_rng(2)
    lower, upper = np.maximum(robot.lower, -3), np.minimum(robot.upper, 3)
    for _ in range(8):
        # Away from the limits, of which a start keeps clear.
        wanted = pose(
            robot, rng.uniform(lower + 0.02 * (upper - lower), upper - 0.02 * (upper - lower))
        )
        rpy = pin.rpy.matrixToRpy(wanted.rotation) if "z" in robot.axes else None
        q = solve_start(robot, wanted.translation, rpy)
        at = pose(robot, q)
        assert np.linalg.norm(at.translation - wanted.translation) < 1e-9
        if rpy is not None:
            assert np.linalg.norm(pin.log3(wanted.rotation @ at.rotation.T)) < 1e-9
        assert (q > robot.lower).all()
        assert (q < robot.upper).all()


def test_home_is_found_again(robot: RobotModel) -> None:
    at = pose(robot, robot.home)
    rpy = pin.rpy.matrixToRpy(at.rotation) if "z" in robot.axes else None
    np.testing.assert_allclose(
        solve_start(robot, at.translation, rpy), robot.home, rtol=0, atol=1e-6
    )


def test_equal_questions_have_equal_answers(load: Load) -> None:
    answers = []
    for _ in range(2):
        inverse_kinematics._answers.clear()
        answers.append(solve_start(load("panda"), (-0.3, 0.4, 0.3)))
    np.testing.assert_array_equal(*answers)


def test_an_answer_that_is_kept_is_of_the_same_question(load: Load) -> None:
    """Another arm or base is another question; what a caller makes of an answer changes none."""
    there = (0.45, -0.1, 0.3)
    robots = [load("panda"), load("ur5e"), load("panda", base_xyz=(0, 0, 0.01))]
    fresh = []
    for robot in robots:
        inverse_kinematics._answers.clear()
        fresh.append(solve_start(robot, there))
    again = [solve_start(robot, there) for robot in robots for _ in range(2)]
    for i, answer in enumerate(again):
        np.testing.assert_array_equal(answer, fresh[i // 2])
    again[0] += 1.0
    np.testing.assert_array_equal(solve_start(robots[0], there), fresh[0])


def test_few_answers_are_kept(load: Load) -> None:
    solver = InverseKinematics(load("planar2"))
    for x in np.linspace(0.3, 0.5, inverse_kinematics._KEPT + 10):
        solver.nearest_home(Target(np.array([x, 0.2, 0.0])))
    assert len(inverse_kinematics._answers) == inverse_kinematics._KEPT


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_tool_points_straight_down_turned_as_at_home(load: Load, name: str) -> None:
    robot = load(name)
    down = pose(robot, solve_start(robot, (0.45, -0.1, 0.3))).rotation
    np.testing.assert_allclose(down, np.diag([1, -1, -1]), atol=1e-9)


def test_redundant_arm_stays_nearest_home(load: Load) -> None:
    robot = load("panda")
    q = solve_start(robot, (0.5, 0.1, 0.34))
    solver = InverseKinematics(robot)
    target = Target(np.array([0.5, 0.1, 0.34]), np.diag([1.0, -1, -1]))
    nearest = np.linalg.norm(q - robot.home)
    for step in (0.02, -0.02):
        other, missing = solver.descend(q + step * np.eye(7)[2], target)
        assert missing < 1e-9
        assert np.linalg.norm(other - robot.home) > nearest


def test_elbow_stays_on_its_side(load: Load) -> None:
    robot = load("planar2")
    assert solve_start(robot, (0.3, 0, 0))[1] < 0
    assert solve_start(robot, (0.3, 0.3, 0))[1] < 0


def test_hinges_are_not_wound_up(load: Load) -> None:
    robot = load("ur5e")
    rng = np.random.default_rng(4)
    for _ in range(5):
        wanted = pose(robot, rng.uniform(-3, 3, 6))
        q = solve_start(robot, wanted.translation, pin.rpy.matrixToRpy(wanted.rotation))
        assert (np.abs(q - robot.home) < np.pi + 0.2).all()


def test_planar_yaw_is_the_tools_direction(load: Load) -> None:
    robot = load("planar3")
    at = pose(robot, solve_start(robot, (0.4, 0.1, 0), (0, 0, 0.6)))
    np.testing.assert_allclose(at.translation, [0.4, 0.1, 0], atol=1e-9)
    np.testing.assert_allclose(at.rotation[:, 2], [np.cos(0.6), np.sin(0.6), 0], atol=1e-9)


def test_joints(load: Load) -> None:
    robot = load("panda")
    joints = (0.1, -0.4, 0, -2, 0, 1.5, 0.5)
    np.testing.assert_array_equal(solve_start(robot, joints=joints), joints)
    with pytest.raises(RobotError, match="6 joint positions, 'panda' has 7 joints") as caught:
        solve_start(robot, joints=(0,) * 6)
    assert caught.value.code == "TS411"
    assert "joint1, joint2" in caught.value.hint
    with pytest.raises(RobotError, match=r"joint 4 \('joint4'\) cannot start at 0 deg") as caught:
        solve_start(robot, joints=(0,) * 7)
    assert caught.value.hint == "it moves between -176.001 and -3.99925 deg"
    assert caught.value.field == ("start", "joints")


def test_sliding_joints_are_told_in_millimetres(load: Load) -> None:
    robot = load("own.xml", flange="grip")
    with pytest.raises(RobotError, match="cannot start at 400 mm"):
        solve_start(robot, joints=(0.4, *robot.home[1:]))


def test_kinds_of_joints(load: Load) -> None:
    robot = load("own.xml", flange="grip")
    home = [DimensionedNumber(q, ANGLE) for q in robot.home]
    slide = DimensionedNumber(robot.home[0], LENGTH)
    q = solve_start(robot, joints=(slide, *home[1:]))
    np.testing.assert_array_equal(q, robot.home)
    solve_start(robot, joints=(slide, *(DimensionedNumber(0.0) if q == 0 else q for q in home[1:])))
    with pytest.raises(
        RobotError, match=r"joint 1 .* slides, and the start gives it an angle"
    ) as c:
        solve_start(robot, joints=home)
    assert (c.value.code, c.value.hint) == ("TS411", "give it a length, in mm")
    with pytest.raises(RobotError, match=r"joint 2 .* turns, and the posture gives .* length") as c:
        check_joints(robot, (slide, slide, *home[2:]), "the posture", ("posture",))
    assert (c.value.field, c.value.hint) == (("posture",), "give it an angle, in deg")


@pytest.mark.parametrize(
    ("name", "xyz", "miss", "hint"),
    [
        ("panda", (1.5, 0, 0.3), "misses it by 556", "that way the arm reaches 0.94"),
        ("planar2", (0.8, 0, 0), "misses it by 200.0 mm", "reaches 0.600 m"),
        ("planar2", (0.3, 0, 0.05), "misses it by 50.0 mm", "nearest point is [0.300, "),
        ("panda", (1e30, 0, 0), r"misses it by 1e\+30 m", "the start is 1e+30 m from it"),
        ("panda", (1e300, 1e300, 0), r"misses it by 1.414e\+300 m", "that way the arm reaches 0.9"),
        ("planar3", (0.03, 0.0, 0), "mm", "comes no nearer than"),
    ],
)
def test_out_of_reach(load: Load, name: str, xyz: tuple[float, ...], miss: str, hint: str) -> None:
    robot = load(name)
    if name == "planar3":
        robot = load("planar2")
    with pytest.raises(RobotError, match=miss) as caught:
        solve_start(robot, xyz)
    assert caught.value.code == "TS412"
    assert caught.value.field == ("start", "xyz")
    assert hint in caught.value.hint


def test_reached_but_not_that_way(load: Load) -> None:
    with pytest.raises(RobotError, match=r"not with the tool straight down: .* 3\.5 deg") as caught:
        solve_start(load("panda"), (0.8, 0, 0.3))
    assert (caught.value.code, caught.value.field) == ("TS413", ("start", "xyz"))
    with pytest.raises(RobotError, match="not with the tool as rpy asks") as caught:
        solve_start(load("planar3"), (0.5, 0, 0), (0, 0, 3))
    assert (caught.value.code, caught.value.field) == ("TS413", ("start", "rpy"))


def test_another_yaw_is_tried_before_giving_up(load: Load) -> None:
    panda = load("panda")
    lower, upper = panda.lower.copy(), panda.upper.copy()
    lower[6], upper[6] = 0.7, 0.9
    robot = replace(panda, lower=lower, upper=upper)
    point, asked = (0.3, 0.45, 0.3), (np.pi, 0, 0)
    with pytest.raises(RobotError, match="but not with this yaw") as caught:
        solve_start(robot, point, asked)
    assert (caught.value.code, caught.value.field) == ("TS413", ("start", "rpy"))
    other = pose(robot, solve_start(robot, point))
    np.testing.assert_allclose(other.translation, point, atol=1e-9)
    np.testing.assert_allclose(other.rotation[:, 2], [0, 0, -1], atol=1e-9)
    turn = float(re.search(r"by ([-+0-9.]+) deg", caught.value.hint)[1])
    yaw = asked[2] + np.radians(turn)
    np.testing.assert_allclose(pin.rpy.rpyToMatrix(np.pi, 0, yaw), other.rotation, atol=1e-3)


def test_place_in_the_hint_is_possible(load: Load) -> None:
    robot = load("panda")
    with pytest.raises(RobotError, match="tool straight down") as caught:
        solve_start(robot, (0, 0, 0.34))
    assert caught.value.code == "TS413"
    assert "base" not in caught.value.hint
    place = re.search(r"start at \[(.*)\] m", caught.value.hint)[1]
    solve_start(robot, [float(x) for x in place.split(",")])


@pytest.mark.parametrize("name", ["planar2", "planar3", "ur5e", "panda"])
def test_any_target_has_a_solution_or_a_robot_error(load: Load, name: str) -> None:
    robot = load(name)
    rng = np.random.default_rng(5)
    points = [
        *([0, 0, z] for z in (0.0, 0.34, 1.5, 1e30)),
        *([x, 0, 0] for x in (0.6, 0.6 + 1e-9, -1e300)),
        *(rng.uniform(-1, 1, (5, 3)) * (1, 1, "z" in robot.axes)),
    ]
    for point in points:
        told = None
        try:
            q = solve_start(robot, point)
        except RobotError as error:
            told = error
        if told is None:
            np.testing.assert_allclose(pose(robot, q).translation, point, atol=1e-8)
        else:
            assert told.code in ("TS412", "TS413")
            assert len(told.message) < 150


def test_orientations_that_an_arm_does_not_have(load: Load) -> None:
    with pytest.raises(RobotError, match="cannot choose an orientation, only x and y"):
        solve_start(load("planar2"), (0.4, 0, 0), (0, 0, 0.1))
    with pytest.raises(RobotError, match="turns about z alone"):
        solve_start(load("planar3"), (0.4, 0, 0), (np.pi, 0, 0))
    with pytest.raises(RobotError, match="an orientation and no position"):
        solve_start(load("panda"), None, (0, 0, 0))
