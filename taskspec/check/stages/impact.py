"""Stages that meet a surface: the peak of force there, and bounds that end them before it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.check.stages.conditions import names, value_of
from taskspec.foresight.course import moving_axes
from taskspec.foresight.flow import good_end
from taskspec.foresight.interval import Interval, IntervalAlgebra, point
from taskspec.foresight.nominal import AT_SURFACE
from taskspec.foresight.ranges import Ranges
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.spec import FILE, Stage
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.expression.tree import Held
from taskspec.text.show import inside, show

register(
    {
        "TS616": "an impact beyond the limit on force",
        "TS617": "a bound that ends a stage before it comes to its surface",
    }
)

Vector = NDArray[np.float64]

#: The peak of a critically damped impact against that of an undamped one: the least that the
#: stage that follows can make of it. Measured with designed gains: 0.42 to 0.62.
_LEAST_SHARE = math.exp(-1.0)


def check_impact(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: Vector,
    gap: float | None,
    found: Diagnostics,
) -> None:
    """Reports a stage that meets its surface faster than limits allow, or never gets there.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose.
        gap: to the nominal contact as the stage begins [m]; None where it is not known.
        found: where findings go.
    """
    _check_away(context, name, axes, rotation, gap, found)
    met = meeting(context, name, axes, rotation, gap)
    if met is None:
        return
    if gap is not None and _report_short(context, name, met.rates, gap, met.closing, found):
        return
    _report_peak(context, name, axes, rotation, met, found)


@dataclass(frozen=True, slots=True)
class Meeting:
    """A stage on its way to its surface.

    Attributes:
        contact: the object. axis: mostly along its normal, that moves. rates: (3,) constant
            velocities along the frame's axes [m/s]. closing: along the normal [m/s].
    """

    contact: str
    axis: Axis
    rates: Vector
    closing: float


def meeting(
    context: Context, name: str, axes: tuple[Axis, ...], rotation: Vector, gap: float | None
) -> Meeting | None:
    """How stage `name` comes to its surface; None where it does not, or is there already.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose.
        gap: to the nominal contact as the stage begins [m]; None where it is not known.
    """
    stage = context.loaded.task.stages[name]
    contact = context.contact_of(context.frame_of(stage))
    if contact is None or stage.until is None or (gap is not None and gap < AT_SURFACE):
        return None
    normal = context.start_normals[contact]
    rates = _rates(context, stage, axes)
    closing = -float(normal @ rotation @ rates)
    fits = {a: abs(float(normal @ rotation[:, AXES.index(a)])) for a in _moved(rates)}
    if closing <= 0:
        return None
    axis = max(fits, key=lambda a: fits[a])
    if fits[axis] < MOSTLY or not _waits_for_contact(context, name):
        return None
    return Meeting(contact, axis, rates, closing)


def _rates(context: Context, stage: Stage, axes: tuple[Axis, ...]) -> Vector:
    """(3,) constant velocities of a stage along its frame's axes [m/s]."""
    rates = np.zeros(3)
    for axis, entry in moving_axes(stage).items():
        if axis in axes[:3] and not axis.is_rotation and entry.velocity is not None:
            rates[AXES.index(axis)] = known_value(context, entry.velocity) or 0.0
    return np.where(np.isfinite(rates), rates, 0.0)


def _moved(rates: Vector) -> list[Axis]:
    return [a for a, rate in zip(AXES[:3], rates, strict=True) if rate]


def _waits_for_contact(context: Context, name: str) -> bool:
    """Whether the guard of a stage cannot hold before something is felt."""
    until = context.loaded.task.stages[name].until
    if until is None:
        return False
    felt: dict[str, Interval] = {
        str(n): point(0.0) for n in names(until.tree) if n.path[0] in ("force", "torque")
    }
    felt["touching"] = point(0.0)
    inner = until.tree.x if isinstance(until.tree, Held) else until.tree
    return value_of(inner, IntervalAlgebra(), Ranges(context, name, felt)).never


