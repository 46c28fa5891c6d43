"""Gripping and releasing: their order, what the jaws can do, and what friction holds."""

from __future__ import annotations

import math
from collections.abc import Iterator

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.shapes import BoundedSurface
from taskspec.spec import FILE, KeyPath, Stage, Task, key_of
from taskspec.spec.gripper import ALL, GripCommand
from taskspec.statics.held_body import (
    closing_axis,
    gripping_stage,
    half_width,
    held_as_begins,
    held_bodies,
    in_order,
)
from taskspec.text.units import show

Vector = NDArray[np.float64]

#: A body that is let go may fall so far [m].
_FALLS = 5e-3
#: A screw takes a body whose tip is so near to its axis [m].
_ON_THREAD = 10e-3


@rule(
    {
        "TS145": "a grip that the gripper or the body does not allow",
        "TS147": "a gripper beside something that is held from the start",
    },
    phase=Phase.TASK,
)
def impossible_grips(plan: TaskPlan) -> Iterator[Finding]:
    """Forces and widths beyond the gripper's, a body without friction, and a hand that is full."""
    context = plan.context
    task = context.loaded.task
    gripper = task.robot.gripper
    for name, stage in task.stages.items():
        grip = stage.grip
        if grip is None:
            continue
        place = FILE.stages[name].grip
        if task.robot.grasp is not None:
            yield error(
                "TS147",
                f"stage {name!r} grips {grip.object!r}, and the robot holds "
                f"{task.robot.grasp!r} from the start to the end",
                place,
                "begin with empty jaws: leave 'robot.grasp' out, and grip in a stage",
                (("held from the start", FILE.robot.grasp),),
            )
            return
        if grip.force > gripper.force:
            yield error(
                "TS145",
                f"each jaw is to press with {show(grip.force, 'N', 3)}, and the gripper makes "
                f"{show(gripper.force, 'N', 3)}",
                place.force,
                "press less, or say what the gripper makes: robot: {gripper: {force: ...}}",
            )
        solid = context.surfaces[grip.object]
        assert isinstance(solid, BoundedSurface)
        width = 2 * float(min(solid.half_sizes))
        if width > gripper.stroke:
            yield error(
                "TS145",
                f"{grip.object!r} is at least {show(width, 'mm', 3)} wide, and the jaws open to "
                f"{show(gripper.stroke, 'mm', 3)}",
                place.object,
                "take another body, or say how far they open: robot: {gripper: {stroke: ...}}",
            )
        if task.shapes[grip.object].friction == 0:
            yield error(
                "TS145",
                f"{grip.object!r} has no friction, so no pad holds it",
                place.object,
                f"give it some: world: {{{grip.object}: {{friction: 0.4, ...}}}}",
            )


@rule("TS146", "a grip of what is held, or a release of what is not", phase=Phase.TASK)
def order_of_grips(plan: TaskPlan) -> Iterator[Finding]:
    """Stages that grip with something in the jaws, and that release what is not there."""
    task = plan.context.loaded.task
    for name, held in held_as_begins(task).items():
        stage, place = task.stages[name], FILE.stages[name]
        wrong = _full(stage, held) if stage.grip is not None else _empty(stage, held)
        if not wrong:
            continue
        always = len(wrong) == len(held)
        what = ", ".join(repr(g.object) if g is not None else "nothing" for g in wrong)
        holds = f"the jaws {'' if always else 'may '}hold {what} as the stage begins"
        say = error if always else warning
        if stage.grip is not None:
            text = f"stage {name!r} grips {stage.grip.object!r}, and {holds}"
            yield say("TS146", text, key_of(place.grip), "release it in a stage before")
        else:
            released = repr(stage.release) if stage.release else "what is held"
            text = f"stage {name!r} releases {released}, and {holds}"
            hint = "leave the release out, or grip before; 'release: true' lets go of anything"
            yield say("TS146", text, key_of(place.release), hint)


def _full(stage: Stage, held: set[GripCommand | None]) -> list[GripCommand | None]:
    """Of what may be held, what keeps a stage from gripping: any body but its own."""
    assert stage.grip is not None
    return [g for g in in_order(held) if g is not None and g.object != stage.grip.object]


def _empty(stage: Stage, held: set[GripCommand | None]) -> list[GripCommand | None]:
    """Of what may be held, what a stage cannot release."""
    if stage.release is None:
        return []
    named = stage.release
    lost = [g for g in in_order(held) if g is None or named not in (ALL, g.object)]
    # After a body may have slipped out, opening the jaws does no harm.
    return lost if named != ALL or len(lost) == len(held) else []


