"""Which axes a tip has, on arms with few joints and many."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from taskspec.robot import RobotModel

Load = Callable[..., RobotModel]


def noted(robot: RobotModel, text: str) -> bool:
    return any(text in note for note in robot.notes)


def arm(joints: str) -> str:
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
def test_axes(load: Load, tmp_path: Path, joints: str, axes: str) -> None:
    (tmp_path / "arm.xml").write_text(arm(joints))
    robot = load("arm.xml", tmp_path, tool_length=0.15)
    assert robot.axes == tuple(axes.split())
    assert len(set(robot.joint_names)) == len(joints.split())


def test_orientations_that_follow_are_noted(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(arm("rz ry ry rx ry"))
    assert noted(load("arm.xml", tmp_path), "only x, y, z of the tool tip can be controlled")


def test_names_that_the_file_lacks(load: Load, tmp_path: Path) -> None:
    text = arm("X Y Z").replace("<joint ", '<joint name="joint1" ', 1)
    text = text.replace("<body ", '<body name="body2" ', 1)
    (tmp_path / "arm.xml").write_text(text)
    robot = load("arm.xml", tmp_path)
    assert robot.joint_names == ("joint1", "joint2", "joint3")
    bodies = [robot.model.body(i).name for i in range(robot.model.nbody)]
    assert bodies == ["world", "body2", "body1", "body3", "tool"]
