"""The vectors into which a plant writes what is true."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.spec import Task

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PlantViews:
    """The truth of a tick: state at its beginning, forces of its (last) step.

    Attributes:
        wrench: (6,) by the environment on the tool tip, world axes [N, N m].
        objects: (shapes,) magnitude of the contact force with each shape [N].
        equations: (equations,) what the robot applies along each unit gradient [N, N m]; last, in
            a task that grips, what the gripper reports [N, m].
        mechanism_positions: (mechanisms,) coordinates at the tick [rad, m].
        mechanism_rates: (mechanisms,) their rates at the tick [rad/s, m/s].
        mechanism_efforts: (mechanisms,) what the robot applies to each coordinate [N m, N].
        bushings: (6 bushings,) what the robot applies to each, in its axes [N, N m].
        loose: (7 bodies,) position [m] and quaternion (w x y z) of each loose body at the tick.
        exerted: (n,) of an arm that takes no torques, what its drives exert at the end of the step
            [N m, N]; of others (0,).
        servo: (n,) likewise, what its servo holds the joints to at the end of the step [rad, m].
    """

    wrench: Vector
    objects: Vector
    equations: Vector
    mechanism_positions: Vector
    mechanism_rates: Vector
    mechanism_efforts: Vector
    bushings: Vector
    loose: Vector
    exerted: Vector
    servo: Vector

    @classmethod
    def new(cls, task: Task, joints: int) -> PlantViews:
        """Views with arrays of their own, for an arm of so many joints."""
        return cls(*(np.zeros(length) for _, length in view_fields(task, joints)))


def view_fields(task: Task, joints: int) -> list[tuple[str, int]]:
    """Name and length of every vector, in order, for an arm of so many joints."""
    mechanisms = len(task.mechanisms)
    followed = 0 if task.robot.takes_torques else joints
    lengths = {
        "wrench": 6,
        "objects": len(task.shapes),
        "equations": len(task.reported),
        "mechanism_positions": mechanisms,
        "mechanism_rates": mechanisms,
        "mechanism_efforts": mechanisms,
        "bushings": 6 * len(task.bushings),
        "loose": 7 * sum(shape.free for shape in task.shapes.values()),
        "exerted": followed,
        "servo": followed,
    }
    return [(field.name, lengths[field.name]) for field in fields(PlantViews)]
