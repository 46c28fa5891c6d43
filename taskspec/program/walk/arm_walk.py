"""The arm's trajectory through the stages of a task: where each ends, and what stops it.

References are laid from rest, the tool is carried along them by the frame, the surface or the
mechanism that it holds, and the joints follow. A stage ends as its guard, its bounds and its moves
say, as far as that is known without a measured force.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.expression import evaluate
from taskspec.expression.tree import Held, Name, Reduce, walk
from taskspec.geometry.axis import AXES, Axis
from taskspec.motion.blend import BLEND_TIME
from taskspec.program.context import Context
from taskspec.program.interval import ANY, Interval, IntervalAlgebra, point
from taskspec.program.passage import End, Instant, Passage
from taskspec.program.plan import StagePlan
from taskspec.program.signals import constant, entry_of, natural
from taskspec.program.walk.pose_follower import PoseFollower, Taken
from taskspec.program.walk.reference_motion import (
    ReferenceMotion,
    reference_motion,
    start_coordinates,
)
from taskspec.program.walk.tool_motion import OnSurface, Straight, ToolMotion, WithMechanism
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.program.world.stiffness import GRIP
from taskspec.robot import RobotModel

Vector = NDArray[np.float64]

#: A stage that nothing bounds is sampled for so long [s].
_HORIZON = 60.0
#: Instants at which references are sampled.
_FINE = 240
#: A trajectory is cut into pieces of this length [m, rad times the arm's length],
_PIECE = 0.012
#: of which there are so many.
_FEWEST_PIECES, _MOST_PIECES = 10, 48
#: What a mechanism bears while it moves is friction, damping and what starts it, up to this share
#: more; a guard that compares with more waits for the stop.
_BEARS = 2.0
#: A rate is blended in with up to this share of it more than evenly: 6 s (1 - s) at its middle.
_STEEPEST = 1.5
_NARROWINGS = 12
#: A rotation is ambiguous with the opposite one beyond this [rad].
_HALF_TURN = 0.95 * math.pi
#: Added to that, for what the arm's errors make [N]: of a moment, at the lever of handle or grip.
_AT_LEAST = 1.0


class ArmWalk:
    """Goes through the stages in the order of the file, from the start configuration.

    Attributes:
        q: (n,) where the joints are.
        p, R: (3,), (3, 3) where the tip is, world axes.
        known: whether that is known.
        coordinate: of the held mechanism [rad, m].
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self.q, self.p, self.R = context.start, context.start_p, context.start_R
        self.known, self.coordinate = True, 0.0

    def stage(self, stage: StagePlan, p: Vector, R: Vector, lasts: float | None) -> Passage | None:
        """The predicted motion of the arm in the next stage; None where that is unknown.

        Args:
            stage: the stage.
            p, R: (3,), (3, 3) the tip as it begins.
            lasts: until it comes to its surface [s]; None where that is not what ends it.
        """
        if not self.known or stage.moving_base is not None:
            self.known = False
            return None
        found = self._passage(stage, p, R, lasts)
        self.known = found is not None and found.end in (End.DONE, End.STOP)
        if found is not None:
            last = found.last
            self.q, self.p, self.R = last.q, last.p, last.R
            if last.coordinate is not None:
                self.coordinate = last.coordinate
        return found

    def _passage(
        self, stage: StagePlan, p: Vector, R: Vector, lasts: float | None
    ) -> Passage | None:
        tool_motion = self._tool_motion(stage, p, R)
        if tool_motion is None:
            return None
        arm = PoseFollower(self._context, stage)
        begun = arm.take(self.q, p, R, tool_motion.frame, 1.0)
        if begun.missed is not None:
            return None
        start = start_coordinates(stage, p, R)
        motion = reference_motion(stage, start, {})
        if motion is None or (stage.spec.until is None and motion.lasts is None):
            return None
        none = np.zeros(6)
        first = Instant(
            0.0, p, R, tool_motion.frame, begun.q, np.zeros(len(begun.q)), none,
            _coordinate_of(tool_motion), math.inf, dict.fromkeys(AXES, 0.0),
        )  # fmt: skip
        instants = [first]
        guard = None
        if stage.spec.until is not None and lasts is None:
            guard = _Guard(stage, motion, start, first)
        if not motion.displacements and guard is None:
            return Passage((first,), End.DONE)
        horizon = _horizon(stage, motion, lasts)
        return self._go(stage, tool_motion, arm, motion, guard, horizon, instants)

    def _tool_motion(self, stage: StagePlan, p: Vector, R: Vector) -> ToolMotion | None:
        """The motion that carries the tool; None where that is unknown."""
        if self._context.loaded.task.robot.grasp is not None:
            if not self._context.held or _driven_by_force(stage):
                return None
            return WithMechanism(stage, p, R, self.coordinate)
        frame = stage.frame
        if frame.kind == "following":
            return OnSurface(stage, p, R)
        return Straight(stage, p, R) if frame.mechanism is None else None

    def _go(
        self,
        stage: StagePlan,
        tool_motion: ToolMotion,
        arm: PoseFollower,
        motion: ReferenceMotion,
        guard: _Guard | None,
        horizon: float,
        instants: list[Instant],
    ) -> Passage:
        """Goes until something ends the stage."""
        fine, moves, marks, fastest = _times(motion, horizon)
        if guard is not None:
            held = guard.at(instants[0], tool_motion)
            if not held.never:
                return _ended(instants, tool_motion, End.DONE if held.always else End.OPEN)
        for before, mark, fast in zip(marks[:-1], marks[1:], fastest, strict=True):
            # A mechanism is followed more finely: it may turn away from what moves it.
            points = range(before + 1, mark + 1) if self._context.held else (mark,)
            last, time = instants[-1], 0.0
            moved = last.moved
            for i in points:
                time = float(fine[i])
                moved = moves[i]
                if not all(map(math.isfinite, moved.values())):
                    return _ended(instants, tool_motion, End.OPEN)
                tool_motion.advance(time, moved)
                if _strained(tool_motion):
                    break
            if tool_motion.left:
                return _ended(instants, tool_motion, End.EDGE, edge=tool_motion.left)
            lasts = time - last.time
            taken = arm.take(last.q, tool_motion.p, tool_motion.R, tool_motion.frame, lasts)
            if taken.missed is not None:
                return _ended(instants, tool_motion, End.REACH, missed=taken.missed)
            instants.append(_instant(time, last, tool_motion, taken, moved, fast))
            found = self._end(stage, tool_motion, guard, instants)
            if found is not None:
                return found
        if guard is None:
            return _ended(instants, tool_motion, End.DONE)
        bounded = math.isfinite(stage.longest)
        return _ended(instants, tool_motion, End.BOUND if bounded else End.OPEN)

    def _end(
        self,
        stage: StagePlan,
        tool_motion: ToolMotion,
        guard: _Guard | None,
        instants: list[Instant],
    ) -> Passage | None:
        """The end of the stage between its last two instants; None where it goes on."""
        robot, last, here = self._context.robot, instants[-2], instants[-1]
        if ((here.q > robot.upper) | (here.q < robot.lower)).any():
            joint, share = _crossed(robot, last.q, here.q)
            instants[-1] = mixed(last, here, share)
            return _ended(instants, tool_motion, End.JOINT, joint=joint)
        if _strained(tool_motion):
            return _ended(instants, tool_motion, End.STRAIN)
        if guard is not None:
            holds = guard.at(here, tool_motion)
            if holds.always:
                instants[-1] = guard.between(last, here)
                return _ended(instants, tool_motion, End.DONE)
            if not holds.never:
                stops = isinstance(tool_motion, WithMechanism) and tool_motion.stopped is not None
                return _ended(instants, tool_motion, End.STOP if stops else End.OPEN)
        passed = _travelled(stage, instants)
        if passed is None:
            return None
        instants[-1] = mixed(last, here, passed)
        return _ended(instants, tool_motion, End.BOUND)


