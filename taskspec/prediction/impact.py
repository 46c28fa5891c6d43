"""The peak of force where a stage meets its surface."""

from __future__ import annotations

from dataclasses import replace

from taskspec.foresight.approach import approach, striking_mass
from taskspec.laws.gains import on_axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.types import Impact
from taskspec.prediction.worlds import extreme


def impact(here: StageAtStart) -> Impact | None:
    """The impact of a stage; None where it meets nothing that it knows of."""
    context, stage = here.context, here.stage
    met = approach(stage.plan, here.gap)
    if met is None:
        return None
    contact = context.compliances[met.contact]
    found = Impact(
        contact=met.contact,
        axis=met.axis,
        speed=met.closing,
        mass=striking_mass(stage.plan, met.axis),
        stiffness=contact.stiffness,
        damping=contact.damping,
        drag=stage.plan.law.control_law.drag(on_axis(stage.plan.gains, met.axis)),
    )
    worst = extreme(context, met.contact, lambda world: found.peak_on(world.stiffness), abs)
    return replace(found, worst=worst)
