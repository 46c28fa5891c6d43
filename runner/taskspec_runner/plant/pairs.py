"""Which things of a scene touch, and how stiff they are where they do.

A contact of two things has the values of the declared shape that stands still or is driven; of two
loose bodies those of the softer one, and with the tool those of the shape that it touches.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.world.stiffness import (
    compliance,
    contact_mobility,
    mobility_of,
    pair_compliance,
)
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.plant.contact import contact_parameters
from taskspec_runner.plant.loose import loose, point_name, solid_of
from taskspec_runner.plant.names import PREFIX

Vector = NDArray[np.float64]


def add_pairs(spec: mujoco.MjSpec, robot: RobotModel, task: Task, start: Vector) -> None:
    """Adds all contact pairs: the tool with every shape, loose bodies with every other shape."""
    period = 1.0 / task.control.plant_rate
    held = task.robot.grasp
    for name, shape in task.shapes.items():
        if name == held:
            continue
        declared = compliance(shape, robot, start, period)
        mobility = contact_mobility(robot, shape)
        for geom in robot.tool_geoms:
            pair = spec.add_pair(geomname1=PREFIX + name, geomname2=geom, condim=3)
            contact_parameters(
                pair,
                declared,
                shape.friction,
                points=len(robot.tool_geoms),
                mobility=mobility,
                plant_period=period,
            )
    _add_loose_pairs(spec, task, period)


def _add_loose_pairs(spec: mujoco.MjSpec, task: Task, period: float) -> None:
    order = list(task.shapes)
    for name, body in loose(task).items():
        solid = solid_of(body)
        for other, shape in task.shapes.items():
            if other == name or (shape.free and order.index(other) > order.index(name)):
                continue
            mobility = mobility_of(body) + mobility_of(shape)
            # `rigid` is what one step of the plant resolves with this body's mass.
            declared = pair_compliance(shape, 1.0 / mobility, period)
            own, friction = pair_compliance(body, 1.0 / mobility, period), shape.friction
            if shape.free and own.stiffness < declared.stiffness:
                declared, friction = own, body.friction
            for number in range(len(solid.contact_points()[0])):
                pair = spec.add_pair(
                    geomname1=PREFIX + other, geomname2=point_name(name, number), condim=3
                )
                contact_parameters(
                    pair,
                    declared,
                    friction,
                    points=solid.resting_points,
                    mobility=mobility,
                    plant_period=period,
                )
