"""A stage of the file as one fused function (design: the heart).

tick(time, state, model terms, measured wrench, memory, parameters) -> torque, memory', signals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.laws.gains import Gains
from taskspec.motion.path import PathShape
from taskspec.program.context import Context
from taskspec.program.events import Condition, Event, code
from taskspec.program.layout import Layout
from taskspec.program.limits.programs import resolve
from taskspec.program.limits.resolution import Resolution, Resolved, saturated
from taskspec.program.reference.coupling import Coupling
from taskspec.program.reference.measured import Measured, measure
from taskspec.program.reference.modes import AxisPlan
from taskspec.program.reference.planned import PlannedStage, plan_stage
from taskspec.program.stages.candidates import Choice, candidates
from taskspec.program.stages.commanded import Commanded, command
from taskspec.program.stages.conditions import limit_conditions, stage_conditions
from taskspec.program.stages.outputs import outputs, probe
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.spec import Law, Limits, Stage


@dataclass(frozen=True, slots=True)
class CompiledStage:
    """One stage, ready to be entered.

    Attributes:
        name: as in the file. spec: its entry there. law, limits: as they hold for it.
        frame: its task frame. axes: that exist in it. plans: who controls each of them.
        gains: with their origins. contact: the object that forces are believed to act on.
        stiffness: believed of that contact [N/m], 0 without one.
        held: the mechanism whose handle returns forces instead of a contact; empty for none.
        moving_base: how the object that carries the frame moves; None where nothing does.
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
    axes: tuple[Axis, ...]
    plans: Mapping[Axis, AxisPlan]
    gains: Gains
    contact: str | None
    stiffness: float
    held: str
    moving_base: MovingBase | None
    tracked: str
    couplings: Mapping[Axis, Coupling]
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
    plan = plan_stage(context, name, path, axes_rotation, gains)
    seen = measure(context, plan)
    asked = command(context, plan, seen)
    limited = _limited(context, plan, seen, asked) if plan.law.solve == "qp" else None
    torque = limited.limits.torque if limited else saturated(context.robot, asked.torque)
    seen.table.situation.torque = torque
    number, value, events = code(_conditions(context, plan, seen, asked))
    memory, parameters, references = seen.memory, seen.parameters, asked.references
    updates = references.updates | asked.forces.updates | seen.algebra.updates
    results = [
        torque,
        memory.stack(updates),
        outputs((number, value), seen, asked, limited),
        limited.handed_over if limited else ca.SX(0, 1),
    ]
    arguments = [*seen.inputs.symbols(), memory.vector(), parameters.vector()]
    return CompiledStage(
        name=name,
        spec=plan.spec,
        law=plan.law,
        limits=plan.limits,
        frame=plan.frame,
        axes=plan.axes,
        plans=plan.plans,
        gains=plan.gains,
        contact=plan.contact,
        stiffness=plan.stiffness,
        held=context.held if context.gripped(plan.frame) else "",
        moving_base=plan.moving_base,
        tracked="" if seen.believed is None else seen.believed.mechanism.name,
        couplings=plan.couplings,
        equations=tuple(context.equations),
        active=plan.active,
        path=path,
        memory=memory,
        parameters=parameters,
        initial=seen.algebra.initial,
        events=events,
        tick=ca.Function("tick", arguments, results, {"cse": often}),
        probe=probe(arguments, seen, asked),
        own=ca.Function("own", arguments, [references.own, references.own_rate]),
        choice=candidates(arguments, asked),
        resolution=limited.compiled(arguments) if limited else None,
    )


def _limited(context: Context, plan: PlannedStage, seen: Measured, asked: Commanded) -> Resolved:
    """The programs that keep a stage's limits and find the nearest forces that contacts return."""
    wishes = {
        name: force + seen.unreached.unreachable[name] for name, force in asked.set_points.items()
    }
    return resolve(context, plan, seen, wishes, asked.torque)


def _conditions(
    context: Context, plan: PlannedStage, seen: Measured, asked: Commanded
) -> list[Condition]:
    """Everything that can end a stage, in the order in which it counts."""
    return [
        *limit_conditions(context.robot, plan, seen, asked.references),
        *asked.conditions,
        *stage_conditions(plan.spec, seen, context.period),
    ]