@rule("TS353", "a grip that is too weak", phase=Phase.RUN, predicts=("TS353",))
def weak_grips(plan: TaskPlan) -> Iterator[Finding]:
    """Grips that do not hold a body's weight as it is moved, or a moment on it."""
    task = plan.context.loaded.task
    bodies = ((n, b) for n, s in plan.framed.items() for b in held_bodies(s, plan.framed))
    for name, body in bodies:
        grip = body.grip
        if body.needed <= grip.force:
            continue
        bears = f"{show(body.load, 'N', 3)} of weight and acceleration"
        if body.moment:
            about = f"{show(body.moment, 'N*m', 3)} on a half width of {show(body.half, 'mm', 3)}"
            bears = f"{about}, and {bears}"
        yield warning(
            "TS353",
            f"{grip.object!r} slips in stage {name!r}: with a friction of {body.friction:g}, "
            f"{bears} need {show(body.needed, 'N', 3)} at each jaw, which presses with "
            f"{show(grip.force, 'N', 3)}",
            FILE.stages[gripping_stage(task, grip)].grip.force,
            "press harder, or move more gently",
            unless=("TS353",),
        )


@rule("TS354", "a grip or a release in the wrong place")
def misplaced_grips(stage: StagePlan) -> Iterator[Finding]:
    """Jaws that close beside the body, and bodies that are let go where they fall."""
    task, p = stage.context.loaded.task, stage.nominal.start
    if p is None or not task.gripped:
        return
    place = FILE.stages[stage.name]
    held = held_as_begins(task)
    if stage.spec.grip is not None and _untouched(task, held, stage):
        name = stage.spec.grip.object
        beside = _beside(stage, name, p)
        if beside > 0:
            yield warning(
                "TS354",
                f"the jaws close {show(beside, 'mm', 3)} beside {name!r}, which lies elsewhere",
                place.grip.object,
                "bring the tip to the middle of the body before",
            )
    if stage.spec.release is not None:
        for grip in in_order(held.get(stage.name, set())):
            if grip is not None and (falls := _falls(stage, grip.object, p)) > _FALLS:
                yield warning(
                    "TS354",
                    f"{grip.object!r} is let go {show(falls, 'mm', 3)} above what is below it",
                    _release(place),
                    "lower it before, or screw it on",
                )


def _release(place: KeyPath) -> KeyPath:
    found: KeyPath = place.release
    return found


def _untouched(task: Task, held: dict[str, set[GripCommand | None]], stage: StagePlan) -> bool:
    """Whether a body lies where the file has it as a stage grips it."""
    assert stage.spec.grip is not None
    name = stage.spec.grip.object
    before = [s for s in held if s != stage.name and task.stages[s].grip is not None]
    again = any(g is not None and g.object == name for g in held.get(stage.name, set()))
    return not again and all(
        task.stages[s].grip.object != name or list(held).index(s) > list(held).index(stage.name)  # type: ignore[union-attr]
        for s in before
    )


def _beside(stage: StagePlan, name: str, p: Vector) -> float:
    """How far the line between the pads passes by a body [m]; not above 0 where it meets it."""
    solid, n = stage.context.surfaces[name], closing_axis(stage)
    assert isinstance(solid, BoundedSurface)
    stroke = stage.context.loaded.task.robot.gripper.stroke
    away = solid.origin - p
    along = float(n @ away)
    reach = half_width(stage, name, n) + abs(along) - stroke / 2
    return max(float(ca.evalf(solid.distance(ca.SX(p + n * along)))), reach)


def _falls(stage: StagePlan, name: str, p: Vector) -> float:
    """From how high a body falls that is let go with the tip at p (3,) [m]."""
    context = stage.context
    for screw in context.loaded.task.mechanisms.values():
        if getattr(screw, "takes", None) == name:
            axis = from_rpy(screw.rpy)[:, 2]
            away = p - np.array(screw.xyz)
            if np.linalg.norm(away - axis * (axis @ away)) < _ON_THREAD:
                return 0.0
    below = half_width(stage, name, np.array([0.0, 0.0, 1.0]))
    others = [s for o, s in context.surfaces.items() if o != name]
    gaps = [float(ca.evalf(s.distance(ca.SX(p)))) for s in others]
    return min(gaps, default=math.inf) - below
