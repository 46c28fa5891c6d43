"""Motions against the mechanism whose handle the robot holds."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taskspec.foresight.approach import striking_mass
from taskspec.foresight.conditions import names, parts, value_of
from taskspec.foresight.ranges import Ranges
from taskspec.program.interval import ANY, Interval, IntervalAlgebra
from taskspec.program.passage import End
from taskspec.program.plan import StagePlan
from taskspec.program.walk.held_motion import held_motion
from taskspec.program.world.stiffness import GRIP
from taskspec.rules import Finding, rule, warning
from taskspec.rules.impact import largest_force
from taskspec.spec import FILE, key_of
from taskspec.text.expression.tree import Held, Node
from taskspec.text.units import FORCE, LENGTH, VELOCITY, inside, show

#: Slower than this is the rounding of a mechanism that stands still [m/s, rad/s].
_NOTHING = 1e-9
#: Force and moment from which on a mismatch is no matter of play in the grip [N, N m].
_BORNE = {False: 5.0, True: 1.0}


@rule("TS322", "a motion that the mechanism does not allow")
def motions_against_a_mechanism(stage: StagePlan) -> Iterator[Finding]:
    """Constant rates that the held mechanism does not allow."""
    held = stage.context.held
    if not held:
        return
    if stage.path is not None or not stage.law.control_law.selects:
        yield from _strained(stage)
        return
    motion = held_motion(stage)
    axis = None if motion is None else motion.contradicted
    if motion is None or axis is None:
        yield from _strained(stage)
        return
    rate = motion.rates[axis]
    unit = axis.of(VELOCITY)
    has = motion.allowed(axis)
    has = has if abs(has) > _NOTHING else 0.0
    does = f"is to move with {show(rate, unit, 3)}" if rate else "is held"
    axes = FILE.stages[stage.name].axes
    first = list(motion.rates)[motion.moved[0]]
    yield warning(
        "TS322",
        f"{axis!r} {does}, and {held!r} lets it move with {show(has, unit, 3)} where the "
        "run begins: the arm works against the grip",
        key_of(axes[axis if axis in stage.spec.axes else first]),
        f"let it give way: {axis}: {{{axis.effort}: 0}}",
        unless=("TS232",),
        unless_at=axes[axis],
    )


def _strained(stage: StagePlan) -> Iterator[Finding]:
    """Motions whose mismatch grows until the grip bears a force that nobody wants."""
    passage = stage.nominal.passage
    strain = None if passage is None else passage.strain
    if passage is None or strain is None:
        return
    held, axis = stage.context.held, strain.axis
    bears, unit = show(strain.force, axis.of(FORCE), 2), axis.of(LENGTH)
    stops = passage.end is End.STRAIN
    if not stops and (strain.drives or not stage.law.control_law.selects):
        return
    if not stops and strain.force < _BORNE[axis.is_rotation]:
        return
    when = f"after {show(strain.time, 's', 2)}"
    then = f"{bears}, the limit, at which the run stops" if stops else f"about {bears}"
    axes = FILE.stages[stage.name].axes
    first = next((a for a in stage.spec.axes if stage.spec.axes[a].mode.moves), None)
    place = axis if axis in stage.spec.axes else first
    where = key_of(FILE.stages[stage.name] if place is None else axes[place])
    if strain.drives:
        yield warning(
            "TS322",
            f"{axis!r} is to drive {held!r}, and {when} it has so little lever on it that it takes "
            f"{then}",
            where,
            f"move along its circle: frame: {held}.handle",
        )
        return
    yield warning(
        "TS322",
        f"{when}, {axis!r} is {show(abs(strain.mismatch), unit, 2)} off what {held!r} lets it do: "
        f"the grip bears {then}",
        where,
        f"let it give way: {axis}: {{{axis.effort}: 0}}",
        unless=("TS232",),
        unless_at=where,
    )


@rule({}, also=("TS611",))
def guards_behind_a_lag(stage: StagePlan) -> Iterator[Finding]:
    """Guards on the held mechanism that its reference comes to in time, and the law does not."""
    passage, held, until = stage.nominal.passage, stage.context.held, stage.spec.until
    drive = None if passage is None else passage.drive
    if drive is None or until is None or not math.isfinite(stage.longest):
        return
    if not {n.path for n in names(until.tree)} & {(held, "angle"), (held, "travel")}:
        return
    model = stage.context.mechanisms[held]
    known = {
        f"{held}.{signal}": Interval(*sorted((0.0, factor * drive.farthest)))
        for signal, factor in (("angle", 1.0), ("travel", model.lead if model.angular else 1.0))
    }
    node = until.tree.x if isinstance(until.tree, Held) else until.tree
    algebra = IntervalAlgebra()
    if not value_of(node, algebra, Ranges(stage, known)).never:
        return
    way = show(drive.farthest, LENGTH.on(rotation=model.angular), 3)
    yield warning(
        "TS611",
        f"this never holds: its springs take {held!r} along by {way} in "
        f"{show(stage.longest, 's', 3)}, behind a reference that goes farther: they bear its "
        "inertia, damping and friction",
        until.span,
        "give it more time, or make the law stiffer along that way",
        unless=("TS611", "TS501"),
    )


@rule("TS329", "a mechanism that takes more force than there may be")
def forces_of_a_drive(stage: StagePlan) -> Iterator[Finding]:
    """Limits and expectations that the force which takes the held mechanism along goes beyond."""
    passage, held = stage.nominal.passage, stage.context.held
    drive = None if passage is None else passage.drive
    if passage is None or drive is None or drive.force is None:
        return
    # What comes once the mechanism is at its stop, or beyond its way, is told by itself.
    ends = passage.last.time if passage.stopped is None else passage.stopped.time
    force = drive.force[drive.times <= ends]
    most, peak = stage.limits.force, float(np.max(force, initial=0.0))
    takes = f"stage {stage.name!r} takes {held!r} along with up to {show(peak, 'N', 2)}"
    moved = next((a for a in stage.spec.axes if stage.spec.axes[a].mode.moves), None)
    if most is not None and peak > most:
        when = float(drive.times[np.argmax(force > most)])
        axes = FILE.stages[stage.name].axes
        yield warning(
            "TS329",
            f"{takes}: at t = {show(when, 's', 2)} it is beyond the limit on force, "
            f"{show(most, 'N')}, and the run stops",
            key_of(axes if moved is None else axes[moved]),
            "move slower, or raise the limit",
            unless=("TS322",),
        )
        return
    for expectation in stage.context.loaded.task.expect:
        for part in parts(expectation.expression.tree):
            reduced = largest_force(part, stage.name, None)
            if reduced is None:
                continue
            met: dict[Node, Interval] = {reduced: Interval(peak, math.inf)}
            if not value_of(part, IntervalAlgebra(), lambda _: ANY, met).never:
                continue
            yield warning(
                "TS329",
                f"{takes}, which is beyond what is expected here",
                expectation.expression.where(part),
                "move slower, or expect that much",
            )


@rule("TS328", "a motion beyond a mechanism's stop", also=("TS616",))
def beyond_a_stop(stage: StagePlan) -> Iterator[Finding]:
    """Motions that go on where the held mechanism is at its stop, or come there too fast."""
    passage = stage.nominal.passage
    stopped = None if passage is None else passage.stopped
    if passage is None or stopped is None:
        return
    axis, held = stopped.axis, stage.context.held
    angular = stage.context.mechanisms[held].angular
    at = show(stopped.at, LENGTH.on(rotation=angular), 3)
    k = GRIP.angular_stiffness if axis.is_rotation else GRIP.stiffness
    mass = striking_mass(stage, axis)
    unit, force = axis.of(VELOCITY), axis.of(FORCE)
    most = stage.limits.torque if axis.is_rotation else stage.limits.force
    place = key_of(FILE.stages[stage.name].axes[axis])
    peak = abs(stopped.speed) * math.sqrt(mass * k)
    if most is not None and peak > most:
        slower = show(inside(abs(stopped.speed) * most / peak, upper=True, digits=2), unit)
        yield warning(
            "TS616",
            f"stage {stage.name!r} meets the stop of {held!r} with {show(stopped.speed, unit, 3)}: "
            f"that may make about {show(peak, force, 2)}, and the limit is {show(most, force)}",
            place,
            f"come there with {slower} or less, or raise the limit",
        )
        return
    if passage.end is End.STOP:
        return
    per = abs(stopped.speed / stopped.rate) if stopped.rate else 1.0
    own = stage.spring_of(axis, mass)
    if not stage.law.control_law.selects:
        k = k * own / (k + own) if own > 0 else 0.0
    way = stopped.beyond * per
    presses = way * k
    if presses < _BORNE[axis.is_rotation]:
        return
    stops = most is not None and presses > most
    yield warning(
        "TS328",
        f"stage {stage.name!r} has {held!r} at its stop, {at}, after {show(stopped.time, 's', 3)}, "
        f"and goes on by {show(way, axis.of(LENGTH), 3)}: "
        + (
            f"the limit of {show(most or 0.0, force)} stops the run"
            if stops
            else f"it presses with about {show(presses, force, 2)}"
        ),
        place,
        "shorten the way, or move until a force says that it is there",
    )


@rule({}, also=("TS617",))
def stops_not_reached(stage: StagePlan) -> Iterator[Finding]:
    """Bounds that end a stage before the stop that it waits to feel."""
    passage, held, until = stage.nominal.passage, stage.context.held, stage.spec.until
    if passage is None or passage.end is not End.BOUND or not held or until is None:
        return
    stop, last = stage.context.loaded.task.mechanisms[held].stop, passage.last.coordinate
    first = passage.instants[0].coordinate
    by_force = any(n.path in ((held, "force"), (held, "torque")) for n in names(until.tree))
    if stop is None or last is None or first is None or not by_force or last == first:
        return
    away = stop[1] - last if last > first else last - stop[0]
    if away <= 0.02 * (stop[1] - stop[0]):
        return
    within = stage.spec.within
    key = "time" if within is not None and within.time is not None else "travel"
    if within is not None and within.travel is not None and passage.last.time < stage.longest:
        key = "travel"
    unit = LENGTH.on(rotation=stage.context.mechanisms[held].angular)
    yield warning(
        "TS617",
        f"stage {stage.name!r} waits to feel the stop of {held!r}, and this bound ends it "
        f"{show(away, unit, 2)} before that",
        FILE.stages[stage.name].within[key],
        "raise it, or move faster",
    )
