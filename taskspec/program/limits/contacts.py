"""The nominal contacts of a stage, as rows on the joints: what limits act on.

A row points in the direction in which the robot pushes: into the object. Its multiplier is what
the robot applies.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import casadi as ca
import numpy as np

from taskspec.control import linear
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.reference.constraints import EquationRow
from taskspec.program.world import kinematics
from taskspec.robot.model_terms import TermSymbols
from taskspec.shapes import Surface
from taskspec.signals.entries import TOUCHING

#: Closer than this [m] to the nominal object, the tool counts as touching it.
NEAR = 1e-3
#: However much other contacts bear, this share of a cap is left for each.
_LEAST_CAP_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class ContactRow:
    """One direction in which something of the world bears a force.

    Attributes:
        name: of the object or equation.
        J: (1, n) velocity into it per joint velocity.
        drift: J' q' [m/s^2].
        closing: velocity into it [m/s].
        active: whether it is there now, as an expression; 1 for what holds in both directions.
        measured: what the robot applies along it [N, N m].
        pressed: the stage keeps this contact: its force may not turn into a pull.
        both_ways: it returns forces of either sign.
        stiffness: nominal [N/m].
        angular: whether its multiplier is a moment [N m].
        friction: its coefficient.
        others: what the tip bears beside it, friction included: the part along this row, and the
            size [N].
    """

    name: str
    J: ca.SX
    drift: ca.SX
    closing: ca.SX
    active: ca.SX
    measured: ca.SX
    pressed: bool
    both_ways: bool
    stiffness: float
    angular: bool = False
    friction: float = 0.0
    others: tuple[ca.SX, ca.SX] = (ca.SX(0), ca.SX(0))

    def highest(self, cap: float) -> ca.SX:
        """The push [N] with which all that the tip bears, friction included, is the cap.

        With friction forces are within phi = atan mu of the normals, so that this contact's, of the
        size p sqrt(1 + mu^2), and the others' F are no closer to each other than their normals are,
        less 2 phi: p^2 (1 + mu^2) + 2 p sqrt(1 + mu^2) |F| cos(angle - 2 phi) + |F|^2 = cap^2.
        """
        along, size = self.others
        turn = 2 * np.arctan(self.friction)
        across = ca.sqrt(ca.fmax(size**2 - along**2, 0))
        along = np.cos(turn) * along + np.sin(turn) * across
        left = ca.sqrt(ca.fmax(along**2 + cap**2 - size**2, 0)) - along
        return ca.fmax(left, _LEAST_CAP_SHARE * cap) / np.sqrt(1 + self.friction**2)


def all_objects(context: Context, first: Sequence[str]) -> tuple[str, ...]:
    """Objects `first`, then the others that the tool may touch; none where there is no first."""
    carried = context.loaded.task.carried
    if not first:
        return ()
    return (*first, *(o for o in context.surfaces if o not in first and o not in carried))


def shape_rows(
    context: Context,
    objects: Sequence[str],
    pressed: Collection[str],
    terms: TermSymbols,
    wrench: ca.SX,
    gaps: Mapping[str, ca.SX],
    clock: ca.SX,
) -> list[ContactRow]:
    """Rows of the touched shapes, at the point of the tool that is nearest to each.

    Args:
        context: of the task.
        objects: touched, the nominal contact first.
        pressed: of them.
        terms: the tip's kinematics in the world.
        wrench: (6,) by the environment on the tip.
        gaps: to every shape [m].
        clock: of the run [s].
    """
    center = _center(context)
    found, normals = [], []
    for name in objects:
        base = context.moving_bases.get(name)
        now = base.at(clock) if base is not None else None
        terms_now = terms if now is None else now.relative(terms)
        at = kinematics.control_point(terms_now, wrench, center)
        normal, turning = _normal(context.surfaces[name], at)
        found.append((at, normal, turning))
        normals.append(normal if now is None else now.A @ normal)
    touching = ca.norm_2(wrench[:3]) > TOUCHING
    active = [gaps[name] < NEAR for name in objects]
    active[:1] = [ca.logic_or(near, touching) for near in active[:1]]
    # What does not touch takes no share of the measured force.
    shares = shared_force([n * on for n, on in zip(normals, active, strict=True)], wrench[:3])
    rubs = [context.loaded.task.shapes[name].friction for name in objects]
    rows = []
    for i, (name, (at, normal, turning)) in enumerate(zip(objects, found, strict=True)):
        other = ca.SX.zeros(3)
        for j, (n, mu) in enumerate(zip(normals, rubs, strict=True)):
            if j != i:
                other += n * np.hypot(1, mu) * ca.fmax(shares[j], 0)
        rows.append(
            ContactRow(
                name=name,
                J=-normal.T @ at.J[:3, :],
                drift=-ca.dot(normal, at.drift[:3]) - ca.dot(turning, at.twist[:3]),
                closing=-ca.dot(normal, at.twist[:3]),
                active=active[i],
                measured=shares[i],
                pressed=name in pressed,
                both_ways=False,
                stiffness=context.compliances[name].stiffness,
                friction=max(rubs),
                others=(ca.dot(normals[i], other), ca.norm_2(other)),
            )
        )
    return rows


def _normal(surface: Surface, at: kinematics.ControlPoint) -> tuple[ca.SX, ca.SX]:
    """Outward normal (3,) at a point of the tool, and its rate as the point moves [1/s]."""
    p, v = ca.SX.sym("p", 3), ca.SX.sym("v", 3)
    normal = surface.gradient(p)
    moving = ca.Function("normal", [p, v], [normal, ca.jtimes(normal, p, v)])
    found: tuple[ca.SX, ca.SX] = moving(at.p, at.twist[:3])
    return found


def _center(context: Context) -> ca.SX | None:
    tool = context.robot.tool
    return None if tool.flat else ca.SX(ca.DM(tool.centers[0]))


def shared_force(normals: Sequence[ca.SX], force: ca.SX) -> ca.SX:
    """Force that the robot applies along each inward normal (c,), of the measured force (3,)."""
    if not normals:
        return ca.SX(0, 1)
    N = ca.horzcat(*normals).T
    gram = N @ N.T + 1e-9 * ca.SX.eye(len(normals))
    return linear.solve(linear.cholesky(gram), N @ force)


def pushing(row: EquationRow) -> float:
    """The sign, along an equation's gradient, of what the robot pushes against it with."""
    return -1.0 if row.model.constraint.relation == ">=" else 1.0


def equation_contact(row: EquationRow, name: str, measured: ca.SX, stiffness: float) -> ContactRow:
    """The row of an equation that constrains the stage, turned so that it may push.

    Args:
        row: the equation.
        name: its name.
        measured: what the robot applies along its gradient.
        stiffness: nominal [N/m, N m/rad]; without bounds where it holds exactly.
    """
    relation, sign = row.model.constraint.relation, pushing(row)
    return ContactRow(
        name=name,
        J=sign * row.J,
        drift=sign * row.gamma,
        closing=sign * row.closing,
        active=ca.SX(1),
        measured=sign * measured,
        pressed=relation != "=",
        both_ways=relation == "=",
        stiffness=stiffness,
        angular=row.model.angular,
    )
