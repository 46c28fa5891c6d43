"""The two programs of a stage under `solve: qp`, as expressions: its limits, and nearest forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from taskspec.control import linear
from taskspec.control.qp import check_solver
from taskspec.geometry.axis import Axis
from taskspec.laws.design import GAIN_MARGIN
from taskspec.laws.gains import Gains, on_axis
from taskspec.laws.servo_loop import Contact
from taskspec.program import signals
from taskspec.program.context import Context
from taskspec.program.last_commands import last_command, last_velocity
from taskspec.program.limits.bounds import CommandRange
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
from taskspec.program.limits.limited import LimitRows, limit_rows
from taskspec.program.limits.resolution import Resolved
from taskspec.program.limits.velocities import (
    Commands,
    Pressed,
    joint_metric,
    task_metric,
    velocity_rows,
)
from taskspec.program.plan import StagePlan
from taskspec.program.reference.measurement import Measurement
from taskspec.program.world import kinematics
from taskspec.robot.inverse_kinematics import turns_at


def resolve(
    plan: StagePlan,
    measurement: Measurement,
    requested: Mapping[str, ca.SX],
    wanted: ca.SX,
    gains: Gains,
) -> Resolved:
    """The two programs of a stage, as expressions.

    Args:
        plan: of the stage.
        measurement: what it measures.
        requested: force set points by name, before anything is taken from them.
        wanted: (n,) torque or velocity of the closed form.
        gains: of the stage, as its tick has them.
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
    contacts = shape_rows(context, capped, pressed, measurement.world, inputs.contact, gaps, clock)
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
    if plan.law.control_law.commands == "velocity":
        limited, most = _velocities(
            plan, measurement, requests, wanted, gains, contacts, on_equations
        )
    else:
        limited, most = _torques(plan, measurement, requests, wanted, [*contacts, *on_equations])
    check_solver(plan.law.solver)
    generators = _generators(plan, measurement, requests, axes, objects, on_equations)
    nearest = consistency(context, limits, requests, generators, measurement.world.gravity)
    return Resolved(plan.law.solver, most, requests, limited, nearest)


def _torques(
    plan: StagePlan,
    measurement: Measurement,
    requests: Requests,
    wanted: ca.SX,
    contacts: Sequence[ContactRow],
) -> tuple[LimitRows, CommandRange]:
    """The limits of a stage whose law commands torques."""
    context, limits, inputs = plan.context, plan.limits, measurement.inputs
    n, rate = context.robot.n, np.inf
    last = None
    if limits.torque_rate is not None:
        last, rate = last_command(context, measurement.parameters), limits.torque_rate
    limited = limit_rows(
        context=context,
        limits=limits,
        state=measurement.state,
        terms=measurement.world,
        contacts=contacts,
        requests=requests.rows,
        wanted=wanted,
        last=last,
        q=inputs.q,
        v=inputs.v,
        environment=_environment(context, measurement),
    )
    step = np.full(n, rate * context.period)
    return limited, CommandRange(context.robot.torque_limit, step)


def _velocities(
    plan: StagePlan,
    measurement: Measurement,
    requests: Requests,
    wanted: ca.SX,
    gains: Gains,
    contacts: Sequence[ContactRow],
    equations: Sequence[ContactRow],
) -> tuple[LimitRows, CommandRange]:
    """The limits of a stage whose law commands velocities.

    Of an arm that takes positions, it is what they are commanded to be that keeps their limits.
    """
    context, law = plan.context, plan.law.control_law
    drives, period, n = context.drives, context.period, context.robot.n
    assert drives.timing is not None
    loops = [law.loop_damping(on_axis(gains, name)) for name in requests.names]
    at, unit = measurement.inputs.q, 1.0
    most = CommandRange(drives.most, drives.rates * period)
    if drives.positions:
        at, unit = last_command(context, measurement.parameters), period
        most = CommandRange(np.full(n, np.inf), drives.most * period)
    state = measurement.state
    turns = [turns_at(context.robot, i) for i in range(n)]
    # As heavy as the arm may be: what gives way beside the contact only takes from the loop.
    heavy = max((plan.design_rules.plants[a].held for a in plan.translations), default=1.0)
    pressed = [
        Pressed(
            row,
            GAIN_MARGIN * drives.timing.along(heavy, Contact(row.stiffness)).least_damping()[0],
            measurement.gaps[row.name],
        )
        for row in contacts
    ]
    pressed += [Pressed(row, law.loop_damping(on_axis(gains, row.name)), None) for row in equations]
    limited = velocity_rows(
        context=context,
        limits=plan.limits,
        metric=task_metric(state) if plan.joint_path is None else joint_metric(turns),
        L=state.H_factor,
        terms=measurement.world,
        pressed=pressed,
        requests=ca.diag(linear.column(loops)) @ requests.rows if loops else requests.rows,
        commands=Commands(wanted, last_velocity(context, measurement.parameters), at, unit),
        v=measurement.inputs.v,
    )
    return limited, most


def _environment(context: Context, measurement: Measurement) -> ca.SX:
    """Torque (n,) that the environment exerts on the joints, as far as it is measured."""
    v = measurement.inputs.v
    torque = measurement.world.J.T @ measurement.inputs.contact
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
        at = kinematics.control_point(world, measurement.inputs.contact, None)
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
