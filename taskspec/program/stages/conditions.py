"""Everything that can end a stage: limits, guards, bounds and the planned end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from taskspec.control import linear
from taskspec.expression import Expression
from taskspec.geometry.axis import AXES, PAIRS, Axis, axes_of, coupled
from taskspec.laws.coupled import matrix
from taskspec.laws.gains import MASS, MATRICES, Gains, pairs_of
from taskspec.program import events
from taskspec.program.algebra import length
from taskspec.program.events import Condition, Event
from taskspec.program.plan import StagePlan
from taskspec.program.reference.measurement import Measurement
from taskspec.program.reference.reference_set import ReferenceSet
from taskspec.program.signals import SignalTable
from taskspec.robot import RobotModel
from taskspec.spec import Limits, Stage
from taskspec.text.units import LENGTH, TIME, show

#: Below this pivot of J H^-1 J^T [1/kg, 1/(kg m^2)] an axis has an effective mass of ten tonnes:
#: singular.
SINGULAR = 1e-4
#: An axis with a hundredth of the effective mass that stops the run is near a singularity.
NEAR_SINGULAR = 100 * SINGULAR
_SLACK = 1e-9


def limit_conditions(
    robot: RobotModel, plan: StagePlan, measurement: Measurement, references: ReferenceSet
) -> list[Condition]:
    """Limits of the file, of the joints, of the frame and of the arm's geometry."""
    plans, frame, limits = plan.plans, plan.frame, plan.limits
    table, q, v, margin = (
        measurement.table,
        measurement.inputs.q,
        measurement.inputs.v,
        measurement.at.margin,
    )
    found = []
    force = _norm(table, "force", AXES[:3])
    torque = _norm(table, "torque", AXES[3:])
    moving = [
        e
        for a, e in references.error.items()
        if not (a.is_rotation or plans[a].force or plans[a].open_loop)
    ]
    deviation = ca.norm_2(ca.vertcat(0, *moving))
    for name, value in (
        ("force", force),
        ("torque", torque),
        ("speed", table["speed"]),
        ("deviation", deviation),
    ):
        bound = getattr(limits, name)
        if bound is not None:
            text = f"limit on {name}: {show(bound, Limits.dimension_of(name))}"
            beyond = ca.SX(value > bound)
            then = limits.then(name)
            # In the stage to which it leads there is nowhere better to go.
            kind = events.REACTION if then and then != plan.name else events.LIMIT
            if then:
                beyond = _counting(name, beyond, measurement, plan.context.period)
            event = Event(kind, name, text, then=then if kind == events.REACTION else "")
            found.append(Condition(event, beyond, value))
    found += _joint_limits(robot, q, v)
    if plan.joint_path is not None:
        return found  # Neither a singularity nor a frame stops joints.
    pivot = ca.mmin(ca.diag(linear.cholesky(measurement.state.mobility))) ** 2
    text = "the arm is singular: an axis of the task frame cannot be moved"
    found.append(Condition(Event(events.LIMIT, "singularity", text), pivot < SINGULAR, pivot))
    if frame.kind == "following":
        text = f"the tool left the part of {frame.surface_name!r} that frame {frame.name!r} follows"
        found.append(Condition(Event(events.LIMIT, "frame_left", text), margin < 0, margin))
    if frame.kind == "tracking":
        text = (
            f"the measured force is along the heading of frame {frame.name!r}, which has no x then"
            if frame.tracking is not None and frame.tracking.of == "force"
            else f"the motion is along the normal of frame {frame.name!r}, which has no z then"
        )
        found.append(Condition(Event(events.LIMIT, "frame_left", text), margin < 0, margin))
    if frame.mechanism is not None:
        text = f"the tool came to the axis of {frame.mechanism.name!r}, where {frame.name!r} ends"
        found.append(Condition(Event(events.LIMIT, "frame_left", text), margin < 0, margin))
    return found


