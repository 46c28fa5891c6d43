"""The force of an axis against time, while its stage lasts: set point, loop and touch-down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.foresight.approach import approach, deepened, dwell, force_at_end
from taskspec.foresight.force_profile import set_points_at
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import Way
from taskspec.motion import blend
from taskspec.program.axes import MOSTLY
from taskspec.program.flow import leading_to
from taskspec.program.passage import End
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.walk.reference_motion import reference_motion
from taskspec.signals.entries import TOUCHING
from taskspec.stability.loop import UnfitError
from taskspec.stability.sampled_stage import ReferenceDrive, SampledStage, SetPointDrive, loop_like

Vector = NDArray[np.float64]

#: Longer stages are not followed [ticks].
_MOST_TICKS = 20000
#: Instants at which a set point that changes is looked at.
_LOOKS = 400
#: A rate takes so many instants.
_FEW = 2


@dataclass(frozen=True, slots=True)
class ForceCourse:
    """What an axis is to apply and what it applies, at each tick of its stage.

    Attributes:
        times: (k,) since the stage began [s].
        wanted: (k,) the set point of the file [N, N m].
        reference: (k,) the same as it rises from the force at entry.
        applied: (k,) what the loop makes of it [N, N m].
        sprung: whether the axis is a spring that what is held takes off its reference.
    """

    times: Vector
    wanted: Vector
    reference: Vector
    applied: Vector
    sprung: bool = False


class ForceCourses:
    """The forces of the axes of a task's stages, each followed once.

    Args:
        task: the plan.
        deepens: whether a tool that its guard lets go on into the surface, for as long as the guard
            has to hold, goes on with its full speed; else it goes no farther. The truth is between.
    """

    def __init__(self, task: TaskPlan, *, deepens: bool = True) -> None:
        self._task, self._deepens = task, deepens
        self._known: dict[tuple[str, Axis], ForceCourse | None] = {}

    def of(self, name: str, axis: Axis) -> ForceCourse | None:
        """The force of an axis while its stage lasts, by its sampled loop at the start pose.

        That of a stage with a guard goes on to its bound, as if the guard never held. None where
        it is not known how long the stage lasts, what it begins with or what its set point is;
        where the loop cannot be followed; and where the tool would leave what it presses on.

        Args:
            name: of the stage.
            axis: a force axis of it.
        """
        key = name, axis
        if key not in self._known:
            self._known[key] = None  # A stage that follows itself begins with what is not known.
            try:
                self._known[key] = self._course(self._task.stages[name], axis)
            except (UnfitError, np.linalg.LinAlgError):
                self._known[key] = None
        return self._known[key]

    def _course(self, stage: StagePlan, axis: Axis) -> ForceCourse | None:
        if stage.held and not stage.law.control_law.force_loop:
            return _sprung(stage, axis)
        return (
            self._pressed(stage, axis)
            if stage.plans[axis].set_point
            else self._displaced(stage, axis)
        )

    def _times(self, stage: StagePlan, axis: Axis) -> Vector | None:
        """(k,) the ticks of a stage [s]; None where its force along an axis cannot be followed."""
        lasts = _lasts(stage)
        count = 0 if lasts is None else round(lasts / stage.context.period)
        # Across a normal, friction is what returns a force, which the loop knows nothing of.
        across = not stage.gripped and abs(stage.facing(axis)) < MOSTLY
        if across or not _FEW <= count <= _MOST_TICKS:
            return None
        return stage.context.period * np.arange(count, dtype=float)

    def _pressed(self, stage: StagePlan, axis: Axis) -> ForceCourse | None:
        """The force of an axis with a set point."""
        times, entry = self._times(stage, axis), stage.spec.axes[axis].set_point
        begins = None if times is None else self._begins(stage, axis)
        if times is None or begins is None or entry is None:
            return None
        force, twist = begins
        wanted = _wanted(stage, axis, times)
        sampled = None if wanted is None else _sampled(self._task, stage.name)
        if wanted is None or sampled is None or sampled.meets:
            return None
        rise = entry.rise
        risen = np.ones(len(times))
        early = times < rise
        risen[early] = [blend.ramp_shape(float(t) / rise) for t in times[early]]
        rises = risen * (wanted - force)
        own = SetPointDrive(axis, rises[:, None])
        moved = sampled.follows(axis, [own, *_others(stage, axis, times)], twist)
        if moved is None:
            return None
        applied = force + moved
        if not stage.gripped and _leaves(stage, axis, applied):
            return None
        return ForceCourse(times, wanted, force + rises, applied)

    def _displaced(self, stage: StagePlan, axis: Axis) -> ForceCourse | None:
        """The force of an axis whose spring is held by a surface while its reference goes on.

        At rest it is the way of the reference behind the surface over 1/k_m + 1/k, (4.26).
        """
        times = self._times(stage, axis)
        begins = None if times is None else self._begins(stage, axis)
        if times is None or begins is None:
            return None
        force, twist = begins
        # What comes there from free space begins at the surface, wherever that is met.
        gap = stage.nominal.gap if stage.nominal.gap is not None or not twist.any() else 0.0
        coming = float(stage.rotation[:, axis.column] @ twist[:3])
        behind = None if gap is None else _behind(stage, axis, times, (gap, coming))
        if behind is None:
            return None
        sampled = _sampled(self._task, stage.name)
        if sampled is None:
            return None
        own = stage.spring_of(axis)
        gives = 1 / own + 1 / stage.stiffness_of(axis)
        own_way = ReferenceDrive(axis, _with_rates(behind - gives * force, times))
        moved = sampled.follows(axis, [own_way, *_others(stage, axis, times)], twist)
        if moved is None:
            return None
        applied, wanted = force + moved, behind / gives
        # A tool that bounces as it comes there is brought back by its spring, and goes on.
        if _leaves(stage, axis, applied[len(applied) // 2 :]):
            return None
        applied = np.where(applied * stage.facing(axis) > 0, 0.0, applied)
        return ForceCourse(times, wanted, wanted, applied)

    def _begins(self, stage: StagePlan, axis: Axis) -> tuple[float, Vector] | None:
        """Force on an axis [N, N m] and twist of the tip (6,) at first; None if unknown."""
        rest = np.zeros(6)
        stages = self._task.context.loaded.task.stages
        before = [n for n in leading_to(stages, stage.name) if n != stage.name]
        if not before:
            return (0.0, rest) if stage.gripped else None
        if len(before) > 1 or not self._task.stages[before[0]].followed:
            return None
        previous = self._task.stages[before[0]]
        if axis in previous.spec.axes and previous.frame.name == stage.frame.name:
            held = self._at_end(previous, axis)
            if held is not None:
                return held, rest
        way = approach(previous, previous.nominal.gap)
        if way is None or way.contact != stage.contact_of(axis):
            return None
        down = np.concatenate([-way.closing * stage.normal_of(way.contact), np.zeros(3)])
        pressed_force, deep = force_at_end(previous), deepened(previous, way)
        if deep is not None:
            return -stage.facing(axis) * max(deep, pressed_force), rest
        if self._deepens:
            stiffness = stage.context.compliances[way.contact].stiffness
            pressed_force += way.closing * dwell(previous) * stiffness
        # It is along the normal.
        return -stage.facing(axis) * pressed_force, down

    def _at_end(self, stage: StagePlan, axis: Axis) -> float | None:
        """The force of an axis as its stage ends [N, N m]; None where it is not known.

        A guard may end it at any time, which is taken to be once it has settled.
        """
        force = stage.spec.axes[axis].set_point
        course = None if stage.spec.until is not None else self.of(stage.name, axis)
        if force is None:
            return None if course is None else float(course.applied[-1])
        value = stage.known(force.wanted) if course is None else float(course.applied[-1])
        return value if value is not None and math.isfinite(value) else None


def _behind(
    stage: StagePlan, axis: Axis, times: Vector, begins: tuple[float, float]
) -> Vector | None:
    """(k,) where the reference of a motion axis is at each time, its contact's surface at 0 [m].

    Along the axis. None where that is not known, where no spring of the law follows it, and where
    it does not end behind the surface.

    Args:
        stage: the stage.
        axis: a motion axis along a normal.
        times: (k,) since it began [s].
        begins: distance from its contact as it begins [m], and rate of the reference along the
            axis that is handed over [m/s].
    """
    gap, coming = begins
    law, contact = stage.law.control_law, stage.contact_of(axis)
    if law.force_loop or stage.falls or contact is None:
        return None
    if contact != stage.contact or contact in stage.context.moving_bases:
        return None
    if stage.spring_of(axis) <= 0:
        return None
    # A frame that follows a curved surface has no coordinates but the distance from it.
    start = stage.nominal.coordinates or {**dict.fromkeys(AXES, 0.0), Axis.Z: gap}
    motion = reference_motion(stage, start, {**stage.nominal.carried, axis: coming})
    way = None if motion is None else motion.ways.get(axis)
    if way is None:
        return None
    behind: Vector = _along(way, times) + gap / stage.facing(axis)
    deepest = float(behind[-1]) * math.copysign(1.0, -stage.facing(axis))
    return behind if np.isfinite(behind).all() and deepest > 0 else None


def _others(stage: StagePlan, axis: Axis, times: Vector) -> list[ReferenceDrive]:
    """The other references of a law whose springs hold each other, and that move.

    A law with a loop for the force keeps that what it is to be, and one that feeds accelerations
    forward keeps motions apart. On a curved surface references go along it, which a loop about one
    place knows nothing of.
    """
    start, law = stage.nominal.coordinates, stage.law.control_law
    if law.force_loop or law.feeds_forward or stage.path is not None or start is None:
        return []
    motion = reference_motion(stage, start, stage.nominal.carried)
    ways = {} if motion is None else {a: _along(w, times) for a, w in motion.ways.items()}
    moving = {a: way for a, way in ways.items() if a is not axis and np.isfinite(way).all()}
    return [ReferenceDrive(a, _with_rates(way, times)) for a, way in moving.items() if way.any()]


def _along(way: Way, times: Vector) -> Vector:
    """(k,) a way at each time."""
    looks = np.linspace(0.0, float(times[-1]), min(_LOOKS, len(times)))
    return np.interp(times, looks, [float(way(t)) for t in looks.tolist()])


def _with_rates(moved: Vector, times: Vector) -> Vector:
    """(k, 2) a displacement at each time, and its rate."""
    return np.column_stack([moved, np.gradient(moved, times)])


def force_courses(task: TaskPlan) -> tuple[ForceCourses, ForceCourses]:
    """Both courses between which the truth is, for all who ask about a task."""
    if not task.courses:
        task.courses = ForceCourses(task), ForceCourses(task, deepens=False)
    deepens, stays = task.courses
    return deepens, stays


def _lasts(stage: StagePlan) -> float | None:
    """How long a stage lasts [s], at most where a guard may end it; None where nothing tells it."""
    if stage.spec.until is not None:
        return stage.longest if math.isfinite(stage.longest) else None
    passage, course = stage.nominal.passage, stage.nominal.course
    known = [
        stage.spec.time,
        None if course is None else course.duration,
        None if passage is None else passage.last.time,
    ]
    return max((t for t in known if t is not None and math.isfinite(t)), default=None)


def _sprung(stage: StagePlan, axis: Axis) -> ForceCourse | None:
    """The force of a spring whose reference the held mechanism does not follow."""
    passage = stage.nominal.passage
    if passage is None or passage.end not in (End.DONE, End.BOUND):
        return None
    on_way, period = passage.instants, stage.context.period
    count = round(passage.last.time / period)
    if axis not in passage.last.borne or not 0 < count <= _MOST_TICKS:
        return None
    times: Vector = period * np.arange(count, dtype=float)
    wanted = _wanted(stage, axis, times)
    if wanted is None:
        return None
    borne = [i.borne.get(axis, 0.0) for i in on_way]
    applied = np.interp(times, [i.time for i in on_way], borne)
    return ForceCourse(times, wanted, wanted, applied, sprung=True)


def _sampled(task: TaskPlan, name: str) -> SampledStage | None:
    try:
        found = loop_like(task, name)
    except (UnfitError, np.linalg.LinAlgError):
        return None
    return None if found is None or not found.pressed else found


def _wanted(stage: StagePlan, axis: Axis, times: Vector) -> Vector | None:
    """(k,) the set point at each time; None where it depends on more than that."""
    force = stage.spec.axes[axis].set_point
    assert force is not None
    constant = stage.known(force.wanted)
    if constant is not None:
        return np.full(len(times), constant) if math.isfinite(constant) else None
    looks = np.linspace(0.0, float(times[-1]), min(_LOOKS, len(times)))
    values = set_points_at(stage, force.wanted, looks.tolist())
    return None if values is None else np.interp(times, looks, values)


def _leaves(stage: StagePlan, axis: Axis, applied: Vector) -> bool:
    """Whether a force along a normal would have to pull."""
    return bool(np.any(applied * math.copysign(1.0, stage.facing(axis)) > TOUCHING))
