"""What a stage measures: its inputs, the tool in its frame, and the signals that follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from taskspec.control import model_terms
from taskspec.control.model_terms import TermSymbols
from taskspec.control.reference import opposite
from taskspec.control.state import TaskState, task_state
from taskspec.geometry.axis import AXES
from taskspec.program import ports, signals
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.program.clock import Clock
from taskspec.program.context import Context
from taskspec.program.layout import Layout
from taskspec.program.reference.believed import Believed, believe, mechanism_signals
from taskspec.program.reference.constraints import EquationRow, equation_rows, reactions
from taskspec.program.reference.planned import PlannedStage
from taskspec.program.reference.unreached import Unreached, requested, unreached_of
from taskspec.program.signals import SignalTable
from taskspec.program.world import kinematics
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import BaseMotion
from taskspec.text.expression import Expression


@dataclass(frozen=True, slots=True)
class Measured:
    """A stage's measurement as expressions of its inputs.

    Attributes:
        inputs: symbols of the tick. memory, parameters: layouts that the stage fills.
        clock: time. algebra: of the file's expressions.
        moving_base: the frame's moving base now; None where nothing carries it.
        terms: of the tip, relative to the base. believed: the mechanism that is kept track of.
        tool, point, at: tool point, control point and frame, relative to the base.
        state: what the law sees. normal: (3,) of the believed contact at the tool, or None.
        rows: every equation. reactions: what the robot applies along each. gaps: to every shape.
        table: signals by name. unreached: what contacts do not return of the set points.
    """

    inputs: ports.Inputs
    memory: Layout
    parameters: Layout
    clock: Clock
    algebra: CasadiAlgebra
    moving_base: BaseMotion | None
    terms: TermSymbols
    believed: Believed | None
    tool: kinematics.ToolPoint
    point: kinematics.ControlPoint
    at: kinematics.FrameState
    state: TaskState
    normal: ca.SX | None
    rows: Mapping[str, EquationRow]
    reactions: Mapping[str, ca.SX]
    gaps: Mapping[str, ca.SX]
    table: SignalTable
    unreached: Unreached

    @property
    def world(self) -> TermSymbols:
        """Model terms against the world."""
        return self.inputs.terms

    def translate(self, expression: Expression) -> ca.SX:
        """An expression of the file, in signals as far as they are known."""
        return self.algebra.translate(expression, self.table.lookup)


def measure(context: Context, plan: PlannedStage) -> Measured:
    """The measurement of a stage; its memory and parameters take the slots that this needs."""
    robot, frame = context.robot, plan.frame
    inputs = _inputs(context)
    memory, parameters = Layout("memory"), Layout("parameters")
    unreached = unreached_of(requested(plan.law, plan.plans, plan.active), parameters)
    clock = Clock(inputs.now[0], inputs.now[1])
    world, now = inputs.terms, clock.clock

    base = None if plan.moving_base is None else plan.moving_base.at(now)
    # Relative to what carries the frame, in its coordinates; to the world's where nothing does.
    terms = world if base is None else base.relative(world)
    wrench = inputs.wrench if base is None else base.wrench(inputs.wrench)
    believed = believe(context, frame, world, clock, memory, parameters)
    tool = kinematics.tool_point(robot, terms)
    offset = _control_offset(frame, parameters)
    point = kinematics.control_point(terms, wrench, offset)
    face = kinematics.new_face(parameters, frame, "frame")
    at = kinematics.frame_state(frame, terms, tool, face)
    rows = equation_rows(context.equations, world, inputs.q, inputs.v, now)
    measured = reactions(rows, inputs.wrench, inputs.reactions)
    gaps = signals.gaps(robot, context.surfaces, world.p, world.R, context.moving_bases, now)
    elsewhere = signals.Resolver(
        robot, context.frames, world, inputs.wrench, offset, context.moving_bases, now, parameters
    )
    scalars = {
        **_of_the_run(context, inputs, clock),
        **{f"{o}.gap": g for o, g in gaps.items()},
        **{f"{name}.gap": row.terms.distance for name, row in rows.items()},
        **{f"{name}.{_effort(rows[name])}": force for name, force in measured.items()},
        **mechanism_signals(believed, context.held, world, inputs.wrench),
        "force_inconsistent": unreached.size(),
        "limited": parameters.add("limited") if plan.law.solve == "qp" else ca.SX(0),
        **_of_the_tool(context, plan, inputs, terms, point, at, parameters),
    }
    if plan.contact is not None:
        scalars["gap"] = gaps[plan.contact]
    return Measured(
        inputs=inputs,
        memory=memory,
        parameters=parameters,
        clock=clock,
        algebra=CasadiAlgebra(memory, context.period),
        moving_base=base,
        terms=terms,
        believed=believed,
        tool=tool,
        point=point,
        at=at,
        state=task_state(
            axes=plan.axes,
            H=terms.H,
            J=point.J,
            drift=point.drift,
            twist=point.twist,
            wrench=point.wrench,
            R=at.R,
            R_rate=at.R_rate,
        ),
        normal=_normal(context, plan.contact, at, world, base, clock),
        rows=rows,
        reactions=measured,
        gaps=gaps,
        table=SignalTable(scalars, plan.axes, elsewhere),
        unreached=unreached,
    )


def _inputs(context: Context) -> ports.Inputs:
    n, stages = context.robot.pin.nv, context.loaded.task.stages
    now, q, v = (ca.SX.sym(s, size) for s, size in (("now", 2 + len(stages)), ("q", n), ("v", n)))
    return ports.Inputs(
        now=now,
        q=q,
        v=v,
        terms=model_terms.symbols(context.robot, v),
        wrench=ca.SX.sym("wrench", 6),
        reactions=ca.SX.sym("reactions", len(context.equations)),
    )


def _of_the_run(context: Context, inputs: ports.Inputs, clock: Clock) -> dict[str, ca.SX]:
    """Parameters of the file, visits of the stages and time."""
    task = context.loaded.task
    return {
        **constants({p: quantity.value for p, quantity in task.params.items()}),
        **{f"{stage}.visits": inputs.now[2 + i] for i, stage in enumerate(task.stages)},
        "t": clock.t,
        "clock": clock.clock,
    }


def _of_the_tool(
    context: Context,
    plan: PlannedStage,
    inputs: ports.Inputs,
    terms: TermSymbols,
    point: kinematics.ControlPoint,
    at: kinematics.FrameState,
    parameters: Layout,
) -> dict[str, ca.SX]:
    """The signals of tool and joints that follow from the measurement alone."""
    wrench = opposite(point.wrench)
    local = ca.vertcat(at.R.T @ wrench[:3], at.R.T @ wrench[3:])
    twist = ca.vertcat(at.R.T @ point.twist[:3], at.R.T @ point.twist[3:])
    found = signals.wrench_signals(plan.axes, local)
    found |= {f"velocity.{a}": twist[AXES.index(a)] for a in plan.axes}
    found["speed"] = ca.norm_2(inputs.terms.twist[:3])
    found["power"] = ca.dot(wrench, point.twist)
    found["tilt"] = ca.acos(ca.fmin(ca.fmax(-ca.dot(terms.R[:, 2], at.R[:, 2]), -1), 1))
    found["touching"] = ca.norm_2(wrench[:3]) > signals.TOUCHING
    found["travel"] = ca.norm_2(inputs.terms.p - parameters.add("entry", 3))
    for i in range(context.robot.pin.nv):
        found[f"joint.{i + 1}.position"] = inputs.q[i]
        found[f"joint.{i + 1}.velocity"] = inputs.v[i]
    return found


def _effort(row: EquationRow) -> str:
    return "torque" if row.model.joints else "force"


def _normal(
    context: Context,
    contact: str | None,
    at: kinematics.FrameState,
    world: TermSymbols,
    base: BaseMotion | None,
    clock: Clock,
) -> ca.SX | None:
    """Outward unit normal (3,) of the believed contact at the tool, in the axes of its base."""
    if at.chart is not None:
        return at.R[:, 2]
    if contact is None:
        return None
    center = kinematics.tool_point(context.robot, world).center
    normal = signals.normal(
        context.surfaces[contact], center, context.moving_bases, contact, clock.clock
    )
    return normal if base is None else base.A.T @ normal


def _control_offset(frame: FrameModel, parameters: Layout) -> ca.SX | None:
    if not frame.at_origin:
        return None
    if frame.kind == "tool":
        return ca.SX(ca.DM(frame.origin))
    return parameters.add("lever", 3)