def gain_conditions(gains: Gains) -> Iterator[Condition]:
    """Matrices of gains that the file has vary and that are not positive definite any more.

    Args:
        gains: of a stage, as its tick has them.
    """
    for name in MATRICES:
        entries = gains.get(name, {})
        # In the order of the entries: the same task has the same code in every process.
        varying = [on for on, gain in entries.items() if gain.formula is not None]
        least, holds = ca.SX(ca.inf), ca.SX(0)
        groups = coupled([*pairs_of(gains, name)])
        beside = {axis for group in groups for axis in group} | {*PAIRS}
        for on in (each for each in varying if each not in beside):
            value = ca.SX(entries[on].value)
            least = ca.fmin(least, value)
            holds = ca.logic_or(holds, value <= 0 if name == MASS.name else value < 0)
        for group in groups:
            if any({*axes_of(on)} <= {*group} for on in varying):
                pivot = linear.least_pivot(matrix(gains, name, group))
                least, holds = ca.fmin(least, pivot), ca.logic_or(holds, pivot <= 0)
        if varying:
            text = f"the law's {name} is not positive definite any more"
            yield Condition(Event(events.LIMIT, "gain", text), holds, least)


def _joint_limits(robot: RobotModel, q: ca.SX, v: ca.SX) -> Iterator[Condition]:
    """Limits of the joints' positions and velocities, joint after joint."""
    outside = ca.fmax(ca.DM(robot.lower) - q, q - ca.DM(robot.upper)) > _SLACK
    fast = ca.fabs(v) > ca.DM(robot.velocity_limit)
    columns = (ca.vertsplit(column) for column in (outside, q, fast, v))
    for i, (beyond, at, faster, rate) in enumerate(zip(*columns, strict=True), 1):
        joint = f"joint {i} ({robot.joint_names[i - 1]})"
        position = Event(events.LIMIT, "joint_position", f"position limit of {joint}")
        yield Condition(position, beyond, at)
        velocity = Event(events.LIMIT, "joint_velocity", f"velocity limit of {joint}")
        yield Condition(velocity, faster, rate)


def resting(limit: str) -> str:
    """The slot of the memory with the stage time until which a limit does not count [s]."""
    return f"resting.{limit}"


def _counting(limit: str, beyond: ca.SX, measurement: Measurement, period: float) -> ca.SX:
    """Whether a limit is crossed that counts: after it led here, once it has been kept again."""
    until = measurement.memory.add(resting(limit))
    measurement.algebra.updates[resting(limit)] = ca.if_else(beyond, until, 0)
    return ca.logic_and(beyond, measurement.clock.t >= until - period / 2)


def stage_conditions(plan: StagePlan, measurement: Measurement, period: float) -> list[Condition]:
    """`fail_if`, `until`, `within` and the planned end of a stage."""
    stage, t = plan.spec, measurement.clock.t
    found = []

    def guard(kind: str, expression: Expression | None) -> None:
        if expression is not None:
            holds = measurement.translate(expression)
            found.append(Condition(Event(kind, kind, str(expression)), holds, t))

    guard(events.FAIL_IF, stage.fail_if)
    if stage.until is not None:
        until = Event(events.UNTIL, events.UNTIL, str(stage.until))
        found += _by_way(
            stage, Condition(until, measurement.translate(stage.until), t), measurement
        )
    if stage.within is not None:
        time, travel = stage.within.time, stage.within.travel
        if time is not None:
            text = f"within {show(time, TIME)}"
            found.append(Condition(Event(events.WITHIN, "time", text), t >= time - period / 2, t))
        if travel is not None:
            travelled = measurement.table["travel"]
            text = f"within {show(travel, LENGTH)} of travel"
            found.append(
                Condition(Event(events.WITHIN, "travel", text), travelled > travel, travelled)
            )
    if stage.until is None:
        end = measurement.parameters.add("end")
        text = "its moves, path and time are done"
        over = t >= end - period / 2
        if plan.path is not None and plan.path.slowed is not None:
            over = ca.logic_and(over, measurement.table.situation.path_done)
        done = Condition(Event(events.DONE, "done", text), over, t)
        found += _by_way(stage, done, measurement)
    return found


def _by_way(stage: Stage, end: Condition, measurement: Measurement) -> Iterator[Condition]:
    """An end as one event for each branch: of those that hold, the first one counts."""
    for number, branch in enumerate(stage.next[:-1]):
        assert branch.when is not None
        text = f"{end.event.text}; {branch.when}"
        event = replace(end.event, text=text, branch=number)
        holds = ca.logic_and(end.holds, measurement.translate(branch.when))
        yield Condition(event, holds, end.value)
    yield end


def _norm(table: SignalTable, kind: str, axes: tuple[Axis, ...]) -> ca.SX:
    return length(ca.vertcat(0, *(table[f"{kind}.{a}"] for a in axes if a in table.axes)))
