"""The difference of the last stage's command to this one's, as it fades.

Two laws command different torques for the same measurement, or different velocities. The difference
as a stage begins, D, is added to what its law commands, and fades,

    u = u_law + D max(0, 1 - t/T_f),    1/T_f = min(fading / max|D_j|, fades),

with both of the arm's `Drives`, so that the command goes on without a step. D is chosen once
and is over after T_f: the closed loop, and so its stability, is that of the law alone. It comes
before saturation and before the program, so that all limits hold for the sum.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

from taskspec.program.clock import Clock
from taskspec.program.slots import Slots

#: Slots of D and of 1/T_f.
STEP, RATE = "carried_torque", "carried_torque.rate"


def fading(parameters: Slots, clock: Clock, joints: int) -> ca.SX:
    """D max(0, 1 - t/T_f) of a stage (n,) [N m]; takes the slots of D and of 1/T_f."""
    step, rate = parameters.add(STEP, joints), parameters.add(RATE)
    return step * ca.fmax(0, 1 - clock.t * rate)


@cache
def carrying(joints: int, fading: float, fades: float) -> ca.Function:
    """Command to go on from (n,), that of the law's closed form (n,) -> D, 1/T_f, max|D_j|.

    D fades at a rate of `fading` in the joint that has most to fade, and by a share of `fades` a
    second, whichever is slower. Of a step that is not finite nothing is carried.
    """
    last, own = ca.SX.sym("last", joints), ca.SX.sym("own", joints)
    step = last - own
    most = ca.mmax(ca.fabs(step))
    carried = ca.logic_and(most > 0, ca.sumsqr(step) < ca.inf)
    rate = ca.fmin(fading / most, fades) if math.isfinite(fades) else fading / most
    results = [ca.if_else(carried, value, 0) for value in (step, rate, most)]
    return ca.Function("carry", [last, own], [ca.densify(value) for value in results])
