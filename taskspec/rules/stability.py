"""Stages whose sampled closed loop is predicted to be unstable, or to ring."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.program.components import ends
from taskspec.program.context import Context
from taskspec.program.flow import followers, reached
from taskspec.program.passage import End, Instant
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.world.stiffness import RESOLVED_PHASE, mass_along
from taskspec.rules import Finding, Phase, info, rule, warning
from taskspec.rules.remedies import place_of, remedies, text_of
from taskspec.rules.set_points import in_the_air
from taskspec.spec import FILE, KeyPath, Task, below
from taskspec.stability.budget import Budget
from taskspec.stability.corners import Corner, at, corners
from taskspec.stability.environment import linear_plant
from taskspec.stability.gain_paths import law_path
from taskspec.stability.loop import FARTHEST, Mode, Poles, UnfitError
from taskspec.stability.margin import (
    LEAST_DAMPING_RATIO,
    LEAST_GROWTH,
    QUICK,
    Search,
    grows,
    near_boundary,
    rings,
)
from taskspec.stability.plant import LinearPlant, pressing
from taskspec.stability.sampled_stage import SampledStage, control_of, loop_of
from taskspec.text.diagnostic import Severity
from taskspec.text.units import FREQUENCY, STIFFNESS, TIME, number, scaled, show

#: So many gains are searched for remedies in a file: a third of a second's work.
_MOST_SEARCHED = 12
#: So many worlds of a file are looked at all at once, a third of a second's work; beyond that one
#: value varies at a time.
_MOST_WORLDS = 400
#: A varied value is left out of a message if without it a mode grows, or is damped, as much.
_AS_MUCH = 0.95
#: An arm of which no joint has moved, and at which no contact has turned, by more than this acts
#: as at its start [rad, m].
_FAR = 0.3
#: Parts of a stage's way after which it is looked at: what is farthest from its middle first.
_PLACES = (0.0, 1.0, 0.5, 0.25, 0.75)
#: Ends of a way on which a stage comes to where it leads.
_GOES_THERE = (End.DONE, End.BOUND, End.STOP)
#: How much more a force across the normal counts than one along it.
_ALONG = 1e6
#: From this part of the sampling rate on, a swing is a flip from tick to tick.
_FLIPS = 0.4
#: Gains between those that a stage begins with and those for an end of its estimate.
_ON_THE_WAY = 7
#: What swings up by less until the stiffness is known begins below what a contact is met with.
_SWINGS_UP = 10.0
#: Codes of stages that ring.
_RINGING = ("TS502", "TS504")
#: A swing that changes more slowly than this [1/s] neither grows nor dies away in any run.
_STEADY = 1e-3


class Plants:
    """Arm and contacts of worlds, which stages that touch the same have in common."""

    def __init__(self) -> None:
        self._known: dict[object, LinearPlant] = {}

    def under(self, sampled: SampledStage, corner: Corner) -> LinearPlant:
        """The plant that a stage drives in a world."""
        sliding = None if sampled.sliding is None else tuple(sampled.sliding)
        arm = sampled.context.start.tobytes()
        turns = sampled.turns.tobytes()
        key = (arm, tuple(sampled.pressed), sampled.sticking, sliding, turns, corner.plant)
        if key not in self._known:
            ones = dict.fromkeys(sampled.pressed, 1.0)
            self._known[key] = linear_plant(
                sampled.context,
                corner.task,
                ones,
                sticking=sampled.sticking,
                sliding=sampled.sliding,
                turns=sampled.turns,
            )
        return pressing(self._known[key], sampled.pressed)


@dataclass(frozen=True, slots=True)
class Shared:
    """What the stages of a file have in common.

    Attributes:
        context: the task.
        plants: of worlds.
        gains: that may still be searched.
        worlds: that may still be looked at.
        reported: codes with their places.
        swings_for: how long the control that is looked at lasts, in all its stages [s].
    """

    context: Context
    plants: Plants = field(default_factory=Plants)
    gains: Budget = field(default_factory=lambda: Budget(_MOST_SEARCHED))
    worlds: Budget = field(default_factory=lambda: Budget(_MOST_WORLDS))
    reported: set[tuple[str, KeyPath]] = field(default_factory=set)
    swings_for: float = math.inf


#: What swings less often than this while its control lasts does not ring.
_FEWEST_SWINGS = 2.0
#: Friction bounds what it holds: across forces a mode that is gone to a hundredth within a second,
#: and that takes no more than the cone bears, does nothing [1/s].
_QUICK_STUCK = 4.6
#: What leaves its place has hardly an imaginary part, and is an error from so many doublings on.
_STEADY, _DOUBLINGS = 1e-3, 5.0


@rule(
    {
        "TS501": "a stage that is predicted to be unstable",
        "TS502": "a stage that is predicted to ring",
        "TS503": "a stage that is unstable in a world that `vary` allows",
        "TS504": "a stage that rings in a world that `vary` allows",
        "TS505": "a contact in which a motion would be unstable",
        "TS506": "a stage that is unstable while friction holds the tool",
        "TS507": "a stage that only friction keeps stable",
        "TS515": "a stage whose gains do not hold at an end of the stiffness that it estimates",
        "TS516": "a stage that swings up before it has estimated how stiff its contact is",
    },
    also=("TS307",),
    phase=Phase.STABILITY,
    predicts=("TS501", "TS502", "TS505", "TS506", "TS507"),
)
def unstable_stages(task: TaskPlan) -> Iterator[Finding]:
    """Stages that are predicted to be unstable or to ring, each way of control once."""
    controls: set[str] = set()
    shared = Shared(task.context)
    lasting = _lasting(task)
    for stage in task.stages.values():
        control = control_of(stage)
        if stage.joint_path is not None:
            continue  # Of a path of joints it is that of its law, whatever is near.
        if stage.frame.tracking is not None:
            continue  # Its axes turn with what it feels: the trial shows them.
        of_this = replace(shared, swings_for=lasting[control])
        try:
            if control in controls:
                yield from _elsewhere(task, stage, of_this)
            else:
                controls.add(control)
                yield from _of_stage(task, stage, of_this)
        except (UnfitError, np.linalg.LinAlgError):
            continue


def _lasting(task: TaskPlan) -> dict[str, float]:
    """How long each way of control lasts at most, in all stages that have it [s]."""
    spec = task.context.loaded.task
    found: dict[str, float] = defaultdict(float)
    for name, stage in task.stages.items():
        again = stage.spec.repeat > 1 or name in reached(spec, followers(spec, name))
        found[control_of(stage)] += math.inf if again else stage.longest
    return found


def _of_stage(task: TaskPlan, stage: StagePlan, shared: Shared) -> Iterator[Finding]:
    analysed = loop_of(task, stage.name)
    if analysed is None or not resolved(analysed, stage.context.loaded.task):
        return
    if analysed.meets:
        free = _in_the_world_of_the_file(analysed.free(), None, shared, stage.longest)
        yield from _in_contact(analysed, shared) if free is None else free
        return
    if _stays_off(stage, analysed):
        yield from _in_the_world_of_the_file(analysed.free(), None, shared) or ()
        return
    stuck = analysed.stuck()
    here = _in_the_world_of_the_file(analysed, stuck, shared)
    if here is not None:
        yield from here
        return
    there = _where_it_leads(stage, analysed, shared) or _at_other_gains(analysed, shared)
    if there is None and analysed.estimating:
        yield from _while_estimating(analysed, shared)
    yield from _in_other_worlds(analysed, shared) if there is None else there


def _at_other_gains(analysed: SampledStage, shared: Shared) -> Iterator[Finding] | None:
    """What is unstable, or rings, at an end of the range of gains that vary; None where nothing is.

    The loops are those of gains that stay where they are: what their change adds, the trial shows.
    """
    name = analysed.stage.name
    for which, other in analysed.at_ends():
        modes = other.modes()
        worst, ringing = worst_of(modes), ringing_of(_swinging(modes, shared))
        where = f"at the {which} of its gains"
        if worst is not None and grows(worst):
            text = f"stage {name!r} is unstable {where}"
            return _findings(other, modes, worst, shared, "TS501", Severity.WARNING, text)
        if ringing is not None:
            text = f"stage {name!r} rings {where}"
            return _findings(other, modes, ringing, shared, "TS502", Severity.WARNING, text)
    return None


def _while_estimating(analysed: SampledStage, shared: Shared) -> Iterator[Finding]:
    """A stage on the softest and the stiffest contact of its estimate, and on its way there."""
    name, axes = analysed.stage.name, analysed.stage.plan.estimates.axes
    place = below(law_path(shared.context, name), "estimate")
    each = next(iter(axes.values()))
    for end in (each.low, each.high):
        task, shown = analysed.on(end), scaled(end, STIFFNESS, 3)
        if not resolved(analysed, task):
            yield info(
                "TS515",
                f"stage {name!r} is not examined on a contact of {shown}: a step of the plant does "
                "not resolve that",
                place,
                "raise control.plant_rate, or narrow the bounds of the estimate",
            )
            continue
        modes = analysed.modes(task)
        worst, ringing = worst_of(modes), ringing_of(_swinging(modes, shared))
        if worst is not None and grows(worst):
            text = f"stage {name!r} is unstable on a contact of {shown}, with the gains for that"
            swings = worst
        elif ringing is not None:
            text = f"stage {name!r} rings on a contact of {shown}, with the gains for that"
            swings = ringing
        else:
            yield from _until_estimated(analysed, end, task, place, shared)
            continue
        axis, period = analysed.axis(swings, modes), shared.context.period
        yield warning(
            "TS515", f"{text}: {on_axis(axis)} {describe(swings, period)}", place,
            "narrow the bounds of the estimate to what the contact may be",
        )  # fmt: skip


def _until_estimated(
    analysed: SampledStage, end: float, task: Task, place: KeyPath, shared: Shared
) -> Iterator[Finding]:
    """How much a swing grows on a contact at an end, while the gains go there from the declared."""
    plan = analysed.stage.plan
    each = next(iter(plan.estimates.axes.values()))
    way = math.log(end / each.declared)
    plant, neutral = analysed.plant(task), FARTHEST / shared.context.period
    on_way = [each.declared * math.exp(way * share) for share in np.linspace(0, 1, _ON_THE_WAY)]
    rates = []
    for k in on_way:
        there = analysed.designed_for(dict.fromkeys(plan.estimates.axes, k))
        growth, _ = _suspected(there.poles(task, plant), neutral)
        rates.append(max(growth, 0.0))
    grown = rates[0] * each.found_after + float(np.mean(rates)) * abs(way) / each.rate
    if grown <= math.log(_SWINGS_UP):
        return
    holds = [k for k, rate in zip(on_way, rates, strict=True) if rate < LEAST_GROWTH]
    least = holds[0] if holds else end
    first, last = (scaled(k, STIFFNESS, 3) for k in (each.declared, end))
    yield warning(
        "TS516",
        f"stage {analysed.stage.name!r} begins with gains for {first}: on a contact of {last} a "
        f"swing grows {number(math.exp(grown), 2)}-fold before its gains are those for that",
        place,
        "declare the stiffest contact that there may be, of at least "
        f"{scaled(least, STIFFNESS, 3)}; the gains for it hold on a softer one",
    )


def _elsewhere(task: TaskPlan, stage: StagePlan, shared: Shared) -> Iterator[Finding]:
    """What is unstable far on the way of a stage whose control an earlier one has."""
    analysed = loop_of(task, stage.name)
    if analysed is None or analysed.meets or not resolved(analysed, stage.context.loaded.task):
        return
    if not _stays_off(stage, analysed):
        yield from _where_it_leads(stage, analysed, shared) or ()


def _where_it_leads(
    stage: StagePlan, analysed: SampledStage, shared: Shared
) -> Iterator[Finding] | None:
    """What is unstable where the way of a stage leads, if that is far; None where nothing is."""
    passage = stage.nominal.passage if stage.followed else None
    if passage is None or not (analysed.pressed or stage.contacts.held):
        return None
    if passage.end not in _GOES_THERE:
        return None  # What stops the run on its way is told by itself.
    found = [
        (worst.s.real, here, moved, modes, worst)
        for here in _apart(analysed, passage.instants)
        for moved in [analysed.there(here)]
        for modes in [moved.modes()]
        for worst in modes[:1]
        if moved.controller.finite and grows(worst)
    ]
    if not found:
        return None
    rate, here, moved, modes, worst = max(found, key=lambda each: each[0])
    if rate * stage.longest <= math.log(2):
        return None
    unresolved = [*_unresolved(analysed, here)]
    if unresolved:
        return iter(unresolved)
    where = "where it begins" if here is passage.instants[0] else here.words
    text = f"stage {stage.name!r} is unstable {where}, as far as the arm has gone by then"
    return _findings(moved, modes, worst, shared, "TS501", Severity.WARNING, text)


def _apart(analysed: SampledStage, on_way: Sequence[Instant]) -> Iterator[Instant]:
    """Instants of a stage's way at which arm or contacts are far from where they were looked at."""
    looked = [analysed.place(analysed.context.start, analysed.context.start_p)]
    for part in _PLACES:
        here = on_way[int(part * (len(on_way) - 1))]
        place = analysed.place(here.q, here.p)
        if not any(place.like(other, _FAR) for other in looked):
            looked.append(place)
            yield here


