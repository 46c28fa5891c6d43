"""Objects that are moved along, and turned about, their own axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec.program.components import changed
from taskspec.spec import Shape, Task

Vector = NDArray[np.float64]


def turned(R: Vector, by: Vector) -> Vector:
    """(3, 3) axes R turned about their own x and y at once, and then about their own z [rad]."""
    first, second = np.array([by[0], by[1], 0.0]), np.array([0.0, 0.0, by[2]])
    return np.asarray(R @ _exp(first) @ _exp(second))


def origin_of(own: Shape, by: Vector) -> Vector:
    """(3,) the origin of an object that is turned, and moved along its axes but for their spin.

    So nothing changes where a plane is moved in itself, or a cylinder along or about its axis,
    however they are placed.
    """
    axes = turned(from_rpy(own.rpy), np.array([by[3], by[4], 0.0]))
    return np.asarray(np.array(own.xyz) + axes @ by[:3])


def placed(task: Task, name: str, by: Vector) -> Task:
    """The task with an object turned about its own axes, and moved along them.

    Args:
        task: with it where the file has it.
        name: of the object.
        by: (6,) displacements [m], then angles [rad].
    """
    own = task.shapes[name]
    for i, value in enumerate(origin_of(own, by)):
        task = changed(task, f"world.{name}.xyz", i, float(value))
    if by[3:].any():
        R = turned(from_rpy(own.rpy), by[3:])
        for i, value in enumerate(rpy_of(R, np.array(own.rpy))):
            task = changed(task, f"world.{name}.rpy", i, float(value))
    return task


def rpy_of(R: Vector, near: Vector) -> Vector:
    """(3,) roll, pitch, yaw of axes (3, 3), the ones nearest to some others [rad]."""
    pitch = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    if np.hypot(R[2, 1], R[2, 2]) < 1e-9:
        # Roll and yaw turn about one axis: yaw stays.
        s, c = np.sin(near[2]), np.cos(near[2])
        back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ R
        first = np.array([np.arctan2(-back[1, 2], back[1, 1]), pitch, near[2]])
    else:
        first = np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])
    second = np.array([first[0] + np.pi, np.pi - first[1], first[2] + np.pi])
    both = [near + (each - near + np.pi) % (2 * np.pi) - np.pi for each in (first, second)]
    return np.asarray(min(both, key=lambda each: float(np.abs(each - near).sum())))


def _exp(by: Vector) -> Vector:
    """(3, 3) rotation about a vector (3,) [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(by))
    K = np.array([[0.0, -by[2], by[1]], [by[2], 0.0, -by[0]], [-by[1], by[0], 0.0]])
    if angle < 1e-12:
        return np.asarray(np.eye(3) + K)
    square = (1 - np.cos(angle)) / angle**2
    return np.asarray(np.eye(3) + np.sin(angle) / angle * K + square * K @ K)
