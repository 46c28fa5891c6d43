"""Coulomb friction of joints and mechanisms in MuJoCo: rigid up to its limit.

By its own defaults MuJoCo lets a joint creep that friction holds, at a / b (1 - d) / d under what
would accelerate it by a: 5 mm/s at 5 m/s^2. The impedance d near 1 and the rate b of half a step
leave a hundred times less of that, in one step.
"""

from __future__ import annotations

import mujoco

#: The impedance d, and the share of a slip that is taken away in a step of the plant.
IMPEDANCE, SETTLING = 0.999, 0.5


def set_friction(joint: mujoco.MjsJoint, friction: float, period: float) -> None:
    """Gives a joint its dry friction.

    Args:
        joint: in the scene's specification.
        friction: its limit [N m, N].
        period: step of the plant [s].
    """
    joint.frictionloss = friction
    joint.solimp_friction = [IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0]
    joint.solref_friction = [-1e-9, -SETTLING / period * IMPEDANCE]
