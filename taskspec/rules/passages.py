"""What comes in the way of an arm in a stage: limits of joints, ends of surfaces, stops."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.passage import End
from taskspec.program.plan import StagePlan
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.rules import Finding, rule, warning
from taskspec.rules.places import motion_of
from taskspec.text.units import LENGTH, show


@rule("TS424", "a joint that comes to its limit")
def joint_limits(stage: StagePlan) -> Iterator[Finding]:
    """Motions on which a joint comes to its limit, which stops the run."""
    passage = stage.nominal.passage
    if passage is None or passage.end is not End.JOINT or stage.law.solve == "qp":
        return
    robot, last, i = stage.context.robot, passage.last, passage.joint
    assert i is not None
    unit = LENGTH.on(rotation=turns_at(robot, i))
    bound = float(robot.upper[i] if last.q[i] > robot.home[i] else robot.lower[i])
    held = stage.context.held
    with_it = ""
    if held and last.coordinate is not None:
        turned = LENGTH.on(rotation=stage.context.mechanisms[held].angular)
        with_it = f", with {held!r} at {show(last.coordinate, turned, 3)}"
    yield warning(
        "TS424",
        f"in stage {stage.name!r}, {last.words}{with_it}, joint {i + 1} comes to its limit, "
        f"{show(bound, unit, 4)}: the run stops there",
        motion_of(stage),
        "start with that joint turned back, give the start another rpy, or shorten the way",
        unless=("TS421",),
    )


@rule("TS425", "a motion that leaves what it is on")
def edges(stage: StagePlan) -> Iterator[Finding]:
    """Motions over the edge of what a frame follows, or of what a stage presses on."""
    passage = stage.nominal.passage
    if passage is None or passage.end is not End.EDGE:
        return
    follows = stage.frame.kind == "following"
    then = (
        f"the frame {stage.frame.name!r} ends there, and the run stops"
        if follows
        else "nothing returns the force any more, and the tool goes on into the air"
    )
    yield warning(
        "TS425",
        f"in stage {stage.name!r}, after {passage.last.words.removeprefix('at t = ')}, the motion "
        f"leads over the edge of {passage.edge!r}: {then}",
        motion_of(stage),
        "shorten the way, or begin farther from the edge",
    )
