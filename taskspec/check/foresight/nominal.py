"""Where the tool is expected to be in each stage, as far as the text of a task tells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.check.foresight.course import Course, course_of, moving_axes
from taskspec.check.foresight.known import known_value
from taskspec.geometry.axis import AXES, Axis
from taskspec.motion.path import PathShape
from taskspec.motion.profile import RISE_TIME
from taskspec.program.context import Context
from taskspec.program.world.frames import FrameModel
from taskspec.robot.inverse_kinematics import SOLVED, InverseKinematics, Target
from taskspec.spec import Stage
from taskspec.text.show import show

Vector = NDArray[np.float64]

#: Nearer than this, a stage begins at its surface; farther away nothing is felt [m].
AT_SURFACE = 0.5e-3
#: Shares of a stage's duration, not those at which a sine of a few periods is zero.
_SAMPLES = (0.13, 0.37, 0.61, 0.83, 1.0)
#: Drawn configurations from which a place that seems out of reach is looked for once more.
_RESTARTS = 10
#: Places of one task that are looked for so; the time that a task takes to check is bounded by it.
_SEARCHES = 8
#: Of a difference quotient, as a share of the duration.
_STEP = 1e-4


@dataclass(frozen=True, slots=True)
class Place:
    """The arm at one instant of a stage.

    Attributes:
        words: where in the stage.
        rotation: (3, 3) the stage's frame in the world.
        q: (n,) joint positions; None where they cannot be told, or where there are none.
        rates: what is known of the motion axes' velocities, in the frame's axes [m/s, rad/s].
        missed: by how much the tool misses a place out of reach, in words; empty otherwise.
    """

    words: str
    rotation: Vector
    q: Vector | None
    rates: Mapping[Axis, float] = field(default_factory=dict)
    missed: str = ""


def _missed(error: Vector) -> str:
    """The error (3,) or (6,) of inverse kinematics in words."""
    short, askew = (float(np.linalg.norm(e)) for e in (error[:3], error[3:]))
    return show(short, "mm", 3) if short > SOLVED else show(askew, "deg", 3)


class Walk:
    """Goes through the stages in the order of the file, from the start pose.

    Stages that press, or move towards their surface until something is felt, close the gap along
    their way; planned motions end where they lead. What ends by other guards, turns with a
    mechanism or follows a curved surface leaves the place unknown for the stages after it.
    """

    def __init__(self, context: Context) -> None:
        """Begins where the run does."""
        self._context = context
        self._solver = InverseKinematics(context.robot)
        self._p, self._R, self._q = context.start_p, context.start_R, context.start
        self._at = (context.start_p, context.start_R)
        self._known = True
        #: How far the last stage begins from its believed contact [m]; None where that is unknown.
        self.gap: float | None = None
        #: Where the tip of the last stage is as it begins (3,); None where that is unknown.
        self.begin: Vector | None = None
        #: Its coordinates there [m, rad]; None where they are unknown.
        self.coordinates: dict[Axis, float] | None = None
        #: How the last stage moves from there; None where that is not planned.
        self.course: Course | None = None
        #: Its frame as it begins (3, 3).
        self.rotation: Vector = np.eye(3)
        self._searches = _SEARCHES

    def places(
        self, name: str, axes: tuple[Axis, ...], rotation: Vector, path: PathShape | None
    ) -> tuple[Place, ...]:
        """The beginning of stage `name`, and samples of its path.

        Args:
            name: of the stage that comes next in the file. axes: that exist in its frame.
            rotation: (3, 3) its frame at the start pose. path: its path.
        """
        stage = self._context.loaded.task.stages[name]
        frame = self._context.frame_of(stage)
        if frame.kind == "tool":
            rotation = self._R @ frame.rotation
        self.rotation = rotation
        self.gap = self._gap_of(frame)
        self._touch(stage, frame, rotation)
        self.begin = self._p if self._known else None
        begin = self._p, self._R
        straight = self._straight(frame)
        rates = self._rates(stage, axes) if straight else {}
        q, missed = self._joints(*begin)
        places = [Place("where it begins", rotation, q, rates, missed)]
        course = None
        self.coordinates = self._start_coordinates(frame) if straight and self._known else None
        if self.coordinates is not None:
            course = course_of(self._context, stage, self.coordinates, path)
        self.course = course
        if course is not None and course.bends:
            places += self._along(course, frame, rotation, rates)
        self._leave(name, stage, frame, rotation, path, course)
        return tuple(places)

    def _straight(self, frame: FrameModel) -> bool:
        """Whether coordinates of a frame are those of a fixed one, up to a constant."""
        context = self._context
        if frame.mechanism is not None or frame.at_origin or context.base_of(frame) is not None:
            return False
        if context.loaded.task.robot.grasp is not None:
            return False
        return frame.surface is None or frame.surface.flat

    def _to_surface(self, stage: Stage, frame: FrameModel) -> bool:
        """Whether the way to the surface is straight: also along the normal of a curved one."""
        follows = frame.surface is not None and self._context.base_of(frame) is None
        return self._straight(frame) or (
            follows and list(moving_axes(stage)) == ["z"] and not frame.at_origin
        )

    def _joints(self, p: Vector, R: Vector) -> tuple[Vector | None, str]:
        """(n,) joint positions near the last ones that put the tip there, and what is missing."""
        if not self._known:
            return None, ""
        if self._at[0] is not p or self._at[1] is not R:
            turns = any(a.is_rotation for a in self._context.robot.axes)
            target = Target(p, R if turns else None)
            q, size = self._solver.descend(self._q, target)
            if size > SOLVED:
                if not self._searches:
                    self._known = False
                    return None, ""
                self._searches -= 1
                q, size = self._solver.nearest_home(target, _RESTARTS)
            if size > SOLVED:
                return None, _missed(self._solver.error(q, target))
            self._q, self._at = q, (p, R)
        return self._q, ""

    def _rates(self, stage: Stage, axes: tuple[Axis, ...]) -> dict[Axis, float]:
        """Velocities of motion axes that are constant, once blended."""
        found = {}
        for axis in axes:
            entry = stage.axes.get(axis)
            if entry is None or entry.hold is not None:
                found[axis] = 0.0
            elif entry.has_force or entry.follows is not None:
                continue
            elif entry.velocity is not None:
                value = known_value(self._context, entry.velocity)
                if value is not None:
                    found[axis] = value
            elif (
                entry.move is not None
                and entry.speed is not None
                # A shorter move never gets as fast.
                and abs(entry.move) > entry.speed * RISE_TIME
            ):
                found[axis] = math.copysign(entry.speed, entry.move)
        return found

    def _touch(self, stage: Stage, frame: FrameModel, rotation: Vector) -> None:
        """Closes the gap of a stage that presses on its surface."""
        contact = self._context.contact_of(frame)
        if contact is None or not any(a.has_force for a in stage.axes.values()):
            return
        normal = self._context.start_normals[contact]
        gap = self._gap(contact)
        along = max((abs(rotation[:, AXES.index(a) % 3] @ normal), a) for a in stage.axes)
        if gap > 0 and stage.axes[along[1]].has_force:
            self._p = self._p - gap * normal

    def _gap_of(self, frame: FrameModel) -> float | None:
        """Distance [m] from the contact of a frame as a stage begins; None where unknown."""
        contact = self._context.contact_of(frame)
        if contact is None or not self._known or contact in self._context.moving_bases:
            return None
        return self._gap(contact)

    def _gap(self, contact: str) -> float:
        """Distance [m] from a contact here, its surface taken as flat."""
        context = self._context
        way = float(context.start_normals[contact] @ (self._p - context.start_p))
        return context.start_gaps[contact] + way

    def way(self) -> list[tuple[float, Vector]]:
        """Times [s] and places of the tip (3,) on the planned way of the last stage."""
        if self.course is None or self.begin is None:
            return []
        times = [share * self.course.duration for share in (0.0, *_SAMPLES)]
        moved = [(time, self.course.moved(time)) for time in times]
        steps = [(time, np.array([m.get(a, 0.0) for a in AXES[:3]])) for time, m in moved]
        return [(t, self.begin + self.rotation @ d) for t, d in steps if np.isfinite(d).all()]

    def _along(
        self, course: Course, frame: FrameModel, rotation: Vector, rates: Mapping[Axis, float]
    ) -> Iterator[Place]:
        if not course.duration > 0:
            return
        step = _STEP * course.duration
        for share in _SAMPLES:
            time = share * course.duration
            moved, before = course.moved(time), course.moved(time - step)
            if not all(map(math.isfinite, (*moved.values(), *before.values()))):
                return
            p, R = self._moved(moved, rotation)
            turned = R @ frame.rotation if frame.kind == "tool" else rotation
            speeds = {a: (moved[a] - before[a]) / step for a in moved}
            words = f"at t = {show(time, 's', 3)}"
            q, missed = self._joints(p, R)
            yield Place(words, turned, q, dict(rates) | speeds, missed)
            if missed:
                self._known = False  # What comes after it would only be told again.
                return

    def _start_coordinates(self, frame: FrameModel) -> dict[Axis, float]:
        """Coordinates of the tip in a frame as a stage begins; rotations count from there."""
        found = dict.fromkeys(AXES, 0.0)
        if frame.still:
            R, origin = self._context.placed(frame)
            found |= dict(zip(AXES[:3], (R.T @ (self._p - origin)).tolist(), strict=True))
        elif frame.surface_name:
            found[Axis.Z] = self._gap(frame.surface_name)
        return found

    def _moved(self, moved: Mapping[Axis, float], rotation: Vector) -> tuple[Vector, Vector]:
        """(3,), (3, 3) the pose here after a displacement along and about the frame's axes."""
        d = np.array([moved.get(a, 0.0) for a in AXES])
        turn = pin.exp3(rotation @ d[3:]) if d[3:].any() else np.eye(3)
        return self._p + rotation @ d[:3], turn @ self._R

    def _leave(
        self,
        name: str,
        stage: Stage,
        frame: FrameModel,
        rotation: Vector,
        path: PathShape | None,
        course: Course | None,
    ) -> None:
        """Goes to the end of a stage, or forgets where the tool is."""
        moved: dict[Axis, float] | None = {}
        if path is not None or moving_axes(stage):
            moved = self._until_felt(stage, frame, rotation)
            if course is not None and stage.until is None:
                moved = course.moved(course.duration)
        following = list(self._context.loaded.task.stages)
        after = following[following.index(name) + 1 :][:1]
        jumps = stage.next is not None and [stage.next] != after
        if moved is None or jumps or not all(map(math.isfinite, moved.values())):
            self._known = False
        elif any(moved.values()):
            self._p, self._R = self._moved(moved, rotation)

    def _until_felt(
        self, stage: Stage, frame: FrameModel, rotation: Vector
    ) -> dict[Axis, float] | None:
        """Displacement of a stage that moves towards its surface until a guard ends it."""
        contact = self._context.contact_of(frame)
        if contact is None or stage.until is None or not self._to_surface(stage, frame):
            return None
        rates: dict[Axis, float] = {}
        for axis, entry in moving_axes(stage).items():
            value = None if entry.velocity is None else known_value(self._context, entry.velocity)
            if value is None or axis.is_rotation:
                return None
            rates[axis] = value
        v = rotation @ [rates.get(a, 0.0) for a in AXES[:3]]
        closing = -float(self._context.start_normals[contact] @ v)
        if closing <= 0:
            return None
        lasts = max(self._gap(contact), 0.0) / closing
        return {axis: rate * lasts for axis, rate in rates.items()}