def _unresolved(analysed: SampledStage, here: Instant) -> Iterator[Finding]:
    """Contacts that the plant's steps resolve where the stage begins, but not on its way."""
    context, robot = analysed.context, analysed.context.robot
    begins = analysed.place(context.start, context.start_p)
    for name, normal in analysed.place(here.q, here.p).normals.items():
        contact = context.compliances[name]
        change = mass_along(robot, here.q, normal) / mass_along(
            robot, context.start, begins.normals[name]
        )
        phase = contact.phase / math.sqrt(change)
        if phase > RESOLVED_PHASE:
            most = contact.stiffness * (RESOLVED_PHASE / phase) ** 2
            yield warning(
                "TS307",
                f"{name!r} is stiffer than the plant's steps resolve {here.words} of stage "
                f"{analysed.stage.name!r}: up to {show(most, 'kN/m', 3)} there, where the arm is "
                "lighter along its normal",
                FILE.world[name].stiffness,
                "raise control.plant_rate, or write `rigid`",
            )


def _stays_off(stage: StagePlan, analysed: SampledStage) -> bool:
    """Whether a stage never gets to the only contact that it is analysed on."""
    if not stage.followed or [*analysed.pressed] != [stage.contacts.main]:
        return False
    return any(gap > speed * stage.longest for _, gap, speed in in_the_air(stage))


