"""The torque that the last stage's law asked for and this one's does not, as it fades.

Two laws ask for different torques of the same measurement. The difference as a stage begins, D, is
added to what its law asks for, and fades,

    u = u_law + D max(0, 1 - t/T_f),    T_f = max|D_j| / (1000 N m/s),

so that the torque goes on without a step. D is chosen once and is over after T_f: the closed loop,
and so its stability, is that of the law alone. It comes before saturation and before the program,
so that all limits hold for the sum.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.clock import Clock
from taskspec.program.slots import Slots

Vector = NDArray[np.float64]

#: How fast the joint fades that has most to fade [N m/s, N/s].
FADING = 1000.0
_STEP, _RATE = "carried_torque", "carried_torque.rate"


def fading(parameters: Slots, clock: Clock, joints: int) -> ca.SX:
    """D max(0, 1 - t/T_f) of a stage (n,) [N m]; takes the slots of D and of 1/T_f."""
    step, rate = parameters.add(_STEP, joints), parameters.add(_RATE)
    return step * ca.fmax(0, 1 - clock.t * rate)


def carry(slots: Slots, parameters: Vector, step: Vector) -> float:
    """Has a stage begin with a torque that is its law's, and D more.

    Args:
        slots: of its parameters.
        parameters: of the stage.
        step: (n,) D [N m]; one that is not finite is not carried.

    Returns:
        max|D_j| of what is carried [N m].
    """
    most = float(np.max(np.abs(step)))
    if not 0.0 < most < np.inf:
        return 0.0
    slots.write(parameters, _STEP, step)
    slots.write(parameters, _RATE, FADING / most)
    return most