def _strained(tool_motion: ToolMotion) -> bool:
    return isinstance(tool_motion, WithMechanism) and tool_motion.strained


def _ended(
    instants: list[Instant],
    tool_motion: ToolMotion,
    end: End,
    *,
    joint: int | None = None,
    missed: Vector | None = None,
    edge: str = "",
) -> Passage:
    strain, stopped, drive = None, None, None
    if isinstance(tool_motion, WithMechanism):
        strain, stopped, drive = tool_motion.strain, tool_motion.stopped, tool_motion.drive
    return Passage(tuple(instants), end, joint, missed, strain, stopped, edge, drive)


def _driven_by_force(stage: StagePlan) -> bool:
    """Whether a force of a stage, which is not zero or not known, may move what is held."""
    for axis, entry in stage.spec.axes.items():
        if entry.has_force and stage.set_points.of(axis) != 0.0:
            return True
    return False


def _coordinate_of(tool_motion: ToolMotion) -> float | None:
    return tool_motion.coordinate if isinstance(tool_motion, WithMechanism) else None


def _horizon(stage: StagePlan, motion: ReferenceMotion, lasts: float | None) -> float:
    if lasts is not None:
        return min(lasts, stage.longest)
    if stage.spec.until is None:
        return motion.lasts or 0.0
    return min(stage.longest, _HORIZON)


