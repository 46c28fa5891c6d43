"""Stiffness and damping of the contact with an object, `rigid` included."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.program import frames
from taskspec.robot import RobotModel
from taskspec.spec import Shape

Vector = NDArray[np.float64]

#: `rigid` is a contact that turns half a radian of its own oscillation in one step of the plant.
RIGID_PHASE = 0.5
#: Beyond this many radians in a step the plant does not resolve the contact any more.
RESOLVED_PHASE = 1.0


@dataclass(frozen=True, slots=True)
class Compliance:
    """A contact's stiffness [N/m] and damping [N s/m]; `phase` [rad] is what one step makes of it.

    The phase is T sqrt(k / m) with the mass m that the tool has along the normal at the start.
    """

    stiffness: float
    damping: float
    phase: float


def compliance(shape: Shape, robot: RobotModel, start: Vector, plant_period: float) -> Compliance:
    """The contact of the tool with an object as its declaration means it.

    Args:
        shape: the object. robot: the arm. start: (n,) where the run begins.
        plant_period: step of the plant [s].
    """
    mass = normal_mass(robot, start, shape)
    rigid = shape.stiffness == "rigid"
    k = mass * (RIGID_PHASE / plant_period) ** 2 if rigid else float(shape.stiffness)
    b = shape.damping
    if b is None:
        # A tenth of critical for 1 kg; a rigid contact is critical for the mass that it meets.
        b = 2 * math.sqrt(k * mass) if rigid else 0.1 * 2 * math.sqrt(k)
    return Compliance(k, b, plant_period * math.sqrt(k / mass))


def normal_mass(robot: RobotModel, q: Vector, shape: Shape) -> float:
    """Lambda_n = 1 / (a^T J H^-1 J^T a) [kg] at q (n,) along the normal a of an object.

    Where the arm cannot move along the normal at all, the mean over what it can.
    """
    data = robot.pin.createData()
    frame = robot.pin.getFrameId("tip")
    J = pin.computeFrameJacobian(robot.pin, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
    H = np.triu(pin.crba(robot.pin, data, q))
    mobility = J @ np.linalg.solve(H + np.triu(H, 1).T, J.T)
    pin.framesForwardKinematics(robot.pin, data, q)
    tip = np.array(data.oMf[frame].translation)
    a = np.array(ca.evalf(frames.surface(shape).gradient(ca.SX(tip)))).ravel()
    along = float(a @ mobility @ a)
    return 1.0 / (along if along > 1e-6 else float(np.trace(mobility)) / 3)


def virtual_mass_scale(robot: RobotModel) -> float:
    """Mean mass [kg] that a contact at the tool feels, as MuJoCo counts it (1/invweight0)."""
    body = robot.model.body(robot.tip_body).id
    return 1.0 / float(robot.model.body_invweight0[body, 0])
