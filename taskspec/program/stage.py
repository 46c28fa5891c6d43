"""A stage of the file as one fused function (design: the heart).

tick(time, state, model terms, measured wrench, memory, parameters) -> torque, memory', signals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import model_terms
from taskspec.control.constrained import eliminate
from taskspec.control.gains import Gains, Plant, design, design_joint_damping, has_force
from taskspec.control.model_terms import TermSymbols
from taskspec.control.reference import opposite
from taskspec.control.state import AXES, task_state
from taskspec.motion.path import PathShape
from taskspec.program import kinematics, laws, orientation, ports, resolution, signals
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.program.axes import existing_axes
from taskspec.program.believed import believe, mechanism_signals
from taskspec.program.carriers import Carrier, Instant
from taskspec.program.clock import Clock
from taskspec.program.conditions import limit_conditions, stage_conditions
from taskspec.program.constraints import (
    ConstraintSet,
    EquationRow,
    active_equations,
    constraint_set,
    equation_gains,
    equation_rows,
    reactions,
)
from taskspec.program.context import Context
from taskspec.program.coupling import Coupling, coupling
from taskspec.program.events import Event, code
from taskspec.program.frames import FrameModel
from taskspec.program.layout import Layout
from taskspec.program.modes import AxisPlan, plan_axes
from taskspec.program.multipliers import ConstraintControl, constrain, equation_forces
from taskspec.program.null_space import null_space_acceleration
from taskspec.program.references import build_references
from taskspec.program.resolution import Resolution
from taskspec.program.signals import SignalTable
from taskspec.program.unreached import requested, unreached_of
from taskspec.spec import LAWS, Law, Limits, Stage

#: Coordinates are chosen again when an exchange would make their minor so many times as large. As
#: many times is an error of the reference along a normal felt by those that are kept.
_WORN = 1.5


@dataclass(frozen=True, slots=True)
class Choice:
    """How the coordinates that the constraints decide are chosen.

    Attributes:
        look: the tick's inputs -> J_phi on the candidates (m, c), q'' that the motion loops ask
            for (n,), and q'' that keeps the constraints (n,).
        weights: (c,) how readily each candidate gives way.
        least: conditioning below which they are chosen again.
    """

    look: ca.Function
    weights: NDArray[np.float64]
    least: float


@dataclass(frozen=True, slots=True)
class CompiledStage:
    """One stage, ready to be entered.

    Attributes:
        name: as in the file. spec: its entry there. law, limits: as they hold for it.
        frame: its task frame. axes: that exist in it. plans: who controls each of them.
        gains: with their origins. contact: the object that forces are believed to act on.
        stiffness: believed of that contact [N/m], 0 without one.
        held: the mechanism whose handle returns forces instead of a contact; empty for none.
        carrier: how the object that carries the frame moves; None where nothing does.
        tracked: the mechanism whose angle is kept; empty for none.
        couplings: of the axes that follow a mechanism.
        equations: names of the world's equations, in the order of their inputs and outputs.
        active: those that constrain it, in this order.
        path: its path, if any.
        memory, parameters: layouts of the two vectors.
        initial: memory slots that do not start at 0.
        events: what the event number means, 1-based.
        tick: the fused function.
        probe: at entry, the tick's inputs and a velocity -> the numbers of `PROBE`.
        own: at entry, the tick's inputs -> own(0) and own'(0) of every axis before blending.
        choice: of the reduced coordinates, under a multiplier law with constraints.
        resolution: under `solve: qp`.
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
    held: str
    carrier: Carrier | None
    tracked: str
    couplings: Mapping[str, Coupling]
    equations: tuple[str, ...]
    active: tuple[str, ...]
    path: PathShape | None
    memory: Layout
    parameters: Layout
    initial: Mapping[str, float]
    events: tuple[Event, ...]
    tick: ca.Function
    probe: ca.Function
    own: ca.Function
    choice: Choice | None
    resolution: Resolution | None