def _times(
    motion: ReferenceMotion, horizon: float
) -> tuple[Vector, list[dict[Axis, float]], list[int], list[float]]:
    """Times, displacements then, those that begin a piece, and how much faster each gets.

    Faster, that is, than its mean.
    """
    fine = np.linspace(0.0, horizon, _FINE)
    still = dict.fromkeys(AXES, 0.0)
    moves = [
        still | {a: float(moved(t)) for a, moved in motion.displacements.items()}
        for t in fine.tolist()
    ]
    if not motion.displacements:
        return fine, moves, [0, _FINE - 1], [1.0]
    lengths = np.array([ARM_LENGTH if a.is_rotation else 1.0 for a in motion.displacements])
    at = lengths * np.array([[moved[a] for a in motion.displacements] for moved in moves])
    at = np.where(np.isfinite(at), at, 0.0)
    steps = np.linalg.norm(np.diff(at, axis=0), axis=1)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    pieces = int(np.clip(math.ceil(gone[-1] / _PIECE), _FEWEST_PIECES, _MOST_PIECES))
    # Half of the time itself keeps pieces short where references start and end.
    measure = gone / max(gone[-1], 1e-12) + 0.5 * fine / max(horizon, 1e-12)
    marks = np.searchsorted(measure, np.linspace(0.0, measure[-1], pieces + 1))
    # `np.unique` would load all of `numpy.ma` for it.
    marks = np.array(sorted({*np.minimum(marks, _FINE - 1).tolist()}))
    faster = []
    for a, b in itertools.pairwise(marks):
        net = float(np.linalg.norm(at[b] - at[a])) / (b - a)
        peak = float(steps[a:b].max())
        faster.append(peak / net if net > 0.1 * peak > 0 else 1.0)
    return fine, moves, marks.tolist(), faster


def _instant(
    time: float,
    last: Instant,
    tool_motion: ToolMotion,
    taken: Taken,
    moved: Mapping[Axis, float],
    fast: float,
) -> Instant:
    """The instant after the last, the references `fast` times as fast as their mean at most."""
    lasts = time - last.time
    turn = pin.log3(tool_motion.R @ last.R.T)
    inside = tool_motion.frame.T
    twist = np.concatenate([inside @ (tool_motion.p - last.p), inside @ turn]) * (fast / lasts)
    v = (taken.q - last.q) / lasts
    borne = tool_motion.borne if isinstance(tool_motion, WithMechanism) else {}
    return Instant(
        time, tool_motion.p, tool_motion.R, tool_motion.frame, taken.q, v, twist,
        _coordinate_of(tool_motion), taken.pivot, dict(moved), borne,
    )  # fmt: skip


