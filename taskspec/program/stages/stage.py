"""A stage of the file as one fused function (design: the heart).

tick(time, state, model terms, measured wrench, memory, parameters) -> torque, memory', signals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.laws.disturbance import TORQUE
from taskspec.laws.gains import Gains
from taskspec.program.errors import spec_error
from taskspec.program.events import Condition, Event, code
from taskspec.program.last_commands import last_command
from taskspec.program.limits.programs import resolve
from taskspec.program.limits.resolution import Resolution, Resolved, saturated
from taskspec.program.operators import choice, quick_operators
from taskspec.program.plan import StagePlan
from taskspec.program.ports import optional
from taskspec.program.reference.measurement import Measurement, measure
from taskspec.program.reference.slowed_path import INITIAL
from taskspec.program.signals import UnknownSignalError
from taskspec.program.slots import Slots, gain_slot
from taskspec.program.stages.candidates import Choice, candidates
from taskspec.program.stages.commanded import Commanded, command
from taskspec.program.stages.conditions import gain_conditions, limit_conditions, stage_conditions
from taskspec.program.stages.entry import Entering, StageEntry
from taskspec.program.stages.estimated_stiffness import EstimatedStiffness
from taskspec.program.stages.hand_over import leaving
from taskspec.program.stages.outputs import of_the_law, outputs, probe
from taskspec.program.stages.protected import protection_conditions
from taskspec.spec import FILE

#: The parameter that is 1 where gains that vary are to stay as they are, 0 in every run.
FROZEN = "frozen"


@dataclass(frozen=True, slots=True)
class CompiledStage:
    """One stage, ready to be entered.

    Attributes:
        plan: what was decided about it.
        tracked: the mechanism whose angle is kept; empty for none.
        equations: names of the world's equations, in the order of their inputs and outputs.
        memory, parameters: layouts of the two vectors.
        initial: memory slots that do not start at 0.
        events: what the event number means, 1-based.
        tick: the fused function. Its results are the torque (n,), the next memory, the outputs,
            what the programs of its limits are made of, and the torque (n,) of the law's closed
            form and against friction, before anything that is carried, limits and saturation.
        closed_form: the tick's inputs -> the torque (n,) of the closed form alone, the next
            memory, the numbers of `LAW` and the reference of each equation: what the stage is
            analysed by.
        compensated: the same with what is added against friction; None where that is nothing.
        entry: how it is entered.
        leaving: what it hands on, see `hand_over.leaving`.
        own: at entry, the tick's inputs -> own(0) and own'(0) of every axis before blending.
        choice: of the reduced coordinates, under a multiplier law with constraints.
        resolution: under `solve: qp`.
    """

    plan: StagePlan
    tracked: str
    equations: tuple[str, ...]
    memory: Slots
    parameters: Slots
    initial: Mapping[str, float]
    events: tuple[Event, ...]
    tick: ca.Function
    closed_form: ca.Function
    compensated: ca.Function | None
    entry: StageEntry
    leaving: ca.Function
    own: ca.Function
    choice: Choice | None
    resolution: Resolution | None

    @property
    def name(self) -> str:
        """The name of the stage in the file."""
        return self.plan.name

    @property
    def gains(self) -> NDArray[np.float64]:
        """Values of the gains that are parameters, as the entry takes them."""
        gains = self.plan.gains
        return np.array([gains[name][axis].value for name, axis in self.entry.gains], dtype=float)


def compile_stage(plan: StagePlan) -> CompiledStage:
    """Compiles one stage.

    Its gains are parameters, so that the same functions serve for others; see `tunable`.

    Args:
        plan: of the stage.

    Raises:
        SpecError: it cannot evaluate a signal.
    """
    try:
        return _compiled(plan)
    except UnknownSignalError as error:
        message = f"stage {plan.name!r} cannot evaluate {error}"
        raise spec_error(plan.context.loaded, FILE.stages[plan.name], "TS224", message) from error


@quick_operators()
def _compiled(plan: StagePlan) -> CompiledStage:
    context = plan.context
    measurement = measure(plan)
    estimated = EstimatedStiffness(plan, measurement)
    live, gains_at_entry = tunable(plan, measurement, estimated)
    filled = plan.but(gains=live)
    commanded = command(filled, measurement)
    limited = _limited(plan, measurement, commanded) if plan.law.solve == "qp" else None
    torque = limited.limits.command if limited else saturated(context.drives, commanded.torque)
    closed_form = commanded.own
    if context.drives.positions:
        before = last_command(context, measurement.parameters)
        torque = before + context.period * torque
        closed_form = before + context.period * closed_form
    measurement.table.situation.torque = torque
    number, value, events = code(_conditions(plan, measurement, commanded))
    memory, parameters, references = (
        measurement.memory,
        measurement.parameters,
        commanded.references,
    )
    updates = references.updates | commanded.forces.updates | measurement.algebra.updates
    updates |= commanded.command.memory
    updates |= {} if commanded.tank is None else commanded.tank.memory
    updates |= _estimates(estimated, measurement, updates, live)
    remembered = memory.stack(updates)
    more = optional(context.loaded.task, context.robot.n)
    results = [
        torque,
        remembered,
        ca.vertcat(
            outputs((number, value), measurement, commanded, limited, context.followed, more),
            estimated.outputs(),
        ),
        limited.handed_over if limited else ca.SX(0, 1),
        closed_form,
    ]
    arguments = [*measurement.inputs.symbols(), memory.vector(), parameters.vector()]
    law = [
        *(commanded.closed_form, remembered, of_the_law(measurement, commanded)),
        commanded.own,
    ]
    if TORQUE in memory:
        # What is analysed commands nothing but the closed form, and knows it as a state.
        applied = last_command(context, parameters)
        law = ca.substitute(law, [applied], [memory.symbol(TORQUE)])
    own = ca.Function("own", arguments, [references.own, references.own_rate])
    at_entry = probe(arguments, measurement, commanded)
    initial = dict(measurement.algebra.initial)
    initial |= {slot: value for slot, value in INITIAL.items() if slot in memory}
    return CompiledStage(
        plan=plan,
        tracked="" if measurement.tracked is None else measurement.tracked.mechanism.name,
        equations=tuple(context.equations),
        memory=memory,
        parameters=parameters,
        initial=initial,
        events=events,
        tick=ca.Function("tick", arguments, results),
        closed_form=ca.Function("closed_form", arguments, law[:-1]),
        compensated=(
            None
            if commanded.friction is None
            else ca.Function("compensated", arguments, [law[-1], *law[1:-1]])
        ),
        entry=Entering(
            plan, gains_at_entry, measurement, estimated, initial, at_entry, own
        ).entry(),
        leaving=leaving(plan),
        own=own,
        choice=candidates(arguments, commanded),
        resolution=limited.compiled(arguments) if limited else None,
    )


def _estimates(
    estimated: EstimatedStiffness,
    measurement: Measurement,
    updates: Mapping[str, ca.SX],
    gains: Gains,
) -> dict[str, ca.SX]:
    """The memory of what a stage estimates, and of integrals whose gains follow that."""
    parameters = measurement.parameters
    found = estimated.updates(parameters.symbol(FROZEN) if FROZEN in parameters else None)
    integral = gains.get("force.integral", {})
    following = {
        axis: ca.SX(integral[axis].value)
        for axis in estimated.axes
        if axis in integral and isinstance(integral[axis].value, ca.SX)
    }
    return found | estimated.rescaled(updates, found, following)


def tunable(
    plan: StagePlan, measurement: Measurement, estimated: EstimatedStiffness
) -> tuple[Gains, Gains]:
    """The gains of a stage as its tick has them, and as its entry does.

    They are slots of the parameters, which an entry fills; those of zero stay what they are. Gains
    that vary, or follow what is estimated, are their expressions, but slots, too, where the
    parameter `FROZEN` is 1.
    """
    parameters, known = measurement.parameters, dict[int, ca.SX]()
    inputs = measurement.inputs
    at_start = ca.vertcat(0, inputs.now[1:])

    def worth(expression: Expression) -> ca.SX:
        if id(expression) not in known:
            known[id(expression)] = measurement.translate(expression)
        return known[id(expression)]

    varying: Gains = {}
    if plan.law.varying:
        varying = plan.design_rules.design(consistent=plan.consistent, worth=worth).gains
    for axis, by_name in plan.estimates.schedules.items():
        for name, schedule in by_name.items():
            now = schedule.at(estimated.followed(axis))
            varying.setdefault(name, {})[axis] = replace(plan.gains[name][axis], value=now)
    if varying:
        frozen = parameters.add(FROZEN)
    live: Gains = {}
    at_entry: Gains = {}
    for name, by_axis in plan.gains.items():
        for on, gain in by_axis.items():
            now = varying[name][on].value if on in varying.get(name, {}) else gain.value
            here: float | ca.SX = gain.value
            first = here
            if isinstance(now, ca.SX):
                here = choice(frozen, parameters.add(gain_slot(name, on)), now)
                first = ca.substitute(now, inputs.now, at_start)
            elif gain.value != 0:
                here = first = parameters.add(gain_slot(name, on))
            live.setdefault(name, {})[on] = replace(gain, value=here)
            at_entry.setdefault(name, {})[on] = replace(gain, value=first)
    return live, at_entry


def _limited(plan: StagePlan, measurement: Measurement, commanded: Commanded) -> Resolved:
    """The programs that keep a stage's limits and find the nearest forces that contacts return."""
    wishes = {
        name: force + measurement.infeasible.unreachable[name]
        for name, force in commanded.set_points.items()
    }
    return resolve(plan, measurement, wishes, commanded.torque, commanded.case.gains)


def _conditions(plan: StagePlan, measurement: Measurement, commanded: Commanded) -> list[Condition]:
    """Everything that can end a stage, in the order in which it counts."""
    context = plan.context
    limits = [
        *limit_conditions(context.robot, plan, measurement, commanded.references),
        *commanded.conditions,
        *gain_conditions(commanded.case.gains),
        *protection_conditions(plan, measurement),
    ]
    return [
        *(each for each in limits if each.event.name not in plan.unheeded),
        *stage_conditions(plan, measurement, context.period),
    ]