def compile_stage(
    context: Context,
    name: str,
    path: PathShape | None,
    axes_rotation: NDArray[np.float64],
    gains: Gains | None = None,
    *,
    often: bool = True,
) -> CompiledStage:
    """Compiles one stage.

    Args:
        context: what the stages share.
        name: the stage's name.
        path: its path in SI units, already restricted to the axes that it drives.
        axes_rotation: (3, 3) the stage's frame at the start pose.
        gains: in place of those of the file and of the design.
        often: whether the tick is to be evaluated often. What comes more than once in it is then
            looked for, which takes as long as all else.
    """
    task, robot = context.loaded.task, context.robot
    stage, n = task.stages[name], robot.pin.nv
    frame, law, limits = context.frame_of(stage), context.law_of(stage), context.limits_of(stage)
    axes = existing_axes(robot.axes, axes_rotation)
    contact = context.contact_of(frame)
    normal = None if contact is None else axes_rotation.T @ context.start_normals[contact]
    plans = plan_axes(axes, stage.axes, path, law, normal)
    k = context.stiffness_of(frame)
    felt_k = context.felt_stiffness(frame, axes, axes_rotation)
    rates = orientation.rates_of(law, axes_rotation.T @ context.start_R)
    plants = context.plants(axes, axes_rotation, felt_k, rates, context.lever_of(frame))
    couplings = {
        a: coupling(context, frame, axes_rotation, plans, a)
        for a, plan in plans.items()
        if plan.mode == "follows"
    }
    active = active_equations(law, stage, context.equations)
    if gains is None:
        gains = _design(context, law, plans, plants, active, axes_rotation, rates)

    visits = [f"{s}.visits" for s in task.stages]
    now, q, v = ca.SX.sym("now", 2 + len(visits)), ca.SX.sym("q", n), ca.SX.sym("v", n)
    world = model_terms.symbols(robot, v)
    equations = context.equations
    sensed = ca.SX.sym("reactions", len(equations))
    inputs = ports.Inputs(now, q, v, world, ca.SX.sym("wrench", 6), sensed)
    memory, parameters = Layout("memory"), Layout("parameters")
    asked = requested(law, plans, active)
    unreached = unreached_of(asked, parameters)
    clock = Clock(now[0], now[1])
    algebra = CasadiAlgebra(memory, context.period)

    carried_by = context.carrier_of(frame)
    carrier = None if carried_by is None else carried_by.at(clock.clock)
    # Relative to what carries the frame, in its coordinates; to the world's where nothing does.
    terms = world if carrier is None else carrier.relative(world)
    wrench = inputs.wrench if carrier is None else carrier.wrench(inputs.wrench)
    believed = believe(context, frame, world, clock, memory, parameters)
    tool = kinematics.tool_point(robot, terms)
    offset = _control_offset(frame, parameters)
    point = kinematics.control_point(terms, wrench, offset)
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
    rows = equation_rows(equations, world, q, v, clock.clock)
    measured = reactions(rows, inputs.wrench, sensed)
    gap = signals.gaps(robot, context.surfaces, world.p, world.R, context.carriers, clock.clock)
    table = SignalTable(
        {
            **constants({p: quantity.value for p, quantity in task.params.items()}),
            **{visit: now[2 + i] for i, visit in enumerate(visits)},
            **{f"{o}.gap": g for o, g in gap.items()},
            **{f"{name}.gap": row.terms.distance for name, row in rows.items()},
            **{f"{name}.{_effort(rows[name])}": force for name, force in measured.items()},
            **mechanism_signals(believed, context.held, world, inputs.wrench),
            "t": clock.t,
            "clock": clock.clock,
            "force_inconsistent": unreached.size(),
            "limited": parameters.add("limited") if law.solve == "qp" else ca.SX(0),
        },
        axes,
        signals.Resolver(
            robot,
            context.frames,
            world,
            inputs.wrench,
            offset,
            context.carriers,
            clock.clock,
            parameters,
        ),
    )
    if contact is not None:
        table.scalars["gap"] = gap[contact]
    _measured(table, context, inputs, terms, point, at, parameters)

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
        normal=_normal(context, contact, at, world, carrier, clock),
        stiffness=k,
        clock=clock,
        memory=memory,
        parameters=parameters,
        table=table,
        algebra=algebra,
        believed=believed,
        couplings=couplings,
        unreached=unreached,
    )
    stated, references, representable = orientation.restate(
        law, state, references, at.R.T @ terms.R, table
    )
    forces = equation_forces(
        names=active,
        set_points=stage.constraints,
        measured=measured,
        gains=gains,
        clock=clock,
        memory=memory,
        parameters=parameters,
        table=table,
        translate=lambda expression: algebra.translate(expression, table.lookup),
        period=context.period,
        unreached=unreached,
    )
    chosen = (
        constraint_set(
            state=stated,
            forced=[a for a in axes if plans[a].force],
            named=[*stage.axes, *(path.axes if path is not None else ())],
            rows={name: rows[name] for name in active},
            measured=measured,
            references=references.law,
            parameters=parameters,
        )
        if LAWS[law.kind].multipliers
        else None
    )
    control = constrain(chosen, forces, references, clock, parameters) if chosen else None
    posture = null_space_acceleration(law, context, state, world, q, v)
    case = laws.Case(stated, references, plans, gains, table, v, posture, control)
    wanted = laws.joint_torque(law.kind, case, terms)
    limited, torque = None, resolution.saturated(robot, wanted)
    if law.solve == "qp":
        limited = resolution.resolve(
            context=context,
            law=law,
            limits=limits,
            plans=plans,
            seen=resolution.Seen(
                axes_rotation=axes_rotation,
                contact=contact,
                gripped=context.gripped(frame),
                state=state,
                world=world,
                wrench=inputs.wrench,
                point=point,
                R=at.R,
                carrier=carrier,
                rows={name: rows[name] for name in active},
                equations=rows,
                measured=measured,
            ),
            asked={
                name: wish + unreached.unreachable[name]
                for name, wish in {**references.force_ref, **forces.desired}.items()
            },
            gaps=gap,
            wanted=wanted,
            clock=clock.clock,
            q=q,
            v=v,
            parameters=parameters,
        )
        torque = limited.limits.torque
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
    )
    conditions += representable
    conditions += stage_conditions(
        stage=stage, parameters=parameters, table=table, algebra=algebra, period=context.period
    )
    index, value, events = code(conditions)
    updates = references.updates | forces.updates | algebra.updates
    nothing = ca.SX(np.nan)
    felt = ca.vertcat(ca.SX(0, 1), *(measured[name] for name in equations))
    outputs = ports.outputs(
        index,
        value,
        wanted,
        inputs,
        point,
        at,
        table,
        references,
        chosen.conditioning if chosen else ca.SX(1),
        limited.told if limited else (ca.SX(0), ca.SX(0), ca.SX(0)),
        (
            ca.vertcat(ca.SX(0, 1), *(forces.desired.get(name, nothing) for name in equations)),
            felt,
        ),
        believed,
        carrier,
    )
    arguments = [*inputs.symbols(), memory.vector(), parameters.vector()]
    options = {"cse": often}
    handed_over = limited.handed_over if limited else ca.SX(0, 1)
    results = [torque, memory.stack(updates), outputs, handed_over]
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
        held=context.held if context.gripped(frame) else "",
        carrier=carried_by,
        tracked="" if believed is None else believed.mechanism.name,
        couplings=couplings,
        equations=tuple(equations),
        active=active,
        path=path,
        memory=memory,
        parameters=parameters,
        initial=algebra.initial,
        events=events,
        tick=ca.Function("tick", arguments, results, options),
        probe=ports.probe(arguments, table, references, believed, at, tool, point, felt, carrier),
        own=ca.Function("own", arguments, [references.own, references.own_rate]),
        choice=_choice(arguments, chosen, control, case) if chosen and control else None,
        resolution=limited.compiled(arguments) if limited else None,
    )


