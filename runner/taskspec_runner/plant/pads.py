"""Pads of a gripper on a loose body: two contacts that press, stick, and slip at mu N.

The jaws are coupled and have one motor: they meet the body with the distance between them that its
width leaves, then press with a force N that rises at their speed times the stiffness, up to what is
commanded. Along the axis n on which they close, the body is off their middle by delta; its pads at
+n and -n press with

    N_+- = N +- clip(k delta + b delta', -N, N),    N_+ + N_- = 2 N.

Each pad of radius R is a soft finger: a force f across n and a moment tau about it, which the body
exerts on the pad by a displacement z and a turn theta that are left of what it has slid,

    f = k z + b z',    tau = k R^2/2 theta + b R^2/2 theta',

within the limit surface of a round contact under even pressure (Howe and Cutkosky, 1996),

    (f / mu N_i)^2 + (tau / mu N_i r)^2 <= 1,    r = 2/3 R.

Beyond it, both shrink by the same ratio, and z and theta to what makes them: the rest has slipped.
A flat face rocks on a pad against k R^2/4 by the angle, and at most against N_i times a lever, the
radius or half of the face.

The pads are springs of one body, so the plant resolves no more than `RIGID_PHASE` of its
oscillation in a step. The light body's turns are the fastest: of a cylinder about its axis h^2 is
twice the radius of gyration's, of a bar about its end three times, by which the mass is divided.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program.bound import Wiring
from taskspec.program.world.stiffness import RIGID_PHASE, pair_compliance
from taskspec.spec import Shape
from taskspec.spec.gripper import Gripper
from taskspec_runner.plant.loose import solid_of

#: Numbers that a gripper remembers of a body: distance between the jaws, N, whether they hold it,
#: how far it has slipped, the last command, and of the pads at +n and -n: z (3), in the tool's
#: axes, and theta.
MEMORY = 13
_JAWS, _PRESSES, _HOLDS, _SLIPPED, _COMMAND, _FIRST = 0, 1, 2, 3, 4, 5
#: Of critical, at the stiffness that a step resolves.
_DAMPING = 0.7
#: Turns of a body may be as fast as its shifts would be with a mass that many times smaller.
_TURNS = 3.0
#: Of the radius of a pad: the radius at which even pressure has its friction moment.
_TORSION = 2.0 / 3.0
#: A pad that presses less than this has no friction [N].
_LEAST = 1e-6


@dataclass(frozen=True)
class Body:
    """A body at an instant: place (3,), axes (3, 3), velocity and rate (3,), world axes."""

    p: ca.SX
    R: ca.SX
    v: ca.SX
    w: ca.SX

    def velocity(self, point: ca.SX) -> ca.SX:
        """(3,) of a point (3,) that moves with it."""
        return self.v + ca.cross(self.w, point - self.p)


@dataclass(frozen=True)
class PadForces:
    """What pads do to a body in a step.

    Attributes:
        force, moment: (3,) on the body, and about its centre, world axes [N, N m].
        at_tip: (3,) the moment of that force about the tip, with `moment`'s couple [N m].
        memory: (MEMORY,) after the step.
        presses, slipped: what the gripper reports [N, m].
    """

    force: ca.SX
    moment: ca.SX
    at_tip: ca.SX
    memory: ca.SX
    presses: ca.SX
    slipped: ca.SX


def start(gripper: Gripper) -> np.ndarray:
    """(MEMORY,) of open jaws."""
    found = np.zeros(MEMORY)
    found[_JAWS] = gripper.stroke
    return found


def pad_numbers(shape: Shape, mobility: float, period: float) -> tuple[float, float, float]:
    """Stiffness and damping of a pad on a body [N/m, N s/m], and its friction.

    Args:
        shape: the loose body, as it truly is.
        mobility: of the tool, as MuJoCo counts it [1/kg].
        period: step of the plant [s].
    """
    assert shape.mass is not None
    mass = 1.0 / (1.0 / shape.mass + mobility) / _TURNS
    resolved = mass * (RIGID_PHASE / period) ** 2 / 2
    k = min(pair_compliance(shape, mass, period).stiffness, resolved)
    return k, _DAMPING * math.sqrt(2 * k * mass), shape.friction


def hold(
    gripper: Gripper,
    shape: Shape,
    tip: Body,
    body: Body,
    memory: ca.SX,
    command: ca.SX,
    wiring: Wiring,
    name: str,
    mobility: float,
    period: float,
) -> PadForces:
    """The pads on a body in a step of the plant.

    Args:
        gripper: as the file has it.
        shape: the body, as it truly is.
        tip, body: at the step's start.
        memory: (MEMORY,) before the step.
        command: what each jaw is commanded to press with [N].
        wiring: of the function that it is part of.
        name: of the body.
        mobility: of the tool, as MuJoCo counts it [1/kg].
        period: of the step [s].
    """
    solid, R = solid_of(shape), gripper.pad
    k, b, friction = ca.vertsplit(
        wiring.numbers(f"pads_{name}", *pad_numbers(shape, mobility, period))
    )
    n = tip.R[:, gripper.row]
    own = body.R.T @ n
    half, delta = solid.support(own), ca.dot(n, body.p - tip.p)
    between = solid.height(body.R.T @ (tip.p + n * delta - body.p)) < 0
    # The jaws.
    jaws, pressed, holds, slipped, before = (memory[i] for i in range(_FIRST))
    closes = command > 0
    target = ca.if_else(closes, 0.0, gripper.stroke)
    step = gripper.speed * period
    moved = jaws + ca.fmax(-step, ca.fmin(step, target - jaws))
    meets = ca.logic_and(jaws >= 2 * half, moved <= 2 * half)
    rise = 0.5 * k * step
    N = pressed + ca.fmax(-rise, ca.fmin(rise, command - pressed))
    held = ca.logic_and(
        between,
        ca.logic_or(ca.logic_and(meets, closes), ca.logic_and(holds > 0, N > 0)),
    )
    N = ca.if_else(held, N, 0.0)
    # Along the axis.
    off = k * delta + b * ca.dot(n, body.velocity(tip.p) - tip.velocity(tip.p))
    off = ca.fmax(-N, ca.fmin(N, off))
    force, at_tip = -2 * off * n, ca.SX.zeros(3)
    # A flat face turns to the pads.
    flat = ca.vertcat(
        *(
            ca.fmax(-N * reach, ca.fmin(N * reach, k * R**2 / 4 * own[i]))
            for i, reach in enumerate(np.minimum(solid.half_sizes, R))
        )
    ) * solid.flat_along(own)
    couple = -2 * (body.R @ ca.cross(flat, own))
    kept, slips = [], []
    for i, side in enumerate((1.0, -1.0)):
        z, turned = memory[_FIRST + 4 * i :][:3], memory[_FIRST + 4 * i + 3]
        point = tip.p + n * (delta + side * half)
        rate = body.velocity(point) - tip.velocity(point)
        rate = rate - n * ca.dot(n, rate)
        spin = ca.dot(n, body.w - tip.w)
        z = z + period * (tip.R.T @ rate)
        turned = turned + period * spin
        f, tau = k * (tip.R @ z) + b * rate, R**2 / 2 * (k * turned + b * spin)
        most = friction * ca.fmax(N + side * off, 0.0)
        room = ca.fmax(most, _LEAST * friction + 1e-12)
        used = ca.sqrt(ca.sumsqr(f) / room**2 + (tau / (room * _TORSION * R)) ** 2)
        ratio = ca.if_else(most > 0, ca.fmin(1.0, 1.0 / ca.fmax(used, 1e-12)), 0.0)
        f, tau = ratio * f, ratio * tau
        beyond = used > 1
        left = ca.if_else(beyond, tip.R.T @ f / k, z)
        left_turn = ca.if_else(beyond, tau / (k * R**2 / 2), turned)
        slips.append(
            ca.sqrt(ca.sumsqr(z - left) + (_TORSION * R * (turned - left_turn)) ** 2 + 1e-24)
            - 1e-12
        )
        kept += [ca.if_else(held, left, 0.0), ca.if_else(held, left_turn, 0.0)]
        f, tau = (ca.if_else(held, x, 0.0) for x in (f, tau))
        force -= f
        couple -= tau * n
        at_tip -= ca.cross(point - tip.p, f)
    couple = ca.if_else(held, couple, 0.0)
    at_tip = at_tip + couple
    new = ca.logic_or(ca.logic_and(held, holds == 0), ca.logic_and(closes, command != before))
    # What slides as the jaws open has been let go.
    slips_now = ca.if_else(ca.logic_and(held, closes), 0.5 * (slips[0] + slips[1]), 0.0)
    slipped = ca.if_else(new, 0.0, slipped + slips_now)
    moment = at_tip + ca.cross(tip.p - body.p, force)
    return PadForces(
        force=force,
        moment=moment,
        at_tip=at_tip,
        memory=ca.vertcat(ca.if_else(held, 2 * half, moved), N, held, slipped, command, *kept),
        presses=N,
        slipped=slipped,
    )