def _in_the_world_of_the_file(
    analysed: SampledStage,
    stuck: SampledStage | None,
    shared: Shared,
    lasts: float = math.inf,
) -> Iterator[Finding] | None:
    """What is unstable, or else rings, in the world of the file; None where nothing does.

    Args:
        analysed: the stage while its tool slides.
        stuck: the same while friction holds the tool; None where there is none.
        shared: what the stages of the file have in common.
        lasts: what takes longer to double than this is over before it matters, and no error [s].
    """
    name = analysed.stage.name
    sliding, sticking = analysed.modes(), () if stuck is None else stuck.modes()
    worst, held = worst_of(sliding), worst_of(sticking)
    if worst is not None and grows(worst):
        if stuck is not None and not _grows(held) and stays_put(analysed):
            text = f"stage {name!r} would be unstable if the tool slid; friction holds it"
            return _findings(analysed, sliding, worst, shared, "TS507", Severity.WARNING, text)
        text = f"stage {name!r} is unstable"
        slow = math.log(2) > lasts * worst.s.real or _creeps_away(worst, analysed)
        severity = Severity.WARNING if slow else Severity.ERROR
        return _findings(analysed, sliding, worst, shared, "TS501", severity, text)
    close = _on_the_boundary(analysed, sliding)
    if close is not None and (stuck is None or not stays_put(analysed)):
        text = f"stage {name!r} is on the boundary of stability"
        return _findings(analysed, sliding, close, shared, "TS501", Severity.ERROR, text)
    if stuck is not None and held is not None and grows(held):
        text = f"stage {name!r} is unstable while friction holds the tool"
        return _findings(stuck, sticking, held, shared, "TS506", Severity.WARNING, text)
    ringing = ringing_of(_swinging(sliding, shared))
    if ringing is not None:
        text = f"stage {name!r} rings"
        return _findings(analysed, sliding, ringing, shared, "TS502", Severity.WARNING, text)
    if stuck is None:
        return None
    found = [mode for mode in _swinging(sticking, shared) if not _flips(mode, analysed)]
    pushed = analysed.stage.plan.set_points.constant
    ringing = ringing_of(
        [m for m in found if stuck.axis(m, sticking) in pushed or rings(m, _QUICK_STUCK)]
    )
    if ringing is not None:
        text = f"stage {name!r} rings while friction holds the tool"
        return _findings(stuck, sticking, ringing, shared, "TS502", Severity.WARNING, text)
    return None


