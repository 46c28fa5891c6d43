"""A stage under `solve: qp`: its two programs as functions, and what to make of their answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from taskspec.control.model_terms import TermSymbols
from taskspec.control.state import TaskState
from taskspec.program import kinematics, signals
from taskspec.program.bounds import Row
from taskspec.program.carriers import Instant
from taskspec.program.consistency import (
    Consistency,
    Generator,
    Requests,
    consistency,
    equation_generator,
    grip_generators,
    wrench_generators,
)
from taskspec.program.constraints import EquationRow
from taskspec.program.contacts import (
    ContactRow,
    all_objects,
    equation_contact,
    pressed_objects,
    pushing,
    shape_rows,
    touched_objects,
)
from taskspec.program.context import Context
from taskspec.program.layout import Layout
from taskspec.program.limited import LimitRows, limit_rows, matrices
from taskspec.program.modes import AxisPlan
from taskspec.robot import RobotModel
from taskspec.spec import LAWS, Law, Limits

#: Outputs of `assemble`, in order; matrices are given by rows.
ASSEMBLED = ("P", "A", "factor", "requests")
#: Outputs of `look`, in order; matrices are given by rows.
LOOKED = ("P", "g", "A", "lower", "upper", "effect", "values")


@dataclass(frozen=True, slots=True)
class Resolution:
    """How a stage's torque follows from what its law asks for, where limits are in the way.

    Attributes:
        solver: `daqp` or `osqp`. rows: the m limits. requested: names of the r force set points.
        handed: length of the pieces that the tick hands over, before lower and upper.
        assemble: these pieces -> `ASSEMBLED`.
        accept: `ASSEMBLED`, lower, upper, u* (n,), x (n,), dual (m,) -> torque (n,), KKT residual,
            sum of 2^i over the limits i that bind, what limits take from each request (r,).
        look: the tick's inputs -> `LOOKED`; None where nothing is requested of a contact.
        generators: how many of them there are. conditions: on their sizes, in words.
    """

    solver: str
    rows: tuple[Row, ...]
    requested: tuple[str, ...]
    handed: int
    assemble: ca.Function
    accept: ca.Function
    look: ca.Function | None
    generators: int
    conditions: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Seen:
    """What of a stage its programs are made from.

    Attributes:
        axes_rotation: (3, 3) the stage's frame at the start pose. contact: the believed one.
        gripped: whether a grip returns its forces. state: the arm on the task axes, geometric.
        world: model terms. wrench: (6,) measured, by the environment on the tip, world.
        point: the control point. R: (3, 3) the frame; both against `carrier` where it has one.
        rows: the equations that constrain the stage. measured: on every equation of the world.
        equations: all of them.
    """

    axes_rotation: np.ndarray
    contact: str | None
    gripped: bool
    state: TaskState
    world: TermSymbols
    wrench: ca.SX
    point: kinematics.ControlPoint
    R: ca.SX
    carrier: Instant | None
    rows: Mapping[str, EquationRow]
    measured: Mapping[str, ca.SX]
    equations: Mapping[str, EquationRow]


@dataclass(frozen=True, slots=True)
class Resolved:
    """The programs of a stage as expressions.

    Attributes:
        solver: by name. requests: the stage's force set points. limits: what binds the torque.
        nearest: the forces that contacts return; None where nothing is asked of one.
    """

    solver: str
    requests: Requests
    limits: LimitRows
    nearest: Consistency | None

    @property
    def handed_over(self) -> ca.SX:
        """What the tick hands over to its program: pieces, lower, upper, and the cut of pushes."""
        limits = self.limits
        return ca.densify(ca.vertcat(limits.pieces.flat(), limits.lower, limits.upper, limits.cut))

    @property
    def told(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """How far the torque is beyond its limits, the clamped pushes, and `unsettled`."""
        return self.limits.violation, self.limits.clamped, self.unsettled

    @property
    def unsettled(self) -> ca.SX:
        """Whether the nearest forces have to be looked for."""
        return ca.SX(0) if self.nearest is None else self.nearest.needed

    def compiled(self, arguments: Sequence[ca.SX]) -> Resolution:
        """The programs as functions of the tick's inputs."""
        limits, nearest, look = self.limits, self.nearest, None
        if nearest is not None:
            asked = (
                nearest.P,
                nearest.g,
                nearest.A.T,
                nearest.lower,
                nearest.upper,
                nearest.effect.T,
                self.requests.values,
            )
            look = _flat("look", arguments, asked)
        pieces = limits.pieces.symbols()
        made = matrices(limits.sources, pieces)
        handed = pieces.flat()
        m, n = made.A.shape
        return Resolution(
            solver=self.solver,
            rows=limits.rows,
            requested=self.requests.names,
            handed=handed.shape[0],
            assemble=_flat("assemble", [handed], (made.P, made.A.T, pieces.L.T, made.requests.T)),
            accept=_accept(n, m, len(self.requests.names)),
            look=look,
            generators=0 if nearest is None else nearest.g.shape[0],
            conditions=() if nearest is None else nearest.texts,
        )


