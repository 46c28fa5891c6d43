"""Energy tanks: what a stage takes from its own, and stages that nobody pays for."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.flow import followers
from taskspec.program.kept_forces import before
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, info, rule, warning
from taskspec.spec import FILE
from taskspec.stability.gain_paths import law_path
from taskspec.statics.tank_demand import has_tank, tank_demand
from taskspec.text.units import POWER, joules, scaled


@rule(
    {
        "TS511": "an energy tank too small for its stage",
        "TS512": "a limit on the power below what a reference needs",
    }
)
def small_tanks(stage: StagePlan) -> Iterator[Finding]:
    """Tanks with less than their stage takes by its text, and limits that hold its reference back.

    What dampers take comes back to a tank; what moves the arm, is pressed into a surface or rubbed
    off does not before it is over.
    """
    demand, tank = tank_demand(stage), stage.law.tank
    if demand is None or tank is None or stage.joint_path is not None:
        return
    place = law_path(stage.context, stage.name).tank
    if demand.energy > demand.there:
        parts = {
            "to move the arm": demand.moving,
            "to press": demand.pressing,
            "against friction": demand.rubbing,
        }
        said = ", ".join(f"{joules(v)} {what}" for what, v in parts.items() if v > 0)
        yield warning(
            "TS511",
            f"stage {stage.name!r} takes about {joules(demand.energy)} from its tank, which has at "
            f"most {joules(demand.there)} as it begins: {said}",
            place,
            f"give it more than {joules(demand.energy)}, or move more slowly and press less",
        )
    if tank.power is not None and demand.power > tank.power:
        needs, lets = (scaled(v, POWER, 3) for v in (demand.power, tank.power))
        yield warning(
            "TS512",
            f"the reference of stage {stage.name!r} needs up to {needs}, and its tank lets {lets} "
            "out: the tool stays behind",
            place,
            "let it move more slowly, or more power out",
        )


@rule("TS343", "a stage without an energy tank between stages with one")
def unpaid_stages(stage: StagePlan) -> Iterator[Finding]:
    """Stages without a tank that come from one with a tank and lead to one: that begins anew."""
    task = stage.context.loaded.task
    if not task.tanks or has_tank(task, stage.name):
        return
    earlier = [each for each in before(task, stage.name) if has_tank(task, each)]
    after = followers(task, stage.name)
    later = [each for each in task.stages if each in after and has_tank(task, each)]
    if earlier and later:
        yield info(
            "TS343",
            f"nobody pays for what stage {stage.name!r} puts into the arm, and the tank of "
            f"{later[0]!r} begins anew after it",
            FILE.stages[stage.name],
            "give its law a tank, too, where the whole run is to stay passive",
        )