def _swinging(modes: Sequence[Mode], shared: Shared) -> list[Mode]:
    """The modes that have the time to swing."""
    return [m for m in modes if m.frequency > _FEWEST_SWINGS / shared.swings_for]


def _creeps_away(mode: Mode, analysed: SampledStage) -> bool:
    """Whether a mode leaves its place without ringing, and hardly so while its stage lasts.

    So does a tool that is pushed along a hill: it is its way, and no loop is at fault.
    """
    steady = abs(mode.s.imag) < _STEADY * mode.s.real
    return steady and mode.s.real * analysed.stage.plan.longest < _DOUBLINGS * math.log(2)


def _flips(mode: Mode, analysed: SampledStage) -> bool:
    """Whether a mode alternates from tick to tick: what the simulator makes of friction does."""
    return mode.frequency > _FLIPS / analysed.context.period


def _grows(mode: Mode | None) -> bool:
    return mode is not None and grows(mode)


def _on_the_boundary(analysed: SampledStage, modes: Sequence[Mode]) -> Mode | None:
    """A mode that one gain, moved by no more than `MARGIN`, would make grow."""
    for mode in modes:
        if near_boundary(mode) and Search(analysed.context, analysed).near(
            analysed.axis(mode, modes)
        ):
            return mode
    return None


