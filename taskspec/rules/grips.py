"""Gripping and releasing: their order, what the jaws can do, and what friction holds.

Two pads that press with N hold of a body what it needs for its weight and acceleration, w across
their axis n and f along it, and about the tool's axis a moment tau, where each bears its share:

    hypot(w/2, tau / 2h) <= mu (N - f/2),    w = m |g + a| without its part f along n,

h half of the body's width. Under f one pad presses with N - f/2, the other with N + f/2; a body
that is not to turn between them bears on both alike, so that the weaker one counts. A flat face
that has slid a little rocks on its pads and may hold more (`plant.pads`); that is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec.program.conditions import bounds_of, names
from taskspec.program.flow import followers
from taskspec.program.interval import ANY, Interval, IntervalAlgebra
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.signals import constant
from taskspec.robot.rebuild import GRAVITY
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.shapes import BoundedSurface
from taskspec.spec import FILE, KeyPath, Stage, Task, key_of
from taskspec.spec.gripper import ALL, GripCommand
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
    return [g for g in _sorted(held) if g is not None and g.object != stage.grip.object]


def _empty(stage: Stage, held: set[GripCommand | None]) -> list[GripCommand | None]:
    """Of what may be held, what a stage cannot release."""
    if stage.release is None:
        return []
    named = stage.release
    lost = [g for g in _sorted(held) if g is None or named not in (ALL, g.object)]
    # After a body may have slipped out, opening the jaws does no harm.
    return lost if named != ALL or len(lost) == len(held) else []


def _sorted(held: set[GripCommand | None]) -> list[GripCommand | None]:
    return sorted(held, key=lambda g: ("", 0.0) if g is None else (g.object, g.force))


def held_as_begins(task: Task) -> dict[str, set[GripCommand | None]]:
    """What the jaws may hold as each stage begins that a run may come to; None for nothing.

    What slips out is not counted.
    """
    first = next(iter(task.stages))
    found: dict[str, set[GripCommand | None]] = {first: {None}}
    waiting = [first]
    while waiting:
        name = waiting.pop()
        stage = task.stages[name]
        after: set[GripCommand | None] = set(found[name]) if stage.release is None else {None}
        if stage.grip is not None:
            after = {stage.grip}
        for to in followers(task, name):
            known = found.setdefault(to, set())
            if not after <= known:
                known |= after
                waiting.append(to)
    return {name: found[name] for name in task.stages if name in found}


@rule("TS353", "a grip that is too weak", phase=Phase.RUN, predicts=("TS353",))
def weak_grips(plan: TaskPlan) -> Iterator[Finding]:
    """Grips that do not hold a body's weight as it is moved, or a moment on it."""
    task = plan.context.loaded.task
    if not task.gripped:
        return
    for name, held in held_as_begins(task).items():
        stage = plan.framed.get(name)
        if stage is None or stage.spec.grip is not None or stage.spec.release is not None:
            continue
        for grip in (g for g in _sorted(held) if g is not None):
            place = next(n for n, s in task.stages.items() if s.grip == grip)
            closed = plan.framed.get(place, stage)
            needed, bears = _needed(stage, grip, _closing_axis(closed))
            if needed <= grip.force:
                continue
            yield warning(
                "TS353",
                f"{grip.object!r} slips in stage {name!r}: with a friction of "
                f"{task.shapes[grip.object].friction:g}, {bears} need {show(needed, 'N', 3)} at "
                f"each jaw, which presses with {show(grip.force, 'N', 3)}",
                FILE.stages[place].grip.force,
                "press harder, or move more gently",
                unless=("TS353",),
            )


