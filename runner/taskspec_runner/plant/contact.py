"""Contacts: what of a scene touches what, with the declared stiffness, damping and friction.

A contact of two things has the values of the declared shape that stands still or is driven; of two
loose bodies those of the softer one, and with a tool those of the shape that it touches.

MuJoCo's contact with a constant impedance d is a spring and damper of solref's direct form with
the virtual mass d/((1 - d) A) added, A the sum of the bodies' translational invweight0. The direct
form (-k (1 - d) A, -b (1 - d) A) makes a press deform f/k; a small d keeps the added mass small
(at the default 0.9 it is 33 kg on a seven-joint arm, and good controllers look unstable).
"""

from __future__ import annotations

import math

import mujoco

from taskspec.program.world.frames import surface
from taskspec.program.world.stiffness import (
    IMPEDANCE,
    Compliance,
    compliance,
    creep,
    mobility_of,
    pair_compliance,
    settling_rate,
    virtual_mass_scale,
)
from taskspec.robot import RobotModel
from taskspec.shapes.overlap import LEAST_FRICTION
from taskspec.shapes.solid import touched_whole
from taskspec.spec import Task
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.loose import loose, point_name, solid_of
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.plant.whole import markers
from taskspec_runner.plant.whole.markers import WholeContact

_NO_SPRING = 1e-9


def add_tool_pairs(
    spec: mujoco.MjSpec, arm: SceneArm, task: Task, mobility: float, *, whole: bool = True
) -> None:
    """Adds the contacts of an arm's tool with every shape that it does not hold.

    Args:
        spec: to add to.
        arm: it.
        task: whose shapes they are.
        mobility: of the tool, as MuJoCo counts it [1/kg].
        whole: whether surfaces that touch as a whole do so, not point by point.
    """
    robot, period = arm.robot, 1.0 / task.control.plant_rate
    for name, shape in task.shapes.items():
        if name in task.carried:
            # What is gripped lies between the pads, which the tool's shape has no room for.
            continue
        declared, solid = compliance(shape, robot, arm.start, period), surface(shape)
        if whole and (solid.whole() is not None or (robot.tool.flat and touched_whole(solid))):
            contact = WholeContact(declared, shape.friction, mobility + mobility_of(shape), period)
            touches = robot.tool_geoms[0], robot.tool
            drawn = solid.geom() if shape.motion is None else solid.moving_geom()
            markers.add_pair(spec, name, solid, touches, contact, drawn.center)
            continue
        for geom in robot.tool_geoms:
            pair = spec.add_pair(geomname1=PREFIX + name, geomname2=geom, condim=3)
            contact_parameters(
                pair,
                declared,
                shape.friction,
                points=len(robot.tool_geoms),
                mobility=mobility + mobility_of(shape),
                plant_period=period,
            )


def add_loose_pairs(spec: mujoco.MjSpec, task: Task, *, whole: bool = True) -> None:
    """Adds the contacts of loose bodies with every other shape; `whole` as for a tool."""
    order, period = list(task.shapes), 1.0 / task.control.plant_rate
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
            centers, radius = solid.contact_points()
            ground = surface(shape)
            if whole and ground.whole() is not None:
                each = Compliance(
                    declared.stiffness / solid.resting_points,
                    declared.damping / solid.resting_points,
                    declared.phase,
                )
                contact = WholeContact(each, friction, mobility, period)
                for number in range(len(centers)):
                    touches = point_name(name, number), radius
                    markers.add_pair(spec, other, ground, touches, contact)
                continue
            for number in range(len(centers)):
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


def contact_parameters(
    pair: mujoco.MjsPair,
    declared: Compliance,
    friction: float,
    *,
    points: int,
    mobility: float,
    plant_period: float,
) -> None:
    """Sets a pair so that the whole contact has what is declared.

    Args:
        pair: of one point.
        declared: of the whole contact.
        friction: Coulomb's coefficient.
        points: with how many it touches; each carries an equal share.
        mobility: A, the sum of both bodies' inverse masses as MuJoCo counts them [1/kg].
        plant_period: step of the plant [s].
    """
    scale = (1 - IMPEDANCE) * mobility
    k, b = declared.stiffness / points, declared.damping / points
    pair.solref = [-k * scale, -b * scale]
    rate = settling_rate(b, mobility, plant_period)
    pair.solreffriction = [-_NO_SPRING, -max(rate, _NO_SPRING)]
    pair.solimp = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0]
    sliding = max(friction, LEAST_FRICTION)
    pair.friction = [sliding, sliding, 0.0, 0.0, 0.0]
    if friction == 0:
        pair.condim = 1


def most_creep(robot: RobotModel, plant_period: float) -> float:
    """The largest force over slip [N s/m] of friction below its limit, at one point of the tool.

    What halves a slip of the contact's mean mass 1/A in one step, as MuJoCo counts it: IMPRATIO
    divides the friction rows' (1 - d)/d.
    """
    return creep(math.inf, 1.0 / virtual_mass_scale(robot), plant_period)[0]
