"""Expected places of the tool in each stage, as far as the text of a task determines them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.motion.blend import BLEND_TIME
from taskspec.program.contacts import PASSING
from taskspec.program.context import Context
from taskspec.program.passage import End, Passage
from taskspec.program.plan import StagePlan
from taskspec.program.stages.conditions import NEAR_SINGULAR
from taskspec.program.trajectory import Course, Nominal, Place
from taskspec.program.walk.arm_walk import ArmWalk
from taskspec.program.walk.course import course_of, moving_axes
from taskspec.program.walk.handed_rates import rates_at_end, rates_of, twist_of
from taskspec.program.walk.joint_walk import end_of, joint_passage, tip_at
from taskspec.robot.inverse_kinematics import SOLVED, InverseKinematics, Target
from taskspec.text.units import show

Vector = NDArray[np.float64]

#: Nearer than this, a stage begins at its surface; farther away nothing is measured [m].
AT_SURFACE = 0.5e-3
#: Drawn configurations from which a place that seems out of reach is searched once more.
_RESTARTS = 10
#: Places of one task that are searched so; the time that a task takes to check is bounded by it.
_SEARCHES = 8
#: Slower than this is what rounding makes of an axis that is held [m/s, rad/s].
_RATE_ROUNDING = 1e-6
#: Of a difference quotient, as a share of the duration.
_STEP = 1e-4


def _missed(error: Vector) -> str:
    """The error (3,) or (6,) of inverse kinematics in words."""
    short, askew = (float(np.linalg.norm(e)) for e in (error[:3], error[3:]))
    return show(short, "mm", 3) if short > SOLVED else show(askew, "deg", 3)


class NominalWalk:
    """Goes through the stages in the order of the file, from the start pose.

    Stages that press, or move towards their surface until a force is measured, close the gap along
    their path; planned motions end where they lead. What ends by other guards, turns with a
    mechanism or follows a curved surface leaves the place unknown for the stages after it.
    """

    def __init__(self, context: Context) -> None:
        """Starts at the start pose of the run."""
        self._context = context
        self._solver = InverseKinematics(context.robot)
        self._arm = ArmWalk(context)
        self._p, self._R, self._q = context.start_p, context.start_R, context.start
        self._at = (context.start_p, context.start_R)
        self._twist = np.zeros(6)
        self._known = True
        self._searches = _SEARCHES

    @property
    def tool(self) -> tuple[Vector, Vector]:
        """(3,), (3, 3) where the tip is last known to be, world axes."""
        return self._p, self._R

    def stage(self, stage: StagePlan) -> Nominal:
        """The nominal trajectory of the stage that comes next in the file."""
        # After a path of joints, what counts from the start counts from where that leads.
        self._context = stage.context
        if stage.joint_path is not None:
            return self._in_joints(stage)
        rotation = stage.kinematics.frame_at_tool
        gap = self._gap_of(stage)
        self._touch(stage, rotation)
        start = self._p if self._known else None
        straight = self._straight(stage)
        rates = self._rates(stage) if straight else {}
        q, missed = self._joints(self._p, self._R)
        places = [Place("where it begins", rotation, q, rates, missed)]
        carried = rates_of(stage, rotation, self._twist) if straight else {}
        course = None
        coordinates = self._start_coordinates(stage) if straight and self._known else None
        if coordinates is not None:
            course = course_of(stage, coordinates, carried)
        if course is not None and course.bends:
            places += self._along(course, stage, rotation, rates)
        passage = self._passage(stage, rotation)
        if passage is not None:
            places += self._remarkable(stage, passage)
        self._leave(stage, rotation, course)
        self._meet(stage, passage)
        unbraked = course
        if coordinates is not None and any(carried.values()):
            unbraked = course_of(stage, coordinates, {})
        return Nominal(
            rotation, gap, start, coordinates, course, tuple(places), carried, passage, unbraked
        )

    def _in_joints(self, stage: StagePlan) -> Nominal:
        """The nominal trajectory of a path of joints, at whose end the arm is known again."""
        arm = self._arm
        rotation, gap = stage.kinematics.frame_at_tool, self._gap_of(stage)
        start = self._p if self._known else None
        q = arm.q if arm.known else self._joints(self._p, self._R)[0]
        passage = None if q is None else joint_passage(stage, q)
        about = joint_passage(stage, arm.q) if passage is None else None
        ends = end_of(stage)
        arrives = stage.spec.until is None and (passage is None or passage.end is End.DONE)
        self._known = arm.known = arrives and ends is not None and not self._jumps(stage)
        self._twist = np.zeros(6)
        if self._known and ends is not None:
            self._q = ends
            self._p, self._R = tip_at(self._context.robot, self._q)
            self._at = (self._p, self._R)
            arm.p, arm.R, arm.q = self._p, self._R, self._q
        begins = Place("where it begins", rotation, None)
        return Nominal(rotation, gap, start, None, None, (begins,), passage=passage, about=about)

    def _passage(self, stage: StagePlan, rotation: Vector) -> Passage | None:
        """The predicted motion of the arm in a stage."""
        arm = self._arm
        p, R = (self._p, self._R) if self._known and not self._held else (arm.p, arm.R)
        to_contact = self._until_contact(stage, rotation)
        lasts = None
        if to_contact is not None and self._known and any(to_contact.values()):
            rates = {a: m.constant_rate(stage.known) for a, m in moving_axes(stage.spec).items()}
            axis = max(to_contact, key=lambda a: abs(to_contact[a]))
            lasts = to_contact[axis] / (rates[axis] or math.inf) + BLEND_TIME / 2
        return arm.stage(stage, p, R, lasts)

    def _remarkable(self, stage: StagePlan, passage: Passage) -> Iterator[Place]:
        """The first instants of joints or tip beyond a limit, and of an arm near a singularity."""
        robot, on_path = self._context.robot, passage.instants[1:]
        if not on_path:
            return
        speed = math.inf if stage.limits.speed is None else stage.limits.speed
        fast = next((i for i in on_path if np.any(np.abs(i.v) > robot.velocity_limit)), None)
        swift = next((i for i in on_path if np.linalg.norm(i.twist[:3]) > speed), None)
        stiff = next((i for i in on_path if i.pivot < NEAR_SINGULAR), None)
        instants = {i.time: i for i in (fast, swift, stiff) if i is not None}
        for _, i in sorted(instants.items()):
            rates = {a: float(i.twist[a.row]) for a in stage.axes}
            rates = {a: rate if abs(rate) > _RATE_ROUNDING else 0.0 for a, rate in rates.items()}
            yield Place(i.words, i.frame, i.q, {} if i is stiff else rates)

    @property
    def _held(self) -> bool:
        return self._context.loaded.task.robot.grasp is not None

    def _meet(self, stage: StagePlan, passage: Passage | None) -> None:
        """Where the arm ends is where the tool is, if nothing else determines that."""
        arm = self._arm
        if self._jumps(stage):
            arm.known = False
        if self._known and not self._held and not arm.known and not self._jumps(stage):
            arm.known, arm.p, arm.R, arm.q = True, self._p, self._R, self._q
        elif arm.known and not self._known and passage is not None and not self._held:
            self._known, self._p, self._R, self._q = True, arm.p, arm.R, arm.q
            self._at = (self._p, self._R)

    def _straight(self, stage: StagePlan) -> bool:
        """Whether coordinates of its frame are those of a fixed one, up to a constant."""
        frame = stage.frame
        if frame.mechanism is not None or frame.at_origin or stage.moving_base is not None:
            return False
        if self._context.loaded.task.robot.grasp is not None:
            return False
        return frame.surface is None or frame.surface.flat

    def _to_surface(self, stage: StagePlan) -> bool:
        """Whether the path to the surface is straight: also along the normal of a curved one."""
        follows = stage.frame.surface is not None and stage.moving_base is None
        return self._straight(stage) or (
            follows and list(moving_axes(stage.spec)) == ["z"] and not stage.frame.at_origin
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

    def _rates(self, stage: StagePlan) -> dict[Axis, float]:
        """Velocities of motion axes that are constant, once blended."""
        found = {}
        for axis in stage.axes:
            entry = stage.spec.axes.get(axis)
            mode = None if entry is None else entry.given
            if entry is None or (mode is not None and not mode.moves and not entry.has_force):
                found[axis] = 0.0
            elif mode is not None and not entry.has_force:
                rate = mode.reached_rate(stage.known)
                if rate is not None:
                    found[axis] = rate
        return found

    def _touch(self, stage: StagePlan, rotation: Vector) -> None:
        """Closes the gap of a stage that presses on its surface."""
        contact, axes = stage.contacts.main, stage.spec.axes
        if contact is None or not any(a.has_force for a in axes.values()):
            return
        normal = stage.contacts.normal(contact)
        gap = self._gap(stage, contact)
        along = max((abs(rotation[:, a.column] @ normal), a) for a in axes)
        if gap > 0 and axes[along[1]].has_force:
            self._p = self._p - gap * normal

    def _gap_of(self, stage: StagePlan) -> float | None:
        """Distance [m] from the contact of a stage as it starts; None where unknown."""
        contact = stage.contacts.main
        if contact is None or not self._known or contact in self._context.moving_bases:
            return None
        return self._gap(stage, contact)

    def _gap(self, stage: StagePlan, contact: str) -> float:
        """Distance [m] from a contact here, its surface taken as flat where it faces the start."""
        context = self._context
        if stage.contacts.normal(contact) is not context.start_normals[contact]:
            return context.obstacles.gap(contact, self._p, self._R)
        moved = float(context.start_normals[contact] @ (self._p - context.start_p))
        return context.start_gaps[contact] + moved

    def _along(
        self, course: Course, stage: StagePlan, rotation: Vector, rates: Mapping[Axis, float]
    ) -> Iterator[Place]:
        if not course.duration > 0:
            return
        frame = stage.frame
        step = _STEP * course.duration
        for time in course.instants():
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
                self._known = False  # What comes after it would only be reported again.
                return

    def _start_coordinates(self, stage: StagePlan) -> dict[Axis, float]:
        """Coordinates of the tip in a stage's frame as it starts; rotations count from there."""
        found = dict.fromkeys(AXES, 0.0)
        if stage.frame.still:
            R, origin = self._context.placed(stage.frame)
            found |= dict(zip(AXES[:3], (R.T @ (self._p - origin)).tolist(), strict=True))
        elif stage.frame.surface_name:
            found[Axis.Z] = self._gap(stage, stage.frame.surface_name)
        return found

    def _moved(self, moved: Mapping[Axis, float], rotation: Vector) -> tuple[Vector, Vector]:
        """(3,), (3, 3) the pose here after a displacement along and about the frame's axes."""
        d = np.array([moved.get(a, 0.0) for a in AXES])
        turn = pin.exp3(rotation @ d[3:]) if d[3:].any() else np.eye(3)
        return self._p + rotation @ d[:3], turn @ self._R

    def _leave(self, stage: StagePlan, rotation: Vector, course: Course | None) -> None:
        """Goes to the end of a stage, or forgets where the tool is."""
        moved: dict[Axis, float] | None = {}
        if stage.path is not None or moving_axes(stage.spec):
            moved = self._until_contact(stage, rotation)
            if course is not None and stage.spec.until is None:
                moved = course.moved(course.duration)
        self._twist = np.zeros(6)
        jumps = self._jumps(stage)
        if self._straight(stage) and not jumps:
            self._twist = twist_of(rates_at_end(stage, course), rotation)
        if moved and stage.spec.repeat > 1 and any(moved.values()):
            moved = None  # Where it ends the last time depends on how it turns meanwhile.
        if moved is None or jumps or not all(map(math.isfinite, moved.values())):
            self._known = False
        elif any(moved.values()):
            self._p, self._R = self._moved(moved, rotation)

    def _jumps(self, stage: StagePlan) -> bool:
        """Whether another stage may follow than the next one of the file.

        A stage that follows itself, and whose references are places, ends where it did.
        """
        following = list(self._context.loaded.task.stages)
        after = following[following.index(stage.name) + 1 :][:1]
        again = [[stage.name]] if self._returns(stage) else []
        return any([branch.to] not in (after, *again) for branch in stage.spec.next)

    def _returns(self, stage: StagePlan) -> bool:
        """Whether a stage ends at the same place wherever it begins."""
        modes = moving_axes(stage.spec).values()
        return stage.path is None and all(mode.placed for mode in modes)

    def _until_contact(self, stage: StagePlan, rotation: Vector) -> dict[Axis, float] | None:
        """Displacement of a stage that moves towards its surface until a guard ends it."""
        contact = stage.contacts.approached
        if contact is None or stage.spec.until is None or not self._to_surface(stage):
            return None
        rates: dict[Axis, float] = {}
        for axis, mode in moving_axes(stage.spec).items():
            rate = mode.constant_rate(stage.known)
            if rate is None or axis.is_rotation:
                return None
            rates[axis] = rate
        v = rotation @ [rates.get(a, 0.0) for a in AXES[:3]]
        closing = -float(stage.contacts.normal(contact) @ v)
        if closing <= PASSING * float(np.linalg.norm(v)):
            return None
        lasts = max(self._gap(stage, contact), 0.0) / closing
        return {axis: rate * lasts for axis, rate in rates.items()}
