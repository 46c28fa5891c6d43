"""Measurements of a stage: its inputs, the tool in its frame, and the signals that follow."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import casadi as ca

from taskspec.control.state import TaskState, task_state
from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.expression.tree import Name
from taskspec.program import ports, signals
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.program.clock import Clock
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.program.reference.constraints import EquationRow, equation_rows, reactions
from taskspec.program.reference.infeasible_forces import InfeasibleForces, infeasible_of, requested
from taskspec.program.reference.tracked_mechanism import (
    TrackedMechanism,
    mechanism_state,
    tracked_mechanism,
)
from taskspec.program.signals import SignalTable
from taskspec.program.slots import Slots
from taskspec.program.world import kinematics, tracked_frames
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import BaseMotion
from taskspec.robot import model_terms
from taskspec.robot.model_terms import TermSymbols
from taskspec.signals import ObjectState
from taskspec.spec import Task
from taskspec.spec.params import worths


@dataclass(frozen=True, slots=True)
class Measurement:
    """A stage's measurement as expressions of its inputs.

    Attributes:
        inputs: symbols of the tick.
        memory, parameters: layouts that the stage fills.
        clock: time.
        algebra: of the file's expressions.
        moving_base: the frame's moving base now; None where nothing carries it.
        terms: of the tip, relative to the base.
        tracked: the mechanism that is kept track of.
        tool, point, at: tool point, control point and frame, relative to the base.
        state: what the law sees.
        normals: (3,) of each contact of its axes, at the tool.
        rows: every equation.
        reactions: what the robot applies along each.
        gaps: to every shape.
        table: signals by name.
        infeasible: what contacts do not return of the set points.
        varying_gains: of all stages of the task, by name and entry.
        tracks: what its frame tracks, by its number in `tracked_frames`; 0 for nothing.
    """

    inputs: ports.Inputs
    memory: Slots
    parameters: Slots
    clock: Clock
    algebra: CasadiAlgebra
    moving_base: BaseMotion | None
    terms: TermSymbols
    tracked: TrackedMechanism | None
    tool: kinematics.ToolPoint
    point: kinematics.ControlPoint
    at: kinematics.FrameState
    state: TaskState
    normals: Mapping[str, ca.SX]
    rows: Mapping[str, EquationRow]
    reactions: Mapping[str, ca.SX]
    gaps: Mapping[str, ca.SX]
    table: SignalTable
    infeasible: InfeasibleForces
    varying_gains: tuple[tuple[str, str], ...]
    tracks: float

    @property
    def world(self) -> TermSymbols:
        """Model terms against the world."""
        return self.inputs.terms

    def translate(
        self, expression: Expression, coordinates: Mapping[str, ca.SX] = MappingProxyType({})
    ) -> ca.SX:
        """An expression of the file, in signals as far as they are known.

        Args:
            expression: of the file.
            coordinates: what the names of axes stand for in it.
        """

        def lookup(name: Name) -> ca.SX:
            found = coordinates.get(str(name))
            return self.table.lookup(name) if found is None else found

        return self.algebra.translate(expression, lookup)


def measure(plan: StagePlan) -> Measurement:
    """The measurement of a stage; its memory and parameters take the slots that this needs."""
    context = plan.context
    robot, frame = context.robot, plan.frame
    inputs = _inputs(context)
    memory, parameters = Slots("memory"), Slots("parameters")
    infeasible = infeasible_of(requested(plan.law, plan.plans, plan.active), parameters)
    task = context.loaded.task
    clock = _clock(task, inputs)
    world, now = inputs.terms, clock.clock

    tracked = tracked_mechanism(context, frame, world, clock, memory, parameters)
    offset = _control_offset(frame, parameters)
    face = kinematics.new_face(parameters, frame, "frame")
    if frame.tracking is not None:
        face = tracked_frames.symbols(memory)
    placed = signals.place(robot, frame, plan.moving_base, world, inputs.contact, now, offset, face)
    base, terms, point, at = placed.moving_base, placed.terms, placed.point, placed.at
    rows = equation_rows(context.equations, world, inputs.q, inputs.v, now)
    measured = reactions(rows, inputs.contact, inputs.reactions)
    gaps = signals.gaps(robot, context.surfaces, world.p, world.R, context.moving_bases, now)
    elsewhere = signals.SignalsElsewhere(
        robot, context.frames, world, inputs.contact, offset, context.moving_bases, now, parameters
    )
    situation = placed.situation(plan.axes)
    situation.t = clock.t
    situation.force_inconsistent = infeasible.size()
    situation.limited = parameters.add("limited") if plan.law.solve == "qp" else ca.SX(0)
    situation.joint_error = ca.SX(0)
    situation.start = parameters.add("entry", 3)
    situation.q, situation.v = inputs.q, inputs.v
    situation.grip = inputs.grip
    situation.contact = plan.contacts.of_gap
    situation.visits = {stage: inputs.now[2 + i] for i, stage in enumerate(task.stages)}
    situation.payload = inputs.now[ports.payload_place(task)]
    kinds = {name: thing.kind for name, thing in task.world.items()}
    situation.objects = {
        **{name: ObjectState(kind) for name, kind in kinds.items()},
        **{name: ObjectState("shape", gap) for name, gap in gaps.items()},
        **{
            name: ObjectState(kinds[name], row.terms.distance, effort=measured[name])
            for name, row in rows.items()
        },
        **{
            name: ObjectState("bushing", displacement=bushing.coordinates(world.p, world.R))
            for name, bushing in context.bushings.items()
        },
        **mechanism_state(tracked, context.held, world, inputs.contact),
    }
    return Measurement(
        inputs=inputs,
        memory=memory,
        parameters=parameters,
        clock=clock,
        algebra=CasadiAlgebra(memory, context.period),
        moving_base=base,
        terms=terms,
        tracked=tracked,
        tool=placed.tool,
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
        normals={
            contact: _normal(context, contact, at, world, base, clock)
            for contact in plan.contacts.objects
        },
        rows=rows,
        reactions=measured,
        gaps=gaps,
        table=SignalTable(situation, _constants(task, clock), elsewhere),
        infeasible=infeasible,
        varying_gains=task.varying_gains,
        tracks=tracked_frames.NUMBERS[frame.tracking.of] if frame.tracking is not None else 0.0,
    )


def _inputs(context: Context) -> ports.Inputs:
    n, task = context.robot.n, context.loaded.task
    size = len(ports.now_at_start(task))
    now, q, v = (ca.SX.sym(s, size) for s, size in (("now", size), ("q", n), ("v", n)))
    return ports.Inputs(
        now=now,
        q=q,
        v=v,
        terms=model_terms.symbols(context.robot, v),
        wrench=ca.SX.sym("wrench", 6),
        reactions=ca.SX.sym("reactions", len(task.reported)),
        grips=bool(task.gripped),
    )


def _clock(task: Task, inputs: ports.Inputs) -> Clock:
    """Time, and the params that go on with it."""
    t, clock, live = inputs.now[0], inputs.now[1], len(task.live)
    if not live:
        return Clock(t, clock)
    first = ports.first_live(task)
    values, rates = slice(first, first + live), slice(first + live, first + 2 * live)
    return Clock(t, clock, inputs.now[values], inputs.now[rates])


def _constants(task: Task, clock: Clock) -> dict[str, ca.SX]:
    """Params and pi; those that may be set are inputs of the tick."""
    places = {name: i for i, name in enumerate(task.live)}

    def slot(name: str) -> ca.SX:
        assert clock.live is not None
        return clock.live[places[name]]

    return constants(worths(task.params, CasadiAlgebra(None, 0.0), slot))


def _normal(
    context: Context,
    contact: str,
    at: kinematics.FrameState,
    world: TermSymbols,
    base: BaseMotion | None,
    clock: Clock,
) -> ca.SX:
    """Outward unit normal (3,) of a nominal contact at the tool, in the axes of its base."""
    if at.chart is not None:
        return at.R[:, 2]
    center = kinematics.tool_point(context.robot, world).center
    normal = signals.normal(
        context.surfaces[contact], center, context.moving_bases, contact, clock.clock
    )
    return normal if base is None else base.A.T @ normal


def _control_offset(frame: FrameModel, parameters: Slots) -> ca.SX | None:
    if not frame.at_origin:
        return None
    if frame.kind == "tool":
        return ca.SX(ca.DM(frame.origin))
    return parameters.add("lever", 3)
