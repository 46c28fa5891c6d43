"""Motion and force references of a stage on its task axes, in every kind of frame."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import casadi as ca

from taskspec.control.reference import Reference, opposite
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import ReferenceInputs
from taskspec.motion import blend, polynomial
from taskspec.motion.path import PathShape
from taskspec.program.plan import StagePlan
from taskspec.program.reference import force_references
from taskspec.program.reference.axis_reference import AxisReference, axis_reference, blendings
from taskspec.program.reference.coordinates import Coordinates, frame_coordinates
from taskspec.program.reference.measured_axis import measured_axis
from taskspec.program.reference.measurement import Measurement
from taskspec.program.reference.reference_set import ReferenceSet
from taskspec.program.reference.slowed_path import path_time
from taskspec.program.reference.tracking import Tracking, track
from taskspec.program.slots import Slots
from taskspec.program.world import tracked_frames


def build_references(plan: StagePlan, measurement: Measurement) -> ReferenceSet:
    """All references of a stage; adds the signals that depend on them to its table."""
    plans, table = plan.plans, measurement.table
    along = (None, {}) if plan.path is None else path_time(plan.path, measurement)
    table.situation.path_done = _path_done(plan, measurement, along[0])
    coordinates = frame_coordinates(plan, measurement)
    table.situation.position = coordinates.position
    forces = {
        name: measurement.infeasible.reachable(
            name, force_references.set_point(name, axis, measurement)
        )
        for name, axis in plans.items()
        if axis.set_point
    }
    motions = _motions(plan, measurement, coordinates, forces, along[0])
    normals = force_references.open_loop_normals(plan, measurement)
    tracked = track(coordinates, motions, normals)
    table.situation.error = {a: e for a, e in tracked.error.items() if plans[a].motion}
    integrals = force_references.integrals(plan, measurement, forces, tracked.error)
    zero = ca.SX(0)
    return ReferenceSet(
        position=coordinates.position,
        error={a: tracked.error[a] for a in motions},
        coordinate=coordinates.position | normals,
        position_ref={a: coordinates.position[a] + tracked.error[a] for a in motions},
        velocity_ref={a: tracked.velocity[a] for a in motions},
        force_ref=forces,
        law=_of_the_law(plan, measurement, tracked, forces, integrals),
        integrals=integrals,
        updates=_updates(plan, measurement, tracked, motions, integrals) | along[1],
        own=ca.vertcat(*(motions[a].own[0] if a in motions else zero for a in AXES)),
        own_rate=ca.vertcat(*(motions[a].own[1] if a in motions else zero for a in AXES)),
    )


def _path_done(plan: StagePlan, measurement: Measurement, along: ca.SX | None) -> ca.SX:
    if plan.joint_path is not None:
        along = measurement.clock.t
    if along is None:
        return ca.SX(0)
    return along >= measurement.parameters.add("path_end") - plan.context.period / 2


def _motions(
    plan: StagePlan,
    measurement: Measurement,
    coordinates: Coordinates,
    forces: Mapping[Axis, ca.SX],
    along: ca.SX | None,
) -> dict[Axis, AxisReference]:
    """References of the axes whose motion is controlled."""
    context = plan.context
    parameters = measurement.parameters
    on_path = _path(plan.path, along, parameters)
    moving = {name: axis for name, axis in plan.plans.items() if axis.motion}
    ordered = [name for name in plan.leaders_first if name in moving]
    # What starts from rest in a time of its own waits until it is reached.
    wait = parameters.add("wait") if plan.from_rest else ca.SX(0)
    from_rest = blend.from_rest(measurement.clock.t - wait)
    added = blendings(list(moving), measurement.clock, parameters)
    references: dict[Axis, AxisReference] = {}
    for name in ordered:
        at = ReferenceInputs(
            axis=name,
            plan=plan,
            clock=measurement.clock,
            parameters=parameters,
            memory=measurement.memory,
            translate=measurement.translate,
            period=context.period,
            start=parameters.add(f"start.{name}"),
            on_path=on_path,
            forces=forces,
            tracked=measurement.tracked,
            others=references,
            measured=partial(measured_axis, coordinates),
            from_rest=from_rest,
        )
        references[name] = axis_reference(moving[name].mode, at, added[name])
    return references


def _updates(
    plan: StagePlan,
    measurement: Measurement,
    tracked: Tracking,
    motions: Mapping[Axis, AxisReference],
    integrals: Mapping[Axis, ca.SX],
) -> dict[str, ca.SX]:
    """Memory of the references after this tick."""
    updates = tracked.updates | (
        measurement.tracked.updates() if measurement.tracked is not None else {}
    )
    if plan.frame.tracking is not None:
        force, velocity = measurement.inputs.contact[:3], measurement.tool.velocity
        now = tracked_frames.tracked(plan.frame, force, velocity)
        period = plan.context.period
        updates |= tracked_frames.updates(plan.frame, measurement.memory, now, period)
    for motion in motions.values():
        updates |= motion.memory
    return updates | {f"integral.{name}": value for name, value in integrals.items()}


def _of_the_law(
    plan: StagePlan,
    measurement: Measurement,
    tracked: Tracking,
    forces: Mapping[Axis, ca.SX],
    integrals: Mapping[Axis, ca.SX],
) -> Reference:
    """References as vectors over the rows of the task state, in the theory's sign."""
    released = {
        name: force_references.released(name, measurement)
        for name, axis in plan.plans.items()
        if (axis.yields or axis.soft) and not axis.open_loop
    }
    axes, zero = plan.axes, ca.SX(0)
    return Reference(
        error=ca.vertcat(*(tracked.error.get(a, zero) for a in axes)),
        velocity=ca.vertcat(*(tracked.velocity[a] for a in axes)),
        acceleration=ca.vertcat(*(tracked.acceleration[a] for a in axes)),
        force=opposite(ca.vertcat(*(forces.get(a, zero) for a in axes))),
        force_integral=opposite(ca.vertcat(*(integrals.get(a, zero) for a in axes))),
        released=opposite(ca.vertcat(*(released.get(a, zero) for a in axes))),
    )


def _path(path: PathShape | None, along: ca.SX | None, parameters: Slots) -> dict[Axis, ca.SX]:
    """Coordinates of the axes that a path drives, at the time that it goes by."""
    if path is None or along is None:
        return {}
    timing = parameters.add("segment.path", polynomial.SEGMENT_SIZE)
    start = {a: parameters.add(f"path_start.{a}") for a in path.form.needs(path.axes)}
    segments = (
        {a: parameters.add(f"table.{a}", polynomial.SEGMENT_SIZE) for a in path.axes}
        if path.form.in_splines
        else {}
    )
    return path.curve(polynomial.evaluate(timing, along), start, segments)