def stays_put(analysed: SampledStage) -> bool:
    """Whether friction holds the tool of a stage: it drives nothing across, nor pushes so hard.

    Axes that hold their place return any force. The contact is in its cone if there is one in there
    that has the set points on the other axes.
    """
    stage = analysed.stage.plan
    if stage.path is not None or any(not _still(stage, axis) for axis in stage.translations):
        return False
    context = stage.context
    forced = [
        a for a in stage.translations if a in stage.spec.axes and stage.spec.axes[a].has_force
    ]
    wanted = [stage.set_points.of(axis) for axis in forced]
    if None in wanted or len(analysed.pressed) != 1:
        return False
    [name] = analysed.pressed
    if not forced or name not in context.surfaces:
        return False
    normal = stage.contacts.normal(name)
    ways = np.vstack([-normal, np.linalg.svd(normal[None, :])[2][1:]])
    rows = (ways @ analysed.rotation[:, [axis.row for axis in forced]]).T
    # Of all such forces the one that is least across: along the normal it counts for nothing.
    weights = np.array([_ALONG, 1.0, 1.0])
    along, *across = weights * (np.linalg.pinv(rows * weights) @ np.array(wanted, dtype=float))
    return float(np.linalg.norm(across)) < _least_friction(context, name) * float(along)


def _still(stage: StagePlan, axis: Axis) -> bool:
    entry = stage.spec.axes.get(axis)
    return entry is None or not entry.mode.moves or entry.mode.constant_rate(stage.known) == 0.0


def _least_friction(context: Context, name: str) -> float:
    """Of an object, the least that `truth` and `vary` allow."""
    loaded, path = context.loaded, f"world.{name}.friction"
    known = [float(task.shapes[name].friction) for task in (loaded.task, loaded.true_task)]
    varied = [v for v in loaded.task.vary.get(path, ()) if v is not None]
    return min([*known, *(ends(context, path, None, v)[0] for v in varied)])


def _in_contact(analysed: SampledStage, shared: Shared) -> Iterator[Finding]:
    """A stage that is stable before it meets its contact, but not in it."""
    modes = analysed.modes()
    worst = worst_of(modes)
    if worst is not None and grows(worst):
        contact = next(iter(analysed.pressed))
        text = f"stage {analysed.stage.name!r} would be unstable in contact with {contact!r}"
        yield from _findings(analysed, modes, worst, shared, "TS505", Severity.WARNING, text)


