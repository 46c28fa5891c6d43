"""What would make a stage stable, in words, and where in the file that is."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from taskspec.geometry.axis import PAIRS
from taskspec.laws.gains import Gain
from taskspec.laws.law import gain_named
from taskspec.program.context import Context
from taskspec.spec import FILE, KeyPath, Task
from taskspec.stability.budget import Budget
from taskspec.stability.gain_paths import gain_path, law_path, together, turns
from taskspec.stability.margin import (
    BANDWIDTH,
    DELAY,
    OF_THE_ROBOT,
    PROPOSED,
    QUIET,
    STABLE,
    Limit,
    Search,
)
from taskspec.stability.sampled_stage import SampledStage
from taskspec.text.units import inside, number, scaled, sensible, show

#: No more gain changes of a stage are proposed than these.
_MOST_PROPOSED = 2
#: What is proposed is this part of a boundary of stability inside it: twice the margin within which
#: a stage counts as unstable, since the margins of other gains change with it.
_INSIDE = 0.05


def remedies(
    context: Context,
    analysed: SampledStage,
    axis: str,
    task: Task | None,
    budget: Budget,
    *,
    ringing: bool,
) -> list[Limit]:
    """What would stabilise a stage: gains of the file before designed ones, a softer contact.

    Under a servo it is what makes the stage quiet, too, and while friction holds its tool as well,
    as far as that is possible: a loop that is just stable rings.

    Args:
        context: the task.
        analysed: the stage.
        axis: that moves most.
        task: whose world and robot are true; None for the nominal ones.
        budget: of gains that may be searched.
        ringing: whether it rings; else it is unstable.
    """
    search = Search(context, analysed, task, QUIET if ringing else STABLE, budget=budget)
    if context.loaded.task.robot.takes_torques:
        best = _best(analysed, search, axis)
        return best if ringing else [_well_inside(limit) for limit in best]
    stuck = None if analysed.sticking else analysed.stuck()
    quiet = replace(search, good=QUIET)
    ways = [quiet, search] if stuck is None else [replace(quiet, beside=(stuck,)), quiet, search]
    designed = _designed_damping(analysed, axis)
    for way in ways:
        best = _best(analysed, way, axis)
        if not designed and budget.take():
            best += [each for each in way.robot() if each.what != BANDWIDTH and each.value > 0]
        if best:
            return [_well_inside(limit) for limit in best]
    return []


def _best(analysed: SampledStage, search: Search, axis: str) -> list[Limit]:
    """Changes of gains, and of the stiffness of contacts, of one kind of search."""
    best = list(itertools.islice(_gains(analysed, search, axis), _MOST_PROPOSED))
    takes_torques = analysed.context.loaded.task.robot.takes_torques
    if not takes_torques and _designed_damping(analysed, axis):
        return best
    for name in analysed.pressed:
        left = search.budget is None or search.budget.left > 0
        if search.task is None and name in analysed.context.surfaces and left:
            limit = search.stiffness(name)
            best += [limit] if limit is not None and limit.upper else []
    return best


def _designed_damping(analysed: SampledStage, axis: str) -> bool:
    """Whether an axis has a designed damping: under a servo contact and delays would change it."""
    gains = [analysed.stage.plan.gains.get(what, {}) for what in ("damping", "force.damping")]
    return any(axis in by and by[axis].origin != "file" for by in gains)


def _well_inside(limit: Limit) -> Limit:
    if limit.what == DELAY:
        return limit  # A tick more is not stable: it is inside by a part of one.
    factor = 1 - _INSIDE if limit.upper else 1 / (1 - _INSIDE)
    return replace(limit, value=factor * limit.value)


def _gains(analysed: SampledStage, search: Search, axis: str) -> Iterator[Limit]:
    """Boundaries of gains in the best group that has any: one number, else one on all axes."""
    others = [
        other
        for other in dict.fromkeys(a for by in analysed.stage.plan.gains.values() for a in by)
        if other != axis and other not in PAIRS
    ]
    ways = [
        search.gains([axis], given=True),
        search.gains(others, given=True),
        search.everywhere(axis, given=True),
        search.gains([axis], given=False),
        search.everywhere(axis, given=False),
    ]
    for found in ways:
        way = (limit for limit in found if _sensible(analysed.context, limit))
        first = next(way, None)
        if first is not None:
            yield first
            yield from way
            return


def _sensible(context: Context, limit: Limit) -> bool:
    """Whether the value at a boundary is one that a gain can have."""
    angular = bool(limit.on) and turns(context, limit.on[0])
    return sensible(limit.value, gain_named(limit.what).dimension.on(rotation=angular))


def text_of(context: Context, analysed: SampledStage, limit: Limit) -> str:
    """A boundary as a change of the file, in words."""
    way = "up to" if limit.upper else "from"
    if limit.what in OF_THE_ROBOT:
        value = limit.value if limit.what == DELAY else inside(limit.value, limit.upper)
        return f"{limit.what} {way} {scaled(value, OF_THE_ROBOT[limit.what], 3)}"
    if not limit.on:
        return _softer(context, limit)
    what = "damping" if limit.what == "joint_damping" else limit.what
    gains, first = analysed.stage.plan.gains[limit.what], limit.on[0]
    if set(limit.on) != set(together(context, analysed, limit.what, first)):
        what += " on all its axes"
        if len({(gains[on].value, turns(context, on)) for on in limit.on}) > 1:
            factor = inside(limit.value / limit.now, limit.upper)
            if not limit.given:
                return f"{limit.what} {way} {_each(context, gains, limit, factor)}"
            return f"{what} {way} {number(factor, 3)} times what it is"
    value = inside(limit.value, limit.upper)
    return f"{what} {way} {gain_named(limit.what).setting(value, angular=turns(context, first))}"


def _each(context: Context, gains: Mapping[str, Gain], limit: Limit, factor: float) -> str:
    """The values of a designed gain on all its axes, as the file would have them."""
    unit = gain_named(limit.what)
    values = {on: inside(factor * gains[on].value, limit.upper) for on in limit.on}
    texts = (f"{on}: {unit.setting(v, angular=turns(context, on))}" for on, v in values.items())
    return f"{{{', '.join(texts)}}}"


def _softer(context: Context, limit: Limit) -> str:
    """A softer contact, and for an arm that takes no torques the pad that makes it so.

    Of a pad and what is under it 1/k = 1/k_pad + 1/k_under.
    """
    softer = inside(limit.value, limit.upper)
    text = f"a contact of up to {show(softer, 'kN/m', 3)}"
    if context.loaded.task.robot.takes_torques or softer >= limit.now:
        return text
    pad = inside(softer * limit.now / (limit.now - softer), upper=True)
    return f"{text}, as a pad of {show(pad, 'kN/m', 3)} on it makes it"


def place_of(
    context: Context, analysed: SampledStage, axis: str, limits: Sequence[Limit]
) -> KeyPath:
    """The gain to be changed, if it stands in the file, else any on the axis, else the law."""
    gains, name = analysed.stage.plan.gains, analysed.stage.name
    wanted = [(limit.what, limit.on[0]) for limit in limits if limit.given and limit.on]
    wanted += [
        (g, axis) for g in PROPOSED if axis in gains.get(g, {}) and gains[g][axis].origin == "file"
    ]
    for what, on in wanted:
        return gain_path(context, name, what, on)
    law = law_path(context, name)
    if law == FILE.law and "law" not in context.loaded.root.entries:
        return FILE.stages[name].axes[axis]
    return law
