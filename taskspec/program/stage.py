"""A stage of the file as one fused function (design: the heart).

tick(time, state, model terms, measured wrench, memory, parameters) -> torque, memory', signals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import model_terms
from taskspec.control.gains import Gains, design, design_joint_damping, has_force
from taskspec.control.reference import opposite
from taskspec.control.state import AXES, task_state
from taskspec.motion.path import PathShape
from taskspec.program import kinematics, laws, ports, signals
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.program.axes import existing_axes
from taskspec.program.clock import Clock
from taskspec.program.conditions import limit_conditions, stage_conditions
from taskspec.program.context import Context
from taskspec.program.events import Event, code
from taskspec.program.frames import FrameModel
from taskspec.program.layout import Layout
from taskspec.program.modes import AxisPlan, plan_axes
from taskspec.program.references import build_references
from taskspec.program.signals import SignalTable
from taskspec.spec import LAWS, Law, Limits, Stage


@dataclass(frozen=True, slots=True)
class CompiledStage:
    """One stage, ready to be entered.

    Attributes:
        name: as in the file. spec: its entry there. law, limits: as they hold for it.
        frame: its task frame. axes: that exist in it. plans: who controls each of them.
        gains: with their origins. contact: the object that forces are believed to act on.
        stiffness: believed of that contact [N/m], 0 without one.
        path: its path, if any.
        memory, parameters: layouts of the two vectors.
        initial: memory slots that do not start at 0.
        events: what the event number means, 1-based.
        tick: the fused function.
        probe: at entry, the tick's inputs and a velocity -> the numbers of `PROBE`.
        own: at entry, the tick's inputs -> own(0) and own'(0) of every axis before blending.
    """

    name: str
    spec: Stage
    law: Law
    limits: Limits
    frame: FrameModel
    axes: tuple[str, ...]
    plans: Mapping[str, AxisPlan]
    gains: Gains
    contact: str | None
    stiffness: float
    path: PathShape | None
    memory: Layout
    parameters: Layout
    initial: Mapping[str, float]
    events: tuple[Event, ...]
    tick: ca.Function
    probe: ca.Function
    own: ca.Function


def compile_stage(
    context: Context, name: str, path: PathShape | None, axes_rotation: NDArray[np.float64]
) -> CompiledStage:
    """Compiles one stage.

    Args:
        context: what the stages share.
        name: the stage's name.
        path: its path in SI units, already restricted to the axes that it drives.
        axes_rotation: (3, 3) the stage's frame at the start pose.
    """
    task, robot = context.loaded.task, context.robot
    stage, n = task.stages[name], robot.pin.nv
    frame, law, limits = context.frame_of(stage), context.law_of(stage), context.limits_of(stage)
    axes = existing_axes(robot.axes, axes_rotation)
    contact = context.contact_of(frame)
    normal = None if contact is None else axes_rotation.T @ context.start_normals[contact]
    plans = plan_axes(axes, stage.axes, path, law, normal)
    k = context.compliances[contact].stiffness if contact is not None else 0.0
    plants = context.plants(axes, axes_rotation, k)
    gains = design(law, {a: p.axis for a, p in plans.items()}, plants)
    if LAWS[law.kind].damps_joints:
        stiffness = [
            gains["stiffness"][a].value + (plants[a].k if has_force(plans[a].axis) else 0.0)
            for a in axes
        ]
        joints = context.joint_plants(axes, axes_rotation, stiffness)
        gains["joint_damping"] = design_joint_damping(law, joints)

    visits = [f"{s}.visits" for s in task.stages]
    now, q, v = ca.SX.sym("now", 2 + len(visits)), ca.SX.sym("q", n), ca.SX.sym("v", n)
    terms = model_terms.symbols(robot, v)
    inputs = ports.Inputs(now, q, v, terms, ca.SX.sym("wrench", 6))
    memory, parameters = Layout("memory"), Layout("parameters")
    clock = Clock(now[0], now[1])
    algebra = CasadiAlgebra(memory, context.period)

    tool = kinematics.tool_point(robot, terms)
    offset = _control_offset(frame, parameters)
    point = kinematics.control_point(terms, inputs.wrench, offset)
    face = kinematics.new_face(parameters, frame, "frame")
    at = kinematics.frame_state(frame, terms, tool, face)
    state = task_state(
        axes=axes,
        H=terms.H,
        J=point.J,
        drift=point.drift,
        twist=point.twist,
        wrench=point.wrench,
        R=at.R,
        R_rate=at.R_rate,
    )
    gap = signals.gaps(robot, context.surfaces, terms.p, terms.R)
    table = SignalTable(
        {
            **constants({p: quantity.value for p, quantity in task.params.items()}),
            **{visit: now[2 + i] for i, visit in enumerate(visits)},
            **{f"{o}.gap": g for o, g in gap.items()},
            "t": clock.t,
            "clock": clock.clock,
        },
        axes,
        signals.Resolver(robot, context.frames, terms, tool, point, parameters),
    )
    if contact is not None:
        table.scalars["gap"] = gap[contact]
    _measured(table, context, inputs, point, at, parameters)

    references = build_references(
        context=context,
        frame=frame,
        at=at,
        tool=tool,
        point=point,
        terms=terms,
        state=state,
        plans=plans,
        gains=gains,
        path=path,
        gap=table.scalars.get("gap"),
        normal=_normal(context, contact, at, tool),
        stiffness=k,
        clock=clock,
        memory=memory,
        parameters=parameters,
        table=table,
        algebra=algebra,
    )
    case = laws.Case(state, references, plans, gains, table, v)
    posture = ca.SX(ca.DM(context.posture))
    wanted = laws.joint_torque(law.kind, case, terms, q, posture)
    limit = ca.DM(robot.torque_limit)
    torque = ca.fmax(ca.fmin(wanted, limit), -limit)
    table.scalars |= {f"joint.{i + 1}.torque": torque[i] for i in range(n)}
    conditions = limit_conditions(
        robot=robot,
        limits=limits,
        plans=plans,
        q=q,
        v=v,
        table=table,
        references=references,
        state=state,
        frame=frame,
        margin=at.margin,
    ) + stage_conditions(
        stage=stage, parameters=parameters, table=table, algebra=algebra, period=context.period
    )
    index, value, events = code(conditions)
    updates = references.updates | algebra.updates
    outputs = ports.outputs(index, value, wanted, inputs, point, at, table, references)
    arguments = [*inputs.symbols(), memory.vector(), parameters.vector()]
    options = {"cse": True}
    return CompiledStage(
        name=name,
        spec=stage,
        law=law,
        limits=limits,
        frame=frame,
        axes=axes,
        plans=plans,
        gains=gains,
        contact=contact,
        stiffness=k,
        path=path,
        memory=memory,
        parameters=parameters,
        initial=algebra.initial,
        events=events,
        tick=ca.Function("tick", arguments, [torque, memory.stack(updates), outputs], options),
        probe=ports.probe(arguments, table, references, at, tool, point),
        own=ca.Function("own", arguments, [references.own, references.own_rate]),
    )


def _normal(
    context: Context,
    contact: str | None,
    at: kinematics.FrameState,
    tool: kinematics.ToolPoint,
) -> ca.SX | None:
    """Outward unit normal (3,), world, of the believed contact at the tool."""
    if at.chart is not None:
        return at.R[:, 2]
    if contact is None:
        return None
    return context.surfaces[contact].gradient(tool.center)


def _control_offset(frame: FrameModel, parameters: Layout) -> ca.SX | None:
    if not frame.at_origin:
        return None
    if frame.kind == "tool":
        return ca.SX(ca.DM(frame.origin))
    return parameters.add("lever", 3)


def _measured(
    table: SignalTable,
    context: Context,
    inputs: ports.Inputs,
    point: kinematics.ControlPoint,
    at: kinematics.FrameState,
    parameters: Layout,
) -> None:
    """Puts the signals that follow from the measurement alone into the table."""
    wrench = opposite(point.wrench)
    local = ca.vertcat(at.R.T @ wrench[:3], at.R.T @ wrench[3:])
    twist = ca.vertcat(at.R.T @ point.twist[:3], at.R.T @ point.twist[3:])
    scalars = table.scalars
    scalars |= signals.wrench_signals(table.axes, local)
    scalars |= {f"velocity.{a}": twist[AXES.index(a)] for a in table.axes}
    scalars["speed"] = ca.norm_2(inputs.terms.twist[:3])
    scalars["power"] = ca.dot(wrench, point.twist)
    scalars["tilt"] = ca.acos(ca.fmin(ca.fmax(-ca.dot(inputs.terms.R[:, 2], at.R[:, 2]), -1), 1))
    scalars["touching"] = ca.norm_2(wrench[:3]) > signals.TOUCHING
    scalars["travel"] = ca.norm_2(inputs.terms.p - parameters.add("entry", 3))
    for i in range(context.robot.pin.nv):
        scalars[f"joint.{i + 1}.position"] = inputs.q[i]
        scalars[f"joint.{i + 1}.velocity"] = inputs.v[i]