def _flat(name: str, arguments: Sequence[ca.SX], parts: Sequence[ca.SX]) -> ca.Function:
    """A function whose results are dense vectors, matrices column by column."""
    return ca.Function(name, arguments, [ca.vec(ca.densify(p)) for p in parts], {"cse": True})


def resolve(
    *,
    context: Context,
    law: Law,
    limits: Limits,
    plans: Mapping[str, AxisPlan],
    seen: Seen,
    asked: Mapping[str, ca.SX],
    gaps: Mapping[str, ca.SX],
    wanted: ca.SX,
    clock: ca.SX,
    q: ca.SX,
    v: ca.SX,
    parameters: Layout,
) -> Resolved:
    """The two programs of a stage, as expressions.

    Args:
        context, law, limits, plans: of the stage. seen: its expressions.
        asked: force set points by name, before anything is taken from them.
        gaps: to every shape. wanted: (n,) torque of the closed form. clock: of the run [s].
        q, v: (n,) measured. parameters: where the last torque takes its slot.
    """
    names = tuple(asked)
    objects = touched_objects(context, seen.contact, plans, seen.axes_rotation)
    pressed = pressed_objects(context, objects, plans, seen.axes_rotation)
    n = q.shape[0]
    # A limit on the contact force is one on that of every object that the tool may touch.
    capped = objects if limits.force is None else all_objects(context, objects)
    contacts = shape_rows(context, capped, pressed, seen.world, seen.wrench, gaps, clock)
    on_equations = [
        equation_contact(row, name, seen.measured[name], context.compliances[name].stiffness)
        for name, row in seen.rows.items()
    ]
    axes = [name for name in names if name in plans]
    requests = Requests(
        names=names,
        rows=ca.vertcat(
            ca.SX(0, n),
            *(seen.state.J[seen.state.rows([a])[0], :] for a in axes),
            *(row.J for row in seen.rows.values()),
        ),
        values=ca.vertcat(ca.SX(0, 1), *asked.values()),
    )
    last = parameters.add("last_torque", n) if limits.torque_rate is not None else None
    limited = limit_rows(
        context=context,
        limits=limits,
        state=seen.state,
        terms=seen.world,
        contacts=[*contacts, *on_equations],
        requests=requests.rows,
        wanted=wanted,
        last=last,
        q=q,
        v=v,
        environment=_environment(context, seen, v),
    )
    generators = _generators(context, law, seen, requests, axes, objects, on_equations, clock)
    nearest = consistency(context, limits, requests, generators, seen.world.gravity)
    return Resolved(law.solver, requests, limited, nearest)


def _environment(context: Context, seen: Seen, v: ca.SX) -> ca.SX:
    """Torque (n,) that the environment exerts on the joints, as far as it is measured."""
    torque = seen.world.J.T @ seen.wrench
    for name, row in seen.equations.items():
        if row.model.joints:
            torque -= row.J.T * seen.measured[name]
    damping = np.broadcast_to(context.loaded.task.robot.joint_damping, v.shape[0])
    return torque - ca.DM(damping) * v