def _design(
    context: Context,
    law: Law,
    plans: Mapping[str, AxisPlan],
    plants: Mapping[str, Plant],
    active: Sequence[str],
    axes_rotation: NDArray[np.float64],
    rates: NDArray[np.float64],
) -> Gains:
    """Gains of the axes, of the equations `active` and of the joints."""
    gains = design(law, {a: p.axis for a, p in plans.items()}, plants)
    for gain, by_name in equation_gains(context, law, active, context.equations).items():
        gains.setdefault(gain, {}).update(by_name)
    if LAWS[law.kind].damps_joints:
        stiffness = [
            gains["stiffness"][a].value + (plants[a].k if has_force(plans[a].axis) else 0.0)
            for a in plans
        ]
        joints = context.joint_plants(tuple(plans), axes_rotation, stiffness, rates)
        gains["joint_damping"] = design_joint_damping(law, joints)
    return gains


def _effort(row: EquationRow) -> str:
    return "torque" if row.model.joints else "force"


def _choice(
    arguments: list[ca.SX], chosen: ConstraintSet, control: ConstraintControl, case: laws.Case
) -> Choice:
    wanted = laws.free_motion(case)
    on = control.multipliers
    kept = eliminate(on.J, on.gamma, on.directions, wanted + control.held)
    return Choice(
        look=ca.Function("look", arguments, [chosen.J @ chosen.candidates, wanted, kept]),
        weights=chosen.weights,
        least=1 / _WORN,
    )


def _normal(
    context: Context,
    contact: str | None,
    at: kinematics.FrameState,
    world: TermSymbols,
    carrier: Instant | None,
    clock: Clock,
) -> ca.SX | None:
    """Outward unit normal (3,) of the believed contact at the tool, in the axes of the carrier."""
    if at.chart is not None:
        return at.R[:, 2]
    if contact is None:
        return None
    center = kinematics.tool_point(context.robot, world).center
    normal = signals.normal(
        context.surfaces[contact], center, context.carriers, contact, clock.clock
    )
    return normal if carrier is None else carrier.A.T @ normal


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
    terms: TermSymbols,
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
    scalars["tilt"] = ca.acos(ca.fmin(ca.fmax(-ca.dot(terms.R[:, 2], at.R[:, 2]), -1), 1))
    scalars["touching"] = ca.norm_2(wrench[:3]) > signals.TOUCHING
    scalars["travel"] = ca.norm_2(inputs.terms.p - parameters.add("entry", 3))
    for i in range(context.robot.pin.nv):
        scalars[f"joint.{i + 1}.position"] = inputs.q[i]
        scalars[f"joint.{i + 1}.velocity"] = inputs.v[i]
