"""The energy tank of a stage, as `explain` has it: its size, what is taken, the first contact."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.plan import StagePlan
from taskspec.statics.tank_demand import first_contact, tank_demand
from taskspec.text.units import POWER, VELOCITY, joules, scaled


def tank_rows(plan: StagePlan) -> Iterator[tuple[str, str]]:
    """What a tank holds, what its stage takes at least, and how it bounds the first contact."""
    tank, demand = plan.law.tank, tank_demand(plan)
    if tank is None or demand is None:
        return
    begins = (
        f"begins with what the stage before has left, at most {joules(demand.there)}"
        if demand.continues
        else f"begins with {joules(demand.there)}"
    )
    lets = "" if tank.power is None else f"; at most {scaled(tank.power, POWER, 3)} leave it"
    yield "tank", f"holds {joules(tank.energy)}, {begins}{lets}"
    if demand.energy > 0:
        yield "takes of it", f"about {joules(demand.energy)}"
    contact = first_contact(plan)
    if contact is not None:
        speed, power = scaled(contact.speed, VELOCITY, 3), scaled(contact.power, POWER, 3)
        yield (
            "first contact",
            f"from rest along {contact.axis} with at most {speed}; {contact.contact} takes at most "
            f"{power} of it",
        )
