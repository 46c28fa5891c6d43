"""A loose body on the thread of a screw: caught at its start, then turned down it.

The screw is a mechanism whose travel is bound to its angle. A body whose centre has come to its
origin, with its axis along the screw's, is caught: springs and dampers hold it to the screw in six
directions, by the turn that it had as it was caught. Up to `CATCH` the thread only bears; a body
that is pulled off there is free again.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry.rotation import from_rpy
from taskspec.program.bound import Wiring
from taskspec.program.world.stiffness import RIGID_PHASE
from taskspec.spec import Mechanism, Shape
from taskspec_runner.plant.loose import solid_of
from taskspec_runner.plant.pads import Body

#: Whether it has caught the body, and the turn that the body had against the screw then [rad].
MEMORY = 2
#: A thread catches what is so near to its axis [m], and leans from it so little (sine).
_NEAR, _LEANS = 2e-3, 0.1
#: Up to this angle it does not hold against a pull [rad]; what has come off so far is free [m].
CATCH, _OFF = math.radians(10.0), 0.5e-3
_DAMPING = 0.7
#: Springs of the thread and of pads act on one light body: each is resolved as if it were lighter.
_SHARE = 3.0


@dataclass(frozen=True)
class Screwed:
    """What a thread does to a body in a step.

    Attributes:
        force, moment: (3,) on the body, about its centre, world axes [N, N m].
        on_screw: (2,) on the screw's travel and angle [N, N m].
        effort: what the body applies to its coordinate, the angle [N m].
        memory: (MEMORY,) after the step.
    """

    force: ca.SX
    moment: ca.SX
    on_screw: ca.SX
    effort: ca.SX
    memory: ca.SX


def _compliances(screw: Mechanism, shape: Shape, period: float) -> tuple[float, ...]:
    """Stiffness and damping along [N/m, N s/m], and about [N m/rad, N m s/rad]."""
    assert shape.mass is not None
    inertia = min(solid_of(shape).inertia(shape.mass))
    pairs = ((shape.mass, getattr(screw, "mass", 0.1)), (inertia, getattr(screw, "inertia", 1e-3)))
    found: list[float] = []
    for one, other in pairs:
        mass = one * other / (one + other) / _SHARE
        k = mass * (RIGID_PHASE / period) ** 2
        found += [k, 2 * _DAMPING * math.sqrt(k * mass)]
    return tuple(found)


def screw_on(
    screw: Mechanism,
    shape: Shape,
    body: Body,
    place: ca.SX,
    rate: ca.SX,
    memory: ca.SX,
    wiring: Wiring,
    name: str,
    period: float,
) -> Screwed:
    """A thread and the body that it takes, in a step of the plant.

    Args:
        screw, shape: of the two, as they truly are.
        body: at the step's start.
        place, rate: (2,) travel and angle of the screw [m, rad], and by the second.
        memory: (MEMORY,) before the step.
        wiring: of the function that it is part of.
        name: of the screw.
        period: of the step [s].
    """
    k, b, turning_k, turning_b = ca.vertsplit(
        wiring.numbers(f"thread_{name}", *_compliances(screw, shape, period))
    )
    axes = wiring.numbers(f"axes_{name}", *from_rpy(screw.rpy).ravel(order="F"))
    origin = wiring.numbers(f"origin_{name}", *screw.xyz)
    axes = ca.reshape(axes, 3, 3)
    z, caught = axes[:, 2], memory[0] > 0
    away = body.p - origin - z * place[0]
    along = ca.dot(z, away)
    across = away - z * along
    own = body.R[:, 2]
    own = ca.if_else(ca.dot(own, z) < 0, -own, own)
    lean = ca.cross(own, z)
    near = ca.logic_and(ca.sumsqr(across) < _NEAR**2, ca.sumsqr(lean) < _LEANS**2)
    loose = place[1] <= CATCH
    catches = ca.logic_and(ca.logic_and(near, along >= 0), loose)
    comes_off = ca.logic_and(loose, along < -_OFF)
    holds = ca.logic_and(ca.logic_or(caught, catches), ca.logic_not(comes_off))
    x = axes.T @ body.R[:, 0]
    turn = ca.atan2(x[1], x[0]) - place[1]
    begun = ca.if_else(caught, memory[1], turn)
    turn = ca.atan2(ca.sin(turn - begun), ca.cos(turn - begun))
    v = body.v - z * rate[0]
    bears = -k * along - b * ca.dot(z, v)
    bears = ca.if_else(loose, ca.if_else(along > 0, ca.fmin(bears, 0.0), 0.0), bears)
    force = -k * across - b * (v - z * ca.dot(z, v)) + z * bears
    moment = turning_k * (lean - turn * z) - turning_b * (body.w - z * rate[1])
    force, moment = (ca.if_else(holds, part, 0.0) for part in (force, moment))
    on_screw = -ca.vertcat(ca.dot(z, force), ca.dot(z, moment))
    return Screwed(
        force=force,
        moment=moment,
        on_screw=on_screw,
        effort=on_screw[1] + screw.lead * on_screw[0],
        memory=ca.vertcat(holds, ca.if_else(holds, begun, 0.0)),
    )


def start() -> np.ndarray:
    """(MEMORY,) of a thread that has caught nothing."""
    return np.zeros(MEMORY)
