"""The peak of force where a stage meets its surface."""

from __future__ import annotations

from dataclasses import replace

from taskspec.foresight.approach import approach, striking_mass
from taskspec.laws.gains import on_axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.forecast import arrival
from taskspec.prediction.types import Impact
from taskspec.prediction.worlds import extreme


def cut_short(here: StageAtStart, met: Impact, lasts: float | None) -> Impact:
    """An impact, and what its stage has of it when the guard ends that.

    A guard that holds before the peak leaves that to the next stage; in a stage that goes on after
    it, its motion presses more.

    Args:
        here: the stage.
        met: the impact.
        lasts: when its guard first holds [s]; None where that is not known.
    """
    context = here.context
    own = here.stage.plan.spring_of(met.axis, met.mass)
    if lasts is None or here.gap is None or met.drag is None or own <= 0:
        return met
    # A guard is looked at once a tick.
    since = lasts - arrival(here, met, own) + context.period
    reached = met.until(since)
    if reached >= met.peak:
        # The reference goes on meanwhile, and stretches contact and spring.
        reached += met.speed * since / (1 / met.stiffness + 1 / own)
    return replace(met, ended=reached)


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
