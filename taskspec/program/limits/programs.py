"""The two programs of a stage under `solve: qp`, as expressions: its limits, and nearest forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from taskspec.control.qp import check_solver
from taskspec.geometry.axis import Axis
from taskspec.program import signals
from taskspec.program.context import Context
from taskspec.program.limits.bounds import TorqueRange
from taskspec.program.limits.consistency import (
    Generator,
    Requests,
    consistency,
    equation_generator,
    grip_generators,
    wrench_generators,
)
from taskspec.program.limits.contacts import (
    ContactRow,
    all_objects,
    equation_contact,
    pushing,
    shape_rows,
)
from taskspec.program.limits.limited import limit_rows
from taskspec.program.limits.resolution import Resolved
from taskspec.program.plan import StagePlan
from taskspec.program.reference.measurement import Measurement
from taskspec.program.world import kinematics

#: The parameter with the command of the tick before.
LAST_COMMAND = "last_torque"


def resolve(
    plan: StagePlan,
    measurement: Measurement,
    requested: Mapping[str, ca.SX],
    wanted: ca.SX,
) -> Resolved:
    """The two programs of a stage, as expressions.

    Args:
        plan: of the stage.
        measurement: what it measures.
        requested: force set points by name, before anything is taken from them.
        wanted: (n,) torque of the closed form.
    """
    context = plan.context
    names = tuple(requested)
    objects = plan.contacts.touched
    limits, inputs, clock = plan.limits, measurement.inputs, measurement.clock.clock
    n = context.robot.n
    active = {name: measurement.rows[name] for name in plan.active}
    # A limit on the contact force is one on that of every object that the tool may touch.
    capped = objects if limits.force is None else all_objects(context, objects)
    pressed, gaps = plan.contacts.pressed, measurement.gaps
    contacts = shape_rows(context, capped, pressed, measurement.world, inputs.wrench, gaps, clock)
    on_equations = [
        equation_contact(
            row, name, measurement.reactions[name], context.compliances[name].stiffness
        )
        for name, row in active.items()
    ]
    axes = [name for name in names if name in plan.plans]
    requests = Requests(
        names=names,
        rows=ca.vertcat(
            ca.SX(0, n),
            *(measurement.state.J[measurement.state.rows([a])[0], :] for a in axes),
            *(row.J for row in active.values()),
        ),
        values=ca.vertcat(ca.SX(0, 1), *requested.values()),
    )
    last = measurement.parameters.add(LAST_COMMAND, n) if limits.torque_rate is not None else None
    limited = limit_rows(
        context=context,
        limits=limits,
        state=measurement.state,
        terms=measurement.world,
        contacts=[*contacts, *on_equations],
        requests=requests.rows,
        wanted=wanted,
        last=last,
        q=inputs.q,
        v=inputs.v,
        environment=_environment(context, measurement),
    )
    check_solver(plan.law.solver)
    generators = _generators(plan, measurement, requests, axes, objects, on_equations)
    nearest = consistency(context, limits, requests, generators, measurement.world.gravity)
    rate = np.inf if limits.torque_rate is None else limits.torque_rate
    torques = TorqueRange(context.robot.torque_limit, rate * context.period)
    return Resolved(plan.law.solver, torques, requests, limited, nearest)


def _environment(context: Context, measurement: Measurement) -> ca.SX:
    """Torque (n,) that the environment exerts on the joints, as far as it is measured."""
    v = measurement.inputs.v
    torque = measurement.world.J.T @ measurement.inputs.wrench
    for name, row in measurement.rows.items():
        if row.model.joints:
            torque -= row.J.T * measurement.reactions[name]
    damping = np.broadcast_to(context.loaded.task.robot.joint_damping, v.shape[0])
    return torque - ca.DM(damping) * v


def _generators(
    plan: StagePlan,
    measurement: Measurement,
    requests: Requests,
    axes: Sequence[str],
    objects: Sequence[str],
    equations: Sequence[ContactRow],
) -> list[Generator]:
    context = plan.context
    base, offset = measurement.moving_base, measurement.point.offset
    turned = measurement.at.R if base is None else base.A @ measurement.at.R
    offset = offset if base is None else base.A @ offset
    world, about = measurement.world, measurement.world.p + offset
    count = len(requests.names)
    resolve_axes = ca.SX.zeros(count, 6)
    towards = ca.SX.zeros(3)
    for i, name in enumerate(axes):
        direction = turned[:, "xyz".index(name[-1])]
        if Axis(name).is_rotation:
            resolve_axes[i, 3:] = direction.T
        else:
            resolve_axes[i, :3] = direction.T
            towards += direction * requests.values[i]
    found: list[Generator] = []
    if axes and plan.contacts.gripped:
        at = kinematics.control_point(world, measurement.inputs.wrench, None)
        J = ca.vertcat(at.J[:3, :] - ca.skew(offset) @ at.J[3:, :], at.J[3:, :])
        found += grip_generators(resolve_axes, J)
    elif axes:
        tool = context.robot.tool
        points = [world.p + world.R @ ca.DM(center) for center in tool.centers]
        middle = kinematics.tool_point(context.robot, world).center
        normals = [
            signals.normal(
                context.surfaces[o], middle, context.moving_bases, o, measurement.clock.clock
            )
            for o in objects
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
    if plan.law.control_law.multipliers:
        for k, contact in enumerate(equations):
            effect = ca.SX.zeros(count)
            effect[len(axes) + k] = pushing(measurement.rows[contact.name])
            found.append(equation_generator(contact, effect))
    return found