def _needed(stage: StagePlan, grip: GripCommand, closing: Vector) -> tuple[float, str]:
    """What each jaw has to press with that a stage moves a body [N], and of what that comes.

    Args:
        stage: that moves it. grip: of the body.
        closing: (3,) along which the jaws closed on it, world axes.
    """
    shape = stage.context.loaded.task.shapes[grip.object]
    n, tau = _closing_axis(stage), _moment(stage, grip)
    half = _half_width(stage, grip.object, closing)
    most, bears = 0.0, ""
    for a in _accelerations(stage):
        load = (shape.mass or 0.0) * (a - np.array(GRAVITY))
        f = abs(float(n @ load))
        w = float(np.linalg.norm(load - n * (n @ load)))
        share = math.hypot(w / 2, tau / (2 * half))
        needed = share / shape.friction + f / 2 if shape.friction else 0.0
        if needed > most:
            whole = show(float(np.linalg.norm(load)), "N", 3)
            most, bears = needed, f"{whole} of weight and acceleration"
    if tau:
        bears = f"{show(tau, 'N*m', 3)} on a half width of {show(half, 'mm', 3)}, and {bears}"
    return most, bears


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
        for grip in _sorted(held.get(stage.name, set())):
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


def _closing_axis(stage: StagePlan) -> Vector:
    """(3,) along which the jaws close as the stage begins, world axes."""
    passage = stage.nominal.passage
    R = passage.instants[0].R if passage is not None and passage.instants else stage.context.start_R
    return np.asarray(R[:, stage.context.loaded.task.robot.gripper.row])


def _half_width(stage: StagePlan, name: str, n: Vector) -> float:
    """Of a body between the jaws [m], as it lies in the file."""
    solid = stage.context.surfaces[name]
    assert isinstance(solid, BoundedSurface)
    return float(ca.evalf(ca.SX(solid.support(ca.SX(solid.rotation.T @ n)))))


def _beside(stage: StagePlan, name: str, p: Vector) -> float:
    """How far the line between the pads passes by a body [m]; not above 0 where it meets it."""
    solid, n = stage.context.surfaces[name], _closing_axis(stage)
    assert isinstance(solid, BoundedSurface)
    stroke = stage.context.loaded.task.robot.gripper.stroke
    away = solid.origin - p
    along = float(n @ away)
    reach = _half_width(stage, name, n) + abs(along) - stroke / 2
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
    below = _half_width(stage, name, np.array([0.0, 0.0, 1.0]))
    others = [s for o, s in context.surfaces.items() if o != name]
    gaps = [float(ca.evalf(s.distance(ca.SX(p)))) for s in others]
    return min(gaps, default=math.inf) - below


def _accelerations(stage: StagePlan) -> list[Vector]:
    """(3,) what planned moves accelerate by at most, all axes at once, either way; world axes."""
    peaks = []
    for axis, plan in stage.plans.items():
        if axis.is_rotation or not plan.motion:
            continue
        cubic = plan.mode.track(0.0, 0.0)
        if cubic is None:
            continue
        knots, c = (np.asarray(ca.evalf(ca.SX(x))) for x in (cubic.knots, cubic.coefficients))
        spans = np.diff(knots.ravel())
        most = max(np.max(np.abs(2 * c[:, 2])), np.max(np.abs(2 * c[:, 2] + 6 * c[:, 3] * spans)))
        peaks.append(most * stage.nominal.rotation[:, axis.column])
    signs = product((1.0, -1.0), repeat=len(peaks))
    return [
        np.zeros(3) + sum(s * peak for s, peak in zip(each, peaks, strict=True)) for each in signs
    ]


def _moment(stage: StagePlan, grip: GripCommand) -> float:
    """What a stage that turns a body on a thread needs of moment about its axis [N m]."""
    task = stage.context.loaded.task
    screws = [s for s in task.mechanisms.values() if getattr(s, "takes", None) == grip.object]
    turning = [a for a, p in stage.plans.items() if a.is_rotation and p.motion and p.mode.moves]
    if not screws or not turning or stage.spec.until is None:
        return 0.0

    def known(name: object) -> Interval:
        found = constant(stage.context, name)  # type: ignore[arg-type]
        return ANY if found is None else found

    most = max(screw.friction for screw in screws)
    bounds = bounds_of([stage.spec.until.tree], IntervalAlgebra(), known)
    for node, bound in bounds.items():
        about = {str(name) for name in names(node)}
        if about & {f"torque.{axis}" for axis in turning}:
            beyond = max(bound.low, -bound.high)
            most = max(most, beyond if math.isfinite(beyond) else 0.0)
    return most
