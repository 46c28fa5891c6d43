"""Axes that a stage names: whether the arm has them, and whether they can follow a mechanism."""

from __future__ import annotations

from collections.abc import Iterator
from graphlib import CycleError

from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import UncoupledError, move_speed
from taskspec.motion import blend
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, Phase, error, rule
from taskspec.spec import FILE, key_of
from taskspec.text.diagnostic import Severity
from taskspec.text.units import LENGTH, TIME, show

#: A coupling is met soon where a move of default speed covers what it is away by in this time [s].
_SOON = 1.0
#: Of a coordinate at a stage start [m, rad].
_ROUNDING = 1e-9


@rule({}, also=("TS220",), phase=Phase.AXES)
def missing_axes(stage: StagePlan) -> Iterator[Finding]:
    """Axes that do not exist in the stage's frame."""
    for axis in stage.spec.axes:
        if axis not in stage.axes:
            yield error(
                "TS220",
                f"{stage.context.robot.name!r} cannot move {_how(axis)} of frame "
                f"{stage.frame.name!r}",
                key_of(FILE.stages[stage.name].axes[axis]),
                f"axes that exist here: {', '.join(stage.axes)}",
            )


@rule(
    {
        "TS230": "an axis that does not follow from the mechanism's geometry",
        "TS260": "axes that follow each other",
    },
    phase=Phase.PATH,
)
def uncoupled_axes(stage: StagePlan) -> Iterator[Finding]:
    """Axes that follow a mechanism which asks no motion of them, or each other."""
    for axis, plan in stage.plans.items():
        try:
            stage.coupling_of(axis)
        except UncoupledError as reason:
            place = FILE.stages[stage.name].axes[axis][plan.mode.name]
            # Neither references nor gains of such a stage exist, and nothing after it is known.
            yield error("TS230", str(reason), place, reason.hint, stops=True)
            return
    yield from _without_order(stage)


@rule("TS262", "a coupling to an axis that the arm cannot move", phase=Phase.AXES)
def missing_leaders(stage: StagePlan) -> Iterator[Finding]:
    """Axes that follow one which does not exist in the stage's frame."""
    for axis, entry in stage.spec.axes.items():
        for leader in entry.mode.leaders:
            if leader not in stage.axes:
                yield error(
                    "TS262",
                    f"{axis!r} follows {leader!r}, and {stage.context.robot.name!r} cannot move "
                    f"{_how(leader)} of frame {stage.frame.name!r}",
                    FILE.stages[stage.name].axes[axis].follows,
                    f"axes that exist here: {', '.join(stage.axes)}",
                    stops=True,
                )


@rule("TS263", "a coupling that is not met where its stage starts", phase=Phase.MOTION)
def distant_couplings(stage: StagePlan) -> Iterator[Finding]:
    """Axes that a coupling takes far away before it is met."""
    start = stage.nominal.coordinates
    for axis, plan in stage.plans.items():
        leaders = plan.mode.leaders
        if start is None or not leaders or not plan.motion:
            continue
        (expression, _), *_ = plan.mode.expressions()
        place = stage.known(expression, {str(a): start[a] for a in leaders})
        speed = move_speed(rotation=axis.is_rotation)
        if place is None or not abs(place - start[axis]) > _SOON * speed:
            continue
        away, length = place - start[axis], axis.of(LENGTH)
        time = blend.blend_time(away, speed)
        counted = [
            f"{a} - {show(start[a], a.of(LENGTH), 4)}" for a in leaders if abs(start[a]) > _ROUNDING
        ]
        hint = "to count from the stage start, write " + " and ".join(counted)
        yield Finding(
            "TS263",
            f"{axis!r} is {show(abs(away), length, 3)} away from {expression} as stage "
            f"{stage.name!r} starts: it goes there first, in {show(float(time), TIME, 2)}",
            FILE.stages[stage.name].axes[axis].follows,
            hint if counted else "rotations count from the stage start; other axes from the frame",
            severity=Severity.WARNING,
        )


def _without_order(stage: StagePlan) -> Iterator[Finding]:
    """Axes that follow each other, so that none of them is decided."""
    try:
        _ = stage.leaders_first
    except CycleError as reason:
        # From each to the one that it follows; the first of the frame's axes comes first.
        ring = [Axis(a) for a in reversed(reason.args[1][1:])]
        first = ring.index(min(ring, key=AXES.index))
        ring = [*ring[first:], *ring[:first]]
        message = f"{ring[0]!r} follows itself"
        if len(ring) > 1:
            links = " follows ".join(map(repr, [*ring, ring[0]]))
            message = f"axes follow each other, so that none leads: {links}"
        hint = "give one of them a motion or a force of its own"
        place = FILE.stages[stage.name].axes[ring[0]].follows
        yield error("TS260", message, place, hint, stops=True)


def _how(axis: Axis) -> str:
    return f"about {axis[1:]!r}" if axis.is_rotation else f"along {axis!r}"