def _crossed(robot: RobotModel, before: Vector, q: Vector) -> tuple[int, float]:
    """The joint that comes to its limit first between two configurations (n,), and where."""
    room = np.where(q > before, robot.upper - before, before - robot.lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(q != before, np.maximum(room, 0.0) / np.abs(q - before), np.inf)
    joint = int(np.argmin(share))
    return joint, min(float(share[joint]), 1.0)


def _travelled(stage: StagePlan, instants: list[Instant]) -> float | None:
    """The share of the last piece at which `within.travel` is passed; None where it is not."""
    within = stage.spec.within
    most = None if within is None else within.travel
    before, here = (float(np.linalg.norm(i.p - instants[0].p)) for i in instants[-2:])
    if most is None or here <= most:
        return None
    return (most - before) / (here - before)


class _Guard:
    """The value of `until` of a stage along its trajectory."""

    def __init__(
        self,
        stage: StagePlan,
        motion: ReferenceMotion,
        start: Mapping[Axis, float],
        first: Instant,
    ) -> None:
        assert stage.spec.until is not None
        tree = stage.spec.until.tree
        self._node = tree.x if isinstance(tree, Held) else tree
        self._stage, self._motion, self._start, self._first = stage, motion, start, first
        self._context = stage.context
        #: What depends on the past is not followed.
        self._pointwise = not any(isinstance(part, Held | Reduce) for part in walk(self._node))
        self._algebra = IntervalAlgebra()

    def at(self, here: Instant, tool_motion: ToolMotion) -> Interval:
        """Whether it holds at an instant, as far as that is known there."""
        if not self._pointwise:
            return Interval(0.0, 1.0)
        known = self._signals(here) | self._effort(here, tool_motion)
        return self._worth(known)

    def _worth(self, known: Mapping[str, Interval]) -> Interval:
        return evaluate(self._node, self._algebra, lambda n: self._value(n, known))

    def _value(self, name: Name, known: Mapping[str, Interval]) -> Interval:
        if name.frame is not None:
            return ANY
        if str(name) in known:
            return known[str(name)]
        found = entry_of(self._context.loaded.task, name.path)
        if found is None:
            return constant(self._context, name) or ANY
        return natural(found)

    def _signals(self, here: Instant) -> dict[str, Interval]:
        """Signals that follow from the references and the arm's geometry."""
        found = {"t": point(here.time)}
        found["travel"] = point(float(np.linalg.norm(here.p - self._first.p)))
        found |= {f"joint.{i + 1}.position": point(float(x)) for i, x in enumerate(here.q)}
        if self._motion.path_lasts is not None:
            found["path_done"] = point(float(here.time >= self._motion.path_lasts))
        if here.coordinate is not None:
            name, lead = self._context.held, self._model.lead
            if self._model.angular:
                found[f"{name}.angle"] = point(here.coordinate)
            found[f"{name}.travel"] = point((lead if self._model.angular else 1) * here.coordinate)
            return found | self._held_place(here)
        for axis, plan in self._stage.plans.items():
            if plan.motion and not plan.axis.has_force:
                start = 0.0 if axis.is_rotation else self._start[axis]
                # A rotation vector ends at half a turn.
                if not axis.is_rotation or abs(here.moved[axis]) < math.pi:
                    found[f"position.{axis}"] = point(start + here.moved[axis])
        return found

    def _held_place(self, here: Instant) -> dict[str, Interval]:
        """The displacement of the tool by the mechanism, in a frame that stands still."""
        frame, turned = self._stage.frame, pin.log3(here.R @ self._first.R.T)
        # A rotation vector ends at half a turn.
        if not frame.still or frame.at_origin or np.linalg.norm(turned) > _HALF_TURN:
            return {}
        moved = here.frame.T @ (here.p - self._first.p)
        found = {f"position.{a}": point(self._start[a] + float(moved[a.row])) for a in AXES[:3]}
        turns = here.frame.T @ turned
        return found | {f"position.{a}": point(float(turns[a.row - 3])) for a in AXES[3:]}

    @property
    def _model(self) -> MechanismModel:
        return self._context.mechanisms[self._context.held]

    def _effort(self, here: Instant, tool_motion: ToolMotion) -> dict[str, Interval]:
        """The load of the held mechanism before it comes to its stop."""
        if not isinstance(tool_motion, WithMechanism) or tool_motion.stopped is not None:
            return {}
        declared = self._context.loaded.task.mechanisms[self._context.held]
        assert here.coordinate is not None
        assert self._first.coordinate is not None
        if declared.detent is not None and here.time > 0:
            return {}
        bears = 0.0
        if here.time > 0:
            rate = abs(here.coordinate - self._first.coordinate) / here.time
            lever = max(GRIP.lever, self._model.radius) if declared.angular else 1.0
            begins = 0.0
            if here.time <= BLEND_TIME:
                begins = _STEEPEST * declared.coordinate_inertia * rate / BLEND_TIME
            bears = _BEARS * (declared.friction + declared.damping * rate)
            bears += max(_AT_LEAST * lever, begins)
        effort = "torque" if declared.angular else "force"
        return {f"{self._context.held}.{effort}": Interval(-bears, bears)}

    def between(self, last: Instant, here: Instant) -> Instant:
        """The instant between two at which it first holds, by straight lines between them."""
        low, high = 0.0, 1.0
        for _ in range(_NARROWINGS):
            middle = (low + high) / 2
            held = self._worth(self._signals(mixed(last, here, middle)))
            low, high = (low, middle) if held.always else (middle, high)
        return mixed(last, here, high)


def mixed(last: Instant, here: Instant, share: float) -> Instant:
    """An instant between two others, by straight lines."""

    def mix(a: float, b: float) -> float:
        return a + share * (b - a)

    turn = pin.exp3(share * pin.log3(here.R @ last.R.T))
    coordinate = None
    if here.coordinate is not None and last.coordinate is not None:
        coordinate = mix(last.coordinate, here.coordinate)
    return replace(
        here,
        time=mix(last.time, here.time),
        p=last.p + share * (here.p - last.p),
        R=turn @ last.R,
        q=last.q + share * (here.q - last.q),
        coordinate=coordinate,
        moved={a: mix(last.moved[a], here.moved[a]) for a in AXES},
        borne={a: mix(last.borne.get(a, 0.0), f) for a, f in here.borne.items()},
    )
