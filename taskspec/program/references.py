"""Motion and force references of a stage on its task axes, in every kind of frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from taskspec.control.gains import Gains
from taskspec.control.model_terms import TermSymbols
from taskspec.control.reference import Reference, opposite
from taskspec.control.state import AXES, TaskState
from taskspec.motion import blend, polynomial
from taskspec.motion.path import PathShape
from taskspec.program import kinematics
from taskspec.program.algebra import CasadiAlgebra
from taskspec.program.axis_reference import AxisReference, ReferenceBuilder, Translate
from taskspec.program.believed import Believed
from taskspec.program.clock import Clock
from taskspec.program.context import Context
from taskspec.program.coordinates import frame_coordinates
from taskspec.program.coupling import Coupling, coupled_motion
from taskspec.program.frames import FrameModel
from taskspec.program.layout import Layout
from taskspec.program.modes import AxisPlan
from taskspec.program.signals import SignalTable, applied
from taskspec.program.unreached import Unreached
from taskspec.text.expression import Expression

#: A force set point rises from the measured force in this time [s] (docs/language.md).
DEFAULT_RAMP = 0.2


@dataclass(frozen=True, slots=True)
class ReferenceSet:
    """References by axis name, and what they need to be carried on.

    Attributes:
        position, error: measured coordinate and e = r - x of every axis [m, rad].
        coordinate: what the reference is held against; the gap along an open-loop force's axis.
        position_ref, velocity_ref: of motion axes. force_ref: of force axes, applied by the robot.
        law: the same as vectors over the task state's rows, in the theory's sign.
        integrals: by force axis, integral of f_d - f as the robot applies it [N s].
        updates: memory after this tick.
        own, own_rate: (6,) r(0) of each mode before blending and its rate, for the entry.
    """

    position: Mapping[str, ca.SX]
    error: Mapping[str, ca.SX]
    coordinate: Mapping[str, ca.SX]
    position_ref: Mapping[str, ca.SX]
    velocity_ref: Mapping[str, ca.SX]
    force_ref: Mapping[str, ca.SX]
    law: Reference
    integrals: Mapping[str, ca.SX]
    updates: dict[str, ca.SX]
    own: ca.SX
    own_rate: ca.SX

    def six(self, values: Mapping[str, ca.SX]) -> ca.SX:
        """(6,) in the order of the axes, NaN where there is no value."""
        return ca.vertcat(*(values.get(a, ca.SX(np.nan)) for a in AXES))


def build_references(
    *,
    context: Context,
    frame: FrameModel,
    at: kinematics.FrameState,
    tool: kinematics.ToolPoint,
    point: kinematics.ControlPoint,
    terms: TermSymbols,
    state: TaskState,
    plans: Mapping[str, AxisPlan],
    gains: Gains,
    path: PathShape | None,
    gap: ca.SX | None,
    normal: ca.SX | None,
    stiffness: float,
    clock: Clock,
    memory: Layout,
    parameters: Layout,
    table: SignalTable,
    algebra: CasadiAlgebra,
    believed: Believed | None,
    couplings: Mapping[str, Coupling],
    unreached: Unreached,
) -> ReferenceSet:
    """All references of a stage; adds the signals that depend on them to `table`."""

    def translate(expression: Expression) -> ca.SX:
        return algebra.translate(expression, table.lookup)

    builder = ReferenceBuilder(clock, parameters, memory, translate, context.period)
    path_values = _path(path, clock, parameters)
    table.scalars["path_done"] = (
        clock.t >= parameters.add("path_end") - context.period / 2 if path else ca.SX(0)
    )
    coordinates = frame_coordinates(
        frame=frame,
        at=at,
        tool=tool,
        point=point,
        terms=terms,
        gap=gap,
        clock=clock,
        memory=memory,
        parameters=parameters,
        plans=plans,
        believed=believed,
    )
    table.scalars |= {f"position.{a}": x for a, x in coordinates.position.items()}

    forces = {
        name: unreached.reachable(name, _force(name, plan, clock, parameters, translate))
        for name, plan in plans.items()
        if plan.set_point
    }
    motions: dict[str, AxisReference] = {}
    blendings = builder.blendings([name for name, plan in plans.items() if plan.motion])
    # An axis that follows another one comes after it.
    for name, plan in sorted(plans.items(), key=lambda item: item[0] in couplings):
        if not plan.motion:
            continue
        coupled = None
        if name in couplings:
            assert believed is not None
            coupled = coupled_motion(name, couplings[name], believed, motions, parameters)
        motions[name] = builder.build(
            name,
            plan.mode,
            plan.axis,
            blendings[name],
            path_value=path_values.get(name),
            open_loop_value=_displacement(name, plan, forces, gains, stiffness),
            coupled=coupled,
        )
    normals = _open_loop_normals(plans, at, gap, normal)
    tracked = coordinates.track(motions, normals)
    table.scalars |= {f"error.{a}": e for a, e in tracked.error.items() if plans[a].motion}

    updates = tracked.updates | (believed.updates() if believed is not None else {})
    for name, motion in motions.items():
        if motion.integral_step is not None:
            slot = f"travelled.{name}"
            updates[slot] = memory.symbol(slot) + motion.integral_step
    # What is held is touched, whatever little force passes.
    touching = ca.SX(1) if context.gripped(frame) else table.scalars["touching"]
    integrals = _integrate(
        plans,
        forces,
        gains,
        tracked.error,
        table,
        memory,
        updates,
        context.period,
        touching,
        unreached,
    )
    fading = {
        name: _fading(name, clock, parameters)
        for name, plan in plans.items()
        if (plan.yields or plan.soft) and not plan.open_loop
    }
    axes = state.axes
    zero = ca.SX(0)
    reference = Reference(
        error=ca.vertcat(*(tracked.error.get(a, zero) for a in axes)),
        velocity=ca.vertcat(*(tracked.velocity[a] for a in axes)),
        acceleration=ca.vertcat(*(tracked.acceleration[a] for a in axes)),
        force=opposite(ca.vertcat(*((forces | fading).get(a, zero) for a in axes))),
        force_integral=opposite(ca.vertcat(*(integrals.get(a, zero) for a in axes))),
    )
    return ReferenceSet(
        position=coordinates.position,
        error={a: tracked.error[a] for a in motions},
        coordinate=coordinates.position | normals,
        position_ref={a: coordinates.position[a] + tracked.error[a] for a in motions},
        velocity_ref={a: tracked.velocity[a] for a in motions},
        force_ref=forces,
        law=reference,
        integrals=integrals,
        updates=updates,
        own=ca.vertcat(*(motions[a].own[0] if a in motions else zero for a in AXES)),
        own_rate=ca.vertcat(*(motions[a].own[1] if a in motions else zero for a in AXES)),
    )


def _path(path: PathShape | None, clock: Clock, parameters: Layout) -> dict[str, ca.SX]:
    """Coordinates of the axes that a path drives."""
    if path is None:
        return {}
    timing = parameters.add("segment.path", polynomial.SEGMENT_SIZE)
    needed = path.axes if path.table is None else ()
    # An arc needs both coordinates of its start even where it drives one of them.
    needed = ("x", "y") if path.kind == "arc" else needed
    start = {a: parameters.add(f"path_start.{a}") for a in needed}
    segments = (
        {a: parameters.add(f"table.{a}", polynomial.SEGMENT_SIZE) for a in path.axes}
        if path.table is not None
        else {}
    )
    return path.curve(polynomial.evaluate(timing, clock.t), start, segments)


def _force(
    name: str, plan: AxisPlan, clock: Clock, parameters: Layout, translate: Translate
) -> ca.SX:
    """The set point of an axis."""
    expression = plan.axis.force if plan.axis.force is not None else plan.axis.torque
    assert expression is not None
    return risen(name, translate(expression), plan.axis.ramp, clock, parameters)


def risen(name: str, wanted: ca.SX, ramp: float | None, clock: Clock, parameters: Layout) -> ca.SX:
    """A set point as the robot applies it, risen from the force measured at entry.

    Args:
        name: of the axis or equation. wanted: [N, N m]. ramp: [s], None for the default.
        clock: of the stage. parameters: where the force at entry takes its slot.
    """
    at_entry = parameters.add(f"force_at_entry.{name}")
    ramp = DEFAULT_RAMP if ramp is None else ramp
    share = blend.ramp_shape(clock.t / ramp) if ramp > 0 else ca.SX(1)
    return at_entry + share * (wanted - at_entry)


def _fading(name: str, clock: Clock, parameters: Layout) -> ca.SX:
    """The force that the last stage held on what is now a motion axis, as it is let go of."""
    at_entry = parameters.add(f"force_at_entry.{name}")
    return at_entry * blend.offset_shape(clock.t / blend.BLEND_TIME)


def _displacement(
    name: str,
    plan: AxisPlan,
    forces: Mapping[str, ca.SX],
    gains: Gains,
    k: float,
) -> ca.SX | None:
    """f (1/k_m + 1/k_e): how far an open-loop force displaces the motion reference."""
    if not plan.open_loop:
        return None
    own = 1 / gains["stiffness"][name].value
    contact = 1 / k if k > 0 and not name.startswith("r") else 0.0
    return forces[name] * (own + contact)


def _open_loop_normals(
    plans: Mapping[str, AxisPlan],
    at: kinematics.FrameState,
    gap: ca.SX | None,
    normal: ca.SX | None,
) -> dict[str, ca.SX]:
    """The believed gap counted along each open-loop translation."""
    if gap is None or normal is None:
        return {}
    return {
        name: gap * ca.dot(at.R[:, AXES.index(name)], normal)
        for name, plan in plans.items()
        if plan.open_loop and not name.startswith("r")
    }


def _integrate(
    plans: Mapping[str, AxisPlan],
    forces: Mapping[str, ca.SX],
    gains: Gains,
    errors: Mapping[str, ca.SX],
    table: SignalTable,
    memory: Layout,
    updates: dict[str, ca.SX],
    period: float,
    touching: ca.SX,
    unreached: Unreached,
) -> dict[str, ca.SX]:
    """Integrals of f_d - f, as the robot applies it, of the axes whose loop has one.

    They hold the tick's own measurement: a tick later, the sampled loops would bear half the gain.
    """
    integrals = {}
    for name, force in forces.items():
        if not plans[name].force or "force.integral" not in gains:
            continue
        slot = f"integral.{name}"
        motion = plans[name].motion
        integrals[name] = updates[slot] = wound(
            memory.add(slot),
            force,
            unreached.step(name, period * (force - table.scalars[applied(name)])),
            gains["force.integral"][name].value,
            touching,
            gains["stiffness"][name].value * errors[name] if motion else ca.SX(0),
        )
    return integrals


def wound(
    integral: ca.SX, force: ca.SX, step: ca.SX, rate: float, touching: ca.SX, spring: ca.SX
) -> ca.SX:
    """A force integral [N s, N m s] after one more `step`.

    In free space the error never ends. While nothing is touched, what the integral adds to the
    set point, net of a parallel law's spring, is bounded by the set point: the tool goes on to the
    surface, but does not arrive with a wound-up force.
    """
    grown = integral + step
    if rate <= 0:
        return grown
    least, most = (-ca.fabs(force) - spring) / rate, (ca.fabs(force) - spring) / rate
    return ca.if_else(touching, grown, ca.fmin(ca.fmax(grown, least), most))