@dataclass(frozen=True, slots=True)
class WorstWorlds:
    """The worlds in which a stage is worst.

    Attributes:
        unstable: growth [1/s] and world of the fastest that grows; None where nothing does.
        ringing: damping ratio and world of the least damped that rings; None where nothing does.
    """

    unstable: tuple[float, Corner] | None
    ringing: tuple[float, Corner] | None


def worst_worlds(analysed: SampledStage, shared: Shared) -> WorstWorlds:
    """The worlds of `truth` and `vary` in which a stage that is analysed is worst."""
    held = analysed.stage.plan.contacts.held
    objects = [*analysed.pressed, *([held] if held else [])]
    unstable: tuple[float, Corner] | None = None
    ringing: tuple[float, Corner] | None = None
    for corner in corners(shared.context, objects, shared.worlds):
        if not resolved(analysed, corner.task):
            continue
        plant = shared.plants.under(analysed, corner)
        growth, damping = _suspected(
            analysed.poles(corner.task, plant), FARTHEST / shared.context.period
        )
        # Few corners are worse than all before them: only these are looked at in full.
        worse = growth > (LEAST_GROWTH if unstable is None else unstable[0])
        weaker = unstable is None and damping < (
            LEAST_DAMPING_RATIO if ringing is None else ringing[0]
        )
        if not (worse or weaker):
            continue
        modes = analysed.modes(corner.task, plant)
        worst, swings = worst_of(modes), ringing_of(modes)
        if worst is not None and grows(worst) and (unstable is None or worst.s.real > unstable[0]):
            unstable = (worst.s.real, corner)
        if swings is not None and (ringing is None or swings.damping_ratio < ringing[0]):
            ringing = (swings.damping_ratio, corner)
    return WorstWorlds(unstable, ringing)


def _in_other_worlds(analysed: SampledStage, shared: Shared) -> Iterator[Finding]:
    """The worst world that `truth` and `vary` allow, if the stage is unstable or rings there."""
    found = worst_worlds(analysed, shared)
    unstable, ringing = found.unstable, found.ringing
    name, task = analysed.stage.name, shared.context.loaded.task
    if unstable is not None:
        corner, modes = _decisive(
            shared.context, analysed, unstable[1], lambda modes: modes[0].s.real
        )
        text = f"stage {name!r} is unstable in a world that `vary` allows, {named(task, corner)}"
        yield from _findings(
            analysed, modes, modes[0], shared, "TS503", Severity.ERROR, text, corner
        )
    elif ringing is not None:
        corner, modes = _decisive(shared.context, analysed, ringing[1], _undamped)
        swings = ringing_of(modes)
        assert swings is not None
        text = f"stage {name!r} rings in a world that `vary` allows, {named(task, corner)}"
        yield from _findings(
            analysed, modes, swings, shared, "TS504", Severity.WARNING, text, corner
        )


def _findings(
    analysed: SampledStage,
    modes: Sequence[Mode],
    mode: Mode,
    shared: Shared,
    code: str,
    severity: Severity,
    text: str,
    corner: Corner | None = None,
) -> Iterator[Finding]:
    """A mode of a stage, with what would change it; nothing where its place has the code already.

    Args:
        analysed: the stage.
        modes: all of its closed loop.
        mode: that is reported.
        shared: what the stages of the file have in common.
        code: of the finding.
        severity: of the finding.
        text: how the message begins.
        corner: the world in which it is so; None for that of the file.
    """
    axis, period = analysed.axis(mode, modes), analysed.context.period
    ringing = code in _RINGING
    if corner is None:
        limits = remedies(shared.context, analysed, axis, None, shared.gains, ringing=ringing)
        place = place_of(shared.context, analysed, axis, limits)
    else:
        path = next(iter(corner.values))[0]
        place = (FILE.vary if path in analysed.context.loaded.task.vary else FILE.truth)[path]
    if (code, place) in shared.reported:
        return
    shared.reported.add((code, place))
    if corner is not None:
        limits = remedies(
            shared.context, analysed, axis, corner.task, shared.gains, ringing=ringing
        )
    hint = "; or ".join(text_of(shared.context, analysed, limit) for limit in limits)
    if not hint:
        none = "no single gain of this stage makes it stable"
        hint = (
            none
            if shared.gains.left > 0
            else "fix the other stages first: what makes this one stable is searched for then"
        )
    message = f"{text}: {on_axis(axis)} {describe(mode, period)}"
    yield Finding(code, message, place, hint, unless=(code,), severity=severity)


