"""Contacts of the declared stiffness, damping and friction.

MuJoCo's contact with a constant impedance d is a spring and damper of solref's direct form with
the virtual mass d/((1 - d) A) added, A the sum of the bodies' translational invweight0. The direct
form (-k (1 - d) A, -b (1 - d) A) makes a press deform f/k; a small d keeps the added mass small
(at the default 0.9 it is 33 kg on a seven-joint arm, and good controllers look unstable).
"""

from __future__ import annotations

import math

import mujoco

from taskspec.program.world.stiffness import (
    IMPEDANCE,
    Compliance,
    creep,
    settling_rate,
    virtual_mass_scale,
)
from taskspec.robot import RobotModel

_NO_SPRING = 1e-9
#: A friction of exactly zero would leave MuJoCo's elliptic cone without a size.
_LEAST_FRICTION = 1e-5


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
        pair: of one point. declared: of the whole contact. friction: Coulomb's coefficient.
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
    sliding = max(friction, _LEAST_FRICTION)
    pair.friction = [sliding, sliding, 0.0, 0.0, 0.0]
    if friction == 0:
        pair.condim = 1


def most_creep(robot: RobotModel, plant_period: float) -> float:
    """The largest force over slip [N s/m] of friction below its limit, at one point of the tool.

    What halves a slip of the contact's mean mass 1/A in one step, as MuJoCo counts it: IMPRATIO
    divides the friction rows' (1 - d)/d.
    """
    return creep(math.inf, 1.0 / virtual_mass_scale(robot), plant_period)[0]
