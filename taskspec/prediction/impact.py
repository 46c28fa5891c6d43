"""The peak of force where a stage meets its surface."""

from __future__ import annotations

from dataclasses import replace

from taskspec.check.stages.impact import meeting, striking_mass
from taskspec.geometry.axis import Axis
from taskspec.prediction.begin import Begin
from taskspec.prediction.types import Impact
from taskspec.prediction.worlds import extreme
from taskspec.spec import LAWS

#: Laws for set points, (4.21) and (4.50): -D x' in place of D e'.
_SET_POINT_LAWS = ("pd", "parallel-pid")


def impact(begin: Begin) -> Impact | None:
    """The impact of a stage; None where it meets nothing that it knows of."""
    context, stage = begin.context, begin.stage
    met = meeting(context, stage.name, stage.axes, begin.rotation, begin.gap)
    if met is None:
        return None
    contact = context.compliances[met.contact]
    found = Impact(
        contact=met.contact,
        axis=met.axis,
        speed=met.closing,
        mass=striking_mass(context, stage.spec, stage.axes, begin.rotation, met.axis),
        stiffness=contact.stiffness,
        damping=contact.damping,
        drag=_drag(begin, met.axis),
    )
    worst = extreme(context, met.contact, lambda world: found.peak_on(world.stiffness), abs)
    return replace(found, worst=worst)


def _drag(begin: Begin, axis: Axis) -> float | None:
    """Damping of an axis against its velocity itself, not its error [N s/m]; None if on joints."""
    facts = LAWS[begin.stage.law.kind]
    if facts.damps_joints or facts.bare:
        return None
    if begin.stage.law.kind in _SET_POINT_LAWS:
        return begin.stage.gains["damping"][axis].value
    return 0.0
