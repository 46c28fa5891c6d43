"""Force set points of axes: how they rise, fade and displace, and the integrals of their errors."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import value_of
from taskspec.laws.tank import SHARE
from taskspec.modes import DEFAULT_RAMP
from taskspec.motion import blend
from taskspec.program.clock import Clock
from taskspec.program.held_part import HeldPart
from taskspec.program.plan import StagePlan
from taskspec.program.reference.axis_plan import AxisPlan
from taskspec.program.reference.measurement import Measurement
from taskspec.program.signals import applied
from taskspec.program.slots import Slots


def set_point(name: Axis, plan: AxisPlan, measurement: Measurement) -> ca.SX:
    """The set point of an axis."""
    force = plan.axis.set_point
    assert force is not None
    if force.kept:
        wanted = measurement.parameters.add(kept_slot(name))
    else:
        wanted = measurement.translate(force.wanted)
    return risen(name, wanted, force.ramp, measurement.clock, measurement.parameters)


def kept_slot(name: Axis) -> str:
    """The parameter with the set point that an axis keeps [N, N m]."""
    return f"kept.{name}"


def risen(name: str, wanted: ca.SX, ramp: float | None, clock: Clock, parameters: Slots) -> ca.SX:
    """A set point as the robot applies it, risen from the force measured at entry.

    Args:
        name: of the axis or equation.
        wanted: [N, N m].
        ramp: [s], None for the default.
        clock: of the stage.
        parameters: where the force at entry takes its slot.
    """
    at_entry = parameters.add(f"force_at_entry.{name}")
    ramp = DEFAULT_RAMP if ramp is None else ramp
    share = blend.ramp_shape(clock.t / ramp) if ramp > 0 else ca.SX(1)
    return at_entry + share * (wanted - at_entry)


def released(name: Axis, measurement: Measurement) -> ca.SX:
    """The force that the last stage held on what is now a motion axis, as it fades out."""
    at_entry = measurement.parameters.add(f"force_at_entry.{name}")
    return at_entry * blend.offset_shape(measurement.clock.t / blend.BLEND_TIME)


def open_loop_normals(plan: StagePlan, measurement: Measurement) -> dict[Axis, ca.SX]:
    """The nominal gap of its contact counted along each open-loop translation.

    Of a loose body that the tool holds, as it is held when the run begins: that is what touches.
    """
    part = HeldPart.of(plan.context)
    tool = plan.context.start_gaps

    def gap(contact: str) -> ca.SX:
        nearer = 0.0 if part is None else part.below(contact, tool[contact])
        return measurement.gaps[contact] - nearer

    return {
        name: gap(contact)
        * ca.dot(measurement.at.R[:, AXES.index(name)], measurement.normals[contact])
        for name, axis in plan.plans.items()
        if axis.open_loop and not name.is_rotation and (contact := plan.contacts.of(name))
    }


def integrals(
    plan: StagePlan,
    measurement: Measurement,
    forces: Mapping[Axis, ca.SX],
    errors: Mapping[Axis, ca.SX],
) -> dict[Axis, ca.SX]:
    """Integrals of f_d - f, as the robot applies it, of the axes whose loop has one.

    They hold the tick's own measurement: a tick later, the sampled loops would bear half the gain.
    """
    context = plan.context
    gains, table = plan.gains, measurement.table
    # What is held is touched, whatever little force passes.
    touching = ca.SX(1) if plan.contacts.gripped else table["touching"]
    found = {}
    for name, force in forces.items():
        if not plan.plans[name].force or "force.integral" not in gains:
            continue
        missing = force - table[applied(name)]
        motion = plan.plans[name].motion
        step = measurement.infeasible.step(name, context.period * missing)
        if plan.law.tank is not None:
            # What a tank refuses does not wind it up.
            step = step * measurement.memory.once(SHARE)
        found[name] = wound(
            measurement.memory.add(f"integral.{name}"),
            force,
            step,
            value_of(gains, "force.integral", name),
            touching,
            value_of(gains, "stiffness", name) * errors[name] if motion else ca.SX(0),
        )
    return found


def wound(
    integral: ca.SX, force: ca.SX, step: ca.SX, rate: float | ca.SX, touching: ca.SX, spring: ca.SX
) -> ca.SX:
    """A force integral [N s, N m s] after one more `step`.

    In free space the error never ends. While nothing is touched, what the integral adds to the
    set point, net of a parallel law's spring, is bounded by the set point: the tool goes on to the
    surface, but does not arrive with a wound-up force. The bound takes off what has grown; it
    never makes an integral, which would hold a motion against its own spring.
    """
    grown = integral + step
    # A gain that is an expression is positive; see `tunable`.
    if not isinstance(rate, ca.SX) and rate <= 0:
        return grown
    least, most = (-ca.fabs(force) - spring) / rate, (ca.fabs(force) - spring) / rate
    held = ca.fmin(ca.fmax(grown, ca.fmin(least, 0.0)), ca.fmax(most, 0.0))
    return ca.if_else(touching, grown, held)
