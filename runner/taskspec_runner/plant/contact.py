"""Contacts of the declared stiffness, damping and friction.

MuJoCo's contact with a constant impedance d is a spring and damper of solref's direct form with
the virtual mass d/((1 - d) A) added, A the sum of the bodies' translational invweight0. The direct
form (-k (1 - d) A, -b (1 - d) A) makes a press deform f/k; a small d keeps the added mass small
(at the default 0.9 it is 33 kg on a seven-joint arm, and good controllers look unstable).
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.stiffness import compliance, virtual_mass_scale
from taskspec.robot import RobotModel
from taskspec.spec import Shape

Vector = NDArray[np.float64]

#: Impedance d of every contact.
IMPEDANCE = 0.02
#: Share of a sticking contact's slip that friction may take away in one step of the plant.
SETTLING = 0.5
_NO_SPRING = 1e-9
#: A friction of exactly zero would leave MuJoCo's elliptic cone without a size.
_LEAST_FRICTION = 1e-5


def contact_parameters(
    pair: mujoco.MjsPair, shape: Shape, robot: RobotModel, start: Vector, plant_period: float
) -> None:
    """Sets a pair so that the whole contact has what `shape` declares.

    A flat tool touches with several points; each carries an equal share.
    """
    share = 1.0 / len(robot.tool_geoms)
    scale = (1 - IMPEDANCE) / virtual_mass_scale(robot)
    declared = compliance(shape, robot, start, plant_period)
    k, b = declared.stiffness * share, declared.damping * share
    pair.solref = [-k * scale, -b * scale]
    # The friction rows would take the contact's damping for their own rate of settling. Past one
    # over the step they overshoot, and the friction force flips between the cone's limits.
    slowest = min(b * scale, IMPEDANCE * SETTLING / plant_period)
    pair.solreffriction = [-_NO_SPRING, -max(slowest, _NO_SPRING)]
    pair.solimp = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0]
    sliding = max(shape.friction, _LEAST_FRICTION)
    pair.friction = [sliding, sliding, 0.0, 0.0, 0.0]
    if shape.friction == 0:
        pair.condim = 1