def _check_away(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: Vector,
    gap: float | None,
    found: Diagnostics,
) -> None:
    """Reports a stage that waits to feel the only object there is, and moves away from it."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    alone = len(context.start_gaps) == 1 and not loaded.task.equations
    if gap is None or gap < AT_SURFACE or not alone or loaded.task.robot.grasp is not None:
        return
    (contact,) = context.start_gaps
    rates = _rates(context, stage, axes)
    leaving = float(context.start_normals[contact] @ rotation @ rates)
    if leaving <= MOSTLY * float(np.linalg.norm(rates)) or not _waits_for_contact(context, name):
        return
    axis = max(_moved(rates), key=lambda a: abs(rates[AXES.index(a)]))
    back = -float(rates[AXES.index(axis)])
    found.warning(
        "TS617",
        f"stage {name!r} begins {show(gap, 'mm', 3)} away from {contact!r}, moves away from it and "
        "waits to feel something: its bound ends it before",
        loaded.span(FILE.stages[name].axes[axis].velocity),
        f"did you mean {show(back, 'mm/s')}? the outward normal points away from the object",
    )


def _report_short(
    context: Context, name: str, rates: Vector, gap: float, closing: float, found: Diagnostics
) -> bool:
    """Reports a bound that ends a stage before it comes to its surface; whether it did."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    frame = context.frame_of(stage)
    contact = context.contact_of(frame)
    nothing_else = len(context.start_gaps) == 1 or contact in (frame.surface_name, frame.owner)
    if stage.within is None or not nothing_else or loaded.task.equations:
        return False
    time = gap / closing
    needs = {"time": time, "travel": time * float(np.linalg.norm(rates))}
    units = {"time": "s", "travel": "mm"}
    for key, need in needs.items():
        bound = getattr(stage.within, key)
        if bound is None or bound >= need:
            continue
        found.warning(
            "TS617",
            f"stage {name!r} begins {show(gap, 'mm', 3)} away from {contact!r} and comes there "
            f"after {show(need, units[key], 3)}: this bound ends it before",
            loaded.span(FILE.stages[name].within[key]),
            f"raise it, or begin nearer to {contact!r}",
        )
        return True
    return False


def _report_peak(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: Vector,
    met: Meeting,
    found: Diagnostics,
) -> None:
    """Reports an impact beyond the limit: a mass h at speed v on a spring k makes v sqrt(h k)."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    after = good_end(loaded.task.stages, name)
    stages = [stage] if after is None else [stage, loaded.task.stages[after]]
    limits = [context.limits_of(s).force for s in stages]
    if any(most is None for most in limits):
        return
    most = max(limit for limit in limits if limit is not None)
    contact, closing = met.contact, met.closing
    h = striking_mass(context, stage, axes, rotation, met.axis)
    k, b = context.compliances[contact].stiffness, context.compliances[contact].damping
    peak = closing * max(math.sqrt(h * k), b)
    if peak <= most:
        return
    softest = min([k, *_stiffnesses(context, contact)])
    certain = _LEAST_SHARE * closing * math.sqrt(h * softest) > most
    stops = certain and context.law_of(stage).solve == "closed-form"
    slower = show(inside(closing * most / peak, upper=True, digits=2), "mm/s")
    found.add(
        Severity.ERROR if stops else Severity.WARNING,
        "TS616",
        f"stage {name!r} meets {contact!r} with {show(closing, 'mm/s', 3)}: {show(h, 'kg', 2)} on "
        f"{show(k, 'kN/m', 3)} {'make' if certain else 'may make'} about {show(peak, 'N', 3)}, and "
        f"the limit on force is {show(most, 'N')}",
        loaded.span(FILE.stages[name].axes[met.axis].velocity),
        f"approach with {slower} or less, or raise the limit",
    )


def striking_mass(
    context: Context, stage: Stage, axes: tuple[Axis, ...], rotation: Vector, axis: Axis
) -> float:
    """Mass that strikes [kg]: the arm's own along an axis, or the apparent one of its law."""
    frame, law = context.frame_of(stage), context.law_of(stage)
    felt = context.felt_stiffness(frame, axes, rotation)
    plant = context.plants(axes, rotation, felt, lever=context.lever_of(frame))[axis]
    gains = law.design({axis: stage.axes[axis]}, {axis: plant})
    own = {name: by_axis[axis] for name, by_axis in gains.items()}
    return float(law.control_law.strikes_with(own, plant.h))


def _stiffnesses(context: Context, contact: str) -> list[float]:
    """The ends that `vary` gives to a contact's stiffness [N/m]."""
    found = []
    for variation in context.loaded.task.vary.get(f"world.{contact}.stiffness", ()):
        if variation is not None:
            base = context.compliances[contact].stiffness if variation.relative else 0.0
            found += [max(0.0, base + variation.low), max(0.0, base + variation.high)]
    return found