def _generators(
    context: Context,
    law: Law,
    seen: Seen,
    requests: Requests,
    axes: Sequence[str],
    objects: Sequence[str],
    equations: Sequence[ContactRow],
    clock: ca.SX,
) -> list[Generator]:
    turned = seen.R if seen.carrier is None else seen.carrier.A @ seen.R
    offset = seen.point.offset if seen.carrier is None else seen.carrier.A @ seen.point.offset
    world, about = seen.world, seen.world.p + offset
    count = len(requests.names)
    resolve_axes = ca.SX.zeros(count, 6)
    towards = ca.SX.zeros(3)
    for i, name in enumerate(axes):
        direction = turned[:, "xyz".index(name[-1])]
        if name.startswith("r"):
            resolve_axes[i, 3:] = direction.T
        else:
            resolve_axes[i, :3] = direction.T
            towards += direction * requests.values[i]
    found: list[Generator] = []
    if axes and seen.gripped:
        at = kinematics.control_point(world, seen.wrench, None)
        J = ca.vertcat(at.J[:3, :] - ca.skew(offset) @ at.J[3:, :], at.J[3:, :])
        found += grip_generators(resolve_axes, J)
    elif axes:
        tool = context.robot.tool
        points = [world.p + world.R @ ca.DM(center) for center in tool.centers]
        middle = kinematics.tool_point(context.robot, world).center
        normals = [
            signals.normal(context.surfaces[o], middle, context.carriers, o, clock) for o in objects
        ]
        found += wrench_generators(
            context=context,
            objects=objects,
            normals=normals,
            points=points,
            about=about,
            tip=world.p,
            J=world.J,
            resolve=resolve_axes,
            requested=towards,
        )
    if LAWS[law.kind].multipliers:
        for k, contact in enumerate(equations):
            effect = ca.SX.zeros(count)
            effect[len(axes) + k] = pushing(seen.rows[contact.name])
            found.append(equation_generator(contact, effect))
    return found


def _accept(n: int, m: int, r: int) -> ca.Function:
    """What an answer x with its multipliers y means, and how far it is from optimal.

    The residual is the largest of stationarity |P x + A'y| over max(1, |P x|), of violation
    |A x beyond its bounds| over max(1, |A x|), and of complementarity |y (A x - bound)| over
    max(1, x'P x).
    """
    P, A_rows = ca.SX.sym("P", n, n), ca.SX.sym("A", n, m)
    lower, upper = ca.SX.sym("l", m), ca.SX.sym("u", m)
    factor, requests = ca.SX.sym("L", n, n), ca.SX.sym("requests", n, r)
    torque, x, y = ca.SX.sym("torque", n), ca.SX.sym("x", n), ca.SX.sym("y", m)
    Px, at, zero = P @ x, A_rows.T @ x, ca.SX(0)
    above, below = at - upper, lower - at
    slack = [
        ca.if_else(y[i] > 0, y[i] * above[i], ca.if_else(y[i] < 0, y[i] * below[i], 0))
        for i in range(m)
    ]
    largest = [
        ca.mmax(ca.fabs(ca.vertcat(zero, part)))
        for part in (Px, at, Px + A_rows @ y, ca.vertcat(*slack))
    ]
    beyond = ca.mmax(ca.vertcat(zero, above, below))
    residual = ca.fmax(
        ca.fmax(largest[2] / ca.fmax(1, largest[0]), beyond / ca.fmax(1, largest[1])),
        largest[3] / ca.fmax(1, ca.dot(x, Px)),
    )
    binding = ca.sum1(ca.vertcat(zero, *(2**i * (y[i] != 0) for i in range(m))))
    given = (P, A_rows, factor, requests, lower, upper)
    return ca.Function(
        "accept",
        [*(ca.vec(part) for part in given), torque, x, y],
        [torque + factor.T @ x, residual, binding, ca.densify(requests.T @ x)],
        {"cse": True},
    )


def saturated(robot: RobotModel, wanted: ca.SX) -> ca.SX:
    """Torque (n,) as the actuators make it of what a closed form asks for."""
    limit = ca.DM(robot.torque_limit)
    return ca.fmax(ca.fmin(wanted, limit), -limit)