def _suspected(s: Poles, neutral: float) -> tuple[float, float]:
    """Fastest growth [1/s], and least damping ratio of what dies away slowly, of some poles.

    Args:
        s: the poles [1/s].
        neutral: those that are nearer to 0 may be of neutral chains that rounding has moved [1/s].
    """
    growth = float(s.real[np.abs(s) > neutral].max(initial=-math.inf))
    slow = s[-s.real < QUICK]
    return growth, float((-slow.real / np.abs(slow)).min(initial=math.inf))


def _undamped(modes: Sequence[Mode]) -> float:
    """How far a ringing is from being damped."""
    ringing = ringing_of(modes)
    return 0.0 if ringing is None else LEAST_DAMPING_RATIO - ringing.damping_ratio


def _decisive(
    context: Context, analysed: SampledStage, corner: Corner, bad: Callable[[Sequence[Mode]], float]
) -> tuple[Corner, tuple[Mode, ...]]:
    """The corner without what does not matter, and the modes there."""
    modes = analysed.modes(corner.task)
    for part in list(corner.values):
        rest = {key: value for key, value in corner.values.items() if key != part}
        if not rest:
            break
        without = at(context, rest)
        others = analysed.modes(without.task)
        if bad(others) > _AS_MUCH * bad(modes):
            corner, modes = without, others
    return corner, modes


def resolved(analysed: SampledStage, task: Task) -> bool:
    """Whether the plant's steps resolve all contacts of a stage in a world (TS307)."""
    context = analysed.context
    for name in analysed.pressed:
        nominal, true = context.compliances[name], getattr(task.world[name], "stiffness", 0.0)
        if nominal.exact:
            continue
        k = nominal.stiffness if true == "rigid" else float(true)
        if nominal.phase * math.sqrt(k / nominal.stiffness) > RESOLVED_PHASE:
            return False
    return True


def worst_of(modes: Sequence[Mode]) -> Mode | None:
    """The least stable of all modes."""
    return modes[0] if modes else None


def ringing_of(modes: Sequence[Mode]) -> Mode | None:
    """The least damped of the modes that ring; of those that are alike to rounding the slowest."""
    found = [mode for mode in modes if rings(mode)]
    return min(found, key=lambda m: (round(m.damping_ratio, 6), m.frequency), default=None)


def describe(mode: Mode, period: float) -> str:
    """What a mode does, as a predicate: how fast it swings, and grows or dies away.

    Args:
        mode: the mode.
        period: of control [s].
    """
    rate = mode.s.real
    if mode.frequency > _FLIPS / period:
        size = number(abs(mode.z), 3)
        return f"is predicted to flip from tick to tick, each time {size} times as far"
    swings = f"ring at {show(mode.frequency, FREQUENCY, 3)}" if mode.frequency > 0 else "run away"
    if abs(rate) < _STEADY:
        return f"is predicted to {swings} and not to die away"
    time = math.log(2) / abs(rate)
    if rate > 0:
        return f"is predicted to {swings} and to double every {_time(time)}"
    return (
        f"is predicted to {swings} with a damping ratio of {number(mode.damping_ratio, 2)}, "
        f"halving every {_time(time)}"
    )


def on_axis(axis: str) -> str:
    """A mode's place in a sentence."""
    return "the null space" if axis == "null space" else f"axis {axis!r}"


def _time(seconds: float) -> str:
    return scaled(seconds, TIME, 2)


def named(task: Task, corner: Corner) -> str:
    """The values of a corner, as the file of the task would have them."""
    parts = []
    for (path, index), value in corner.values.items():
        component = "" if index is None else f"[{index}]"
        shown = scaled(value, task.dimensions_of(path)[index or 0], 3)
        parts.append(f"{path}{component} = {shown}")
    return ", ".join(parts)
