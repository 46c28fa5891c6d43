"""The signals of a finished run in another frame than their stage's: formulas mapped over the log.

Frames, moving bases, handles and signals are those of the controller, as the same expressions.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.reference import opposite
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.bound import RowFunction
from taskspec.program.reference.coordinates import on_handle
from taskspec.program.signals import place
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world import estimated_frames, tracked_frames
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import kinematic_terms
from taskspec.robot.rigid_body import rigid_body
from taskspec.signals import SCALARS, VECTORS, MovingPose, Situation
from taskspec_runner.record.file_array import blocks, empty
from taskspec_runner.record.history import History, Visit

Vector = NDArray[np.float64]

#: Under which the tip stands among frames, of which none is called so.
_TIP = ""


class Replay:
    """Tool poses of every tick, and signals resolved in any nominal frame.

    Forces, moments, velocities and errors belong to the control point of the stage that logged
    them; only their axes change, and a velocity becomes one against what carries the frame. A
    position in a following frame counts from where the visit of its stage began; on a box, the
    frame is that of the face nearest there.

    It works on some ticks at a time; what it has of all of them lies in files if they are many.
    """

    def __init__(
        self,
        robot: RobotModel,
        frames: Mapping[str, FrameModel],
        stages: Sequence[CompiledStage],
        history: History,
        moving_bases: Mapping[str, MovingBase] | None = None,
    ) -> None:
        self._robot, self._frames, self._history = robot, frames, history
        self._bases = moving_bases or {}
        self._stages = {stage.name: stage for stage in stages}
        self._visits = tuple(history.visits())
        self._firsts = [visit.first for visit in self._visits]
        self._faces_of: dict[str, _Faces] = {}
        #: Of each frame what places it, and what places the tip.
        self._placing: dict[str, RowFunction] = {}
        self._twists: dict[str, RowFunction] = {}
        self._levers: dict[int, Vector] = {}
        #: Memory of tracking frames at the last tick; and that from ticks which are not there.
        self._memory: TrackingMemory | None = None
        self._resumed: TrackingMemory | None = None
        self._found: dict[tuple[str, str], Vector] = {}

    def signal(self, name: str, axis: str | None, frame_name: str) -> Vector:
        """(n,) `name.axis` in the axes of a frame, or of a signal without axes that frames turn.

        Args:
            name: of a framed signal.
            axis: of the frame; None for one without axes.
            frame_name: a frame of the task.
        """
        frame = self._frames[frame_name]
        if name == "position":
            return self._position(Axis(axis or ""), frame)
        found = self._kept(name, frame, lambda: self._in_frame(name, frame))
        return np.asanyarray(found[:, 0 if axis is None else Axis(axis).row % found.shape[1]])

    def _kept(self, name: str, frame: FrameModel, make: Callable[[], Vector]) -> Vector:
        """Values of a frame that are computed once."""
        key = (name, frame.name)
        if key not in self._found:
            self._found[key] = make()
        return self._found[key]

    def _by_blocks(self, size: int, part: Callable[[slice], Vector]) -> Vector:
        """(n, size) of what gives (k, size) for k ticks that follow each other, in their order."""
        made = empty((len(self._history), size), np.float64)
        for rows in blocks(len(made)):
            made[rows] = part(rows)
        return made

    def _parts(self, rows: slice) -> Iterator[tuple[Visit, slice, slice]]:
        """Each visit that some ticks belong to: its ticks of them, of all and of these."""
        number = max(bisect_right(self._firsts, rows.start) - 1, 0)
        while number < len(self._visits) and self._visits[number].first < rows.stop:
            visit, number = self._visits[number], number + 1
            first, after = max(visit.first, rows.start), min(visit.last + 1, rows.stop)
            yield visit, slice(first, after), slice(first - rows.start, after - rows.start)

    def _in_frame(self, name: str, frame: FrameModel) -> Vector:
        """(n, size) a framed signal in the axes of a frame."""
        function, used = _in_frame(name)
        mapped = RowFunction(function)

        def part(rows: slice) -> Vector:
            given = self._values(frame, rows)
            if "between" in used:
                given["between"] = self._between(frame, rows)
            (found,) = mapped(*(given[each] for each in used))
            # A frame that is not known has no axes; limits of a formula may hide that.
            found[np.isnan(given["frame"][:, 0])] = np.nan
            return found

        return self._by_blocks(function.numel_out(0), part)

    def _values(self, frame: FrameModel, rows: slice) -> dict[str, Vector]:
        """The arguments of framed signals' formulas at some ticks, in world axes."""
        p, R = self._tip_rows(rows)
        axes = self._placed_rows(frame, rows)[1]
        return {**self._logged(rows), "tip": p, "tip_rotation": R, "frame": axes}

    def _logged(self, rows: slice) -> Mapping[str, Vector]:
        """Axes of each row's own frame, and the vectors that the log has in them."""
        n, columns = rows.stop - rows.start, self._history.columns
        own, wrench, twist, error = (np.zeros((n, size)) for size in (9, 6, 6, 6))
        for visit, there, here in self._parts(rows):
            stage = self._stages[visit.stage]
            own[here] = self._placed_rows(stage.plan.frame, there)[1]
            # An axis that the arm does not have is one along which nothing happens.
            for axis in stage.plan.axes:
                wrench[here, axis.row] = columns[f"{axis.effort}.{axis}"][there]
                twist[here, axis.row] = columns[f"velocity.{axis}"][there]
                error[here, axis.row] = columns[f"error.{axis}"][there]
        return {"own": own, "wrench": wrench, "twist": twist, "error": error}

    def _between(self, frame: FrameModel, rows: slice) -> Vector:
        """(k, 6) velocity at the control point of what carries a stage's frame against another's.

        World axes [m/s, rad/s].
        """
        result = -self._base_twist(frame, rows)
        for visit, there, here in self._parts(rows):
            own = self._stages[visit.stage].plan.frame
            if own.base_name in self._bases:
                result[here] += self._base_twist(own, there)
        return result

    def _base_twist(self, frame: FrameModel, rows: slice) -> Vector:
        """(k, 6) velocity of what carries a frame at the control point; zero for nothing."""
        base = self._bases.get(frame.base_name)
        if base is None:
            return np.zeros((rows.stop - rows.start, 6))
        if frame.base_name not in self._twists:
            self._twists[frame.base_name] = RowFunction(_base_twist(base))
        return self._twists[frame.base_name](self._clock(rows), self._point(rows))[0]

    def _clock(self, rows: slice) -> Vector:
        """(k, 1) run time [s]."""
        return np.asarray(self._history.columns["clock"][rows])[:, np.newaxis]

    def _point(self, rows: slice) -> Vector:
        """(k, 3) the control point of each row's stage in the world [m]."""
        return np.asarray(self._tip_rows(rows)[0] + self._offset(rows))

    def _position(self, axis: Axis, frame: FrameModel) -> Vector:
        result = self._turning(frame) if axis.is_rotation else self._place(frame)
        column = empty(len(result), np.float64)
        column[:] = result[:, axis.column]
        for visit in self._visits:
            if self._stages[visit.stage].plan.frame.name == frame.name:
                own = self._history.columns[f"position.{axis}"]
                column[visit.rows] = own[visit.rows]
        return column

    def _place(self, frame: FrameModel) -> Vector:
        """(n, 3) coordinates of the control point in a frame, as docs/language/frames.md counts."""
        if frame.still:
            return self._kept("place", frame, lambda: self._still(frame))
        if frame.mechanism is not None:
            return self._kept("place", frame, lambda: self._on_handle(frame))
        return self._kept("place", frame, lambda: self._along(frame))

    def _still(self, frame: FrameModel) -> Vector:
        """(n, 3) coordinates in a frame that nothing moves."""
        function, used = _in_frame("position")
        mapped = RowFunction(function)

        def part(rows: slice) -> Vector:
            origin, axes, *_ = self._placed_rows(frame, rows)
            given = {"point": self._point(rows), "origin": origin, "frame": axes}
            return mapped(*(given[each] for each in used))[0]

        return self._by_blocks(3, part)

    def _along(self, frame: FrameModel) -> Vector:
        """(n, 3) the distance along the axes of a frame that moves, from each visit's start."""
        moved, so_far = RowFunction(_moved()), np.zeros((1, 3))

        def part(rows: slice) -> Vector:
            nonlocal so_far
            since = slice(max(rows.start - 1, 0), rows.stop)
            _, _, foot, relative = self._placed_rows(frame, since)
            here = foot if frame.kind == "following" else self._point(since)
            # Where the visit's first tick is among these, it stays zero.
            result, skipped = np.zeros((rows.stop - rows.start, 3)), rows.start - since.start
            for visit, there, own in self._parts(rows):
                begins = there.start == visit.first
                first = own.start + begins
                if first >= own.stop:
                    continue
                now = slice(first + skipped, own.stop + skipped)
                (steps,) = moved(relative[now], here[now], here[now.start - 1 : now.stop - 1])
                if not begins:
                    steps = np.concatenate([so_far, steps])
                result[first : own.stop] = np.cumsum(steps, axis=0)[0 if begins else 1 :]
            so_far = result[-1:].copy()
            if frame.kind == "following":
                result[:, 2] = self._history.columns[f"{frame.surface_name}.gap"][rows]
            return result

        return self._by_blocks(3, part)

    def _on_handle(self, frame: FrameModel) -> Vector:
        """(n, 3) coordinates along the circle of a handle, each visit from where it began."""
        angle_of, coordinates = map(RowFunction, _on_handle(frame))
        # Whole turns are counted from the angle nearest to that of rest.
        before, turned, since = np.nan, 0.0, 0.0

        def part(rows: slice) -> Vector:
            nonlocal before, turned, since
            point = self._point(rows)
            measured = angle_of(point)[0][:, 0]
            steps = np.diff(measured, prepend=measured[0] if np.isnan(before) else before)
            turns = np.cumsum(np.concatenate([[turned], _turns(steps)]))[1:]
            before, turned, angle = float(measured[-1]), float(turns[-1]), measured + turns
            begun = np.empty_like(angle)
            for visit, there, here in self._parts(rows):
                if there.start == visit.first:
                    since = float(angle[here.start])
                begun[here] = since
            return coordinates(point, angle[:, np.newaxis], begun[:, np.newaxis])[0]

        return self._by_blocks(3, part)

    def _turning(self, frame: FrameModel) -> Vector:
        """(n, 3) rotation vector of the tool since its visit began, in a frame's axes."""
        turned_of = RowFunction(_turned())

        def part(rows: slice) -> Vector:
            result = np.zeros((rows.stop - rows.start, 3))
            for visit, there, here in self._parts(rows):
                start = slice(visit.first, visit.first + 1)
                tool, begun = self._tip_rows(there)[1], self._tip_rows(start)[1]
                onto = self._placed_rows(frame, start)[1]
                axes = onto if frame.kind == "tool" else self._placed_rows(frame, there)[1]
                given = (np.broadcast_to(each, tool.shape) for each in (axes, tool, begun, onto))
                (turned,) = turned_of(*given)
                # The controller's logarithm has no digits left within 1e-11 of half a turn.
                result[here] = [pin.log3(R) for R in _matrices(turned)]
            return result

        return self._kept("turning", frame, lambda: self._by_blocks(3, part))

    def offset(self) -> Vector:
        """(n, 3) from the tip to the control point of each row's stage, world axes [m]."""
        return np.asarray(self._by_blocks(3, self._offset))

    def _offset(self, rows: slice) -> Vector:
        R = _matrices(self._tip_rows(rows)[1])
        result = np.zeros((len(R), 3))
        for visit, _, here in self._parts(rows):
            if self._stages[visit.stage].plan.frame.at_origin:
                result[here] = R[here] @ self._lever(visit)
        return result

    def _lever(self, visit: Visit) -> Vector:
        """(3,) from the tip to the control point of a visit, in the tool's axes [m]."""
        frame = self._stages[visit.stage].plan.frame
        if frame.kind == "tool":
            return frame.origin
        if visit.first not in self._levers:
            start = slice(visit.first, visit.first + 1)
            p, R = self._tip_rows(start)
            origin = self._placed_rows(frame, start)[0][0]
            self._levers[visit.first] = _matrices(R)[0].T @ (origin - p[0])
        return self._levers[visit.first]

    def tip_pose(self) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) pose of the tip in the world, from the logged joint positions."""
        tip = np.asarray(self._tip)
        return tip[:, :3], _matrices(tip[:, 3:])

    def axes(self, frame: FrameModel, rows: slice) -> tuple[Vector, Vector]:
        """(k, 3, 3) axes of the tip and of a frame in the world at some ticks."""
        return _matrices(self._tip_rows(rows)[1]), _matrices(self._placed_rows(frame, rows)[1])

    def pose(self, frame: FrameModel) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) origin (of a following frame: the foot) and axes in the world."""
        found = np.asarray(self._kept("pose", frame, lambda: self._poses(frame)))
        return found[:, :3], _matrices(found[:, 3:])

    def _poses(self, frame: FrameModel) -> Vector:
        return self._by_blocks(12, lambda rows: np.hstack(self._placed_rows(frame, rows)[:2]))

    @cached_property
    def _tip(self) -> Vector:
        """(n, 12) place of the tip and its axes, by columns."""
        n, columns = self._robot.n, self._history.columns
        if _TIP not in self._placing:
            self._placing[_TIP] = RowFunction(_tip(self._robot))
        mapped = self._placing[_TIP]

        def part(rows: slice) -> Vector:
            joints = [columns[f"joint.{i + 1}.position"][rows] for i in range(n)]
            return mapped(np.column_stack(joints))[0]

        return self._by_blocks(12, part)

    def _tip_rows(self, rows: slice) -> tuple[Vector, Vector]:
        """(k, 3), (k, 9) place of the tip and its axes at some ticks."""
        found = np.asarray(self._tip[rows])
        return found[:, :3], found[:, 3:]

    def _placed_rows(self, frame: FrameModel, rows: slice) -> tuple[Vector, ...]:
        """(k, 3), (k, 9) origin and axes of a frame: in the world, and against what carries it."""
        if frame.name not in self._faces_of:
            self._faces_of[frame.name] = self._faces(frame)
        faces = self._faces_of[frame.name]
        if frame.name not in self._placing:
            base = self._bases.get(frame.base_name)
            self._placing[frame.name] = RowFunction(_placed(self._robot, frame, base, faces.size))
        function = self._placing[frame.name]
        arguments = (*self._tip_rows(rows), self._clock(rows))
        return function(*arguments, *((faces.at(rows),) if faces.size else ()))

    def _faces(self, frame: FrameModel) -> _Faces:
        """Inputs of a frame in addition to the tool: its part of a surface, or a measured pose."""
        if frame.kind == "estimated":
            return self._measured_poses(frame)
        if frame.tracking is not None:
            return self._tracked(frame)
        base, tool = self._bases.get(frame.base_name), self._robot.tool
        found: list[tuple[int, Vector | None]] = []
        for visit in self._visits if frame.surface is not None else ():
            start = slice(visit.first, visit.first + 1)
            p, R = self._tip_rows(start)
            center = p[0]
            if not tool.flat:
                center = center + _matrices(R)[0] @ tool.centers[0]
            if base is not None:
                A, a = base.pose(float(self._clock(start)[0, 0]))
                center = A.T @ (center - a)
            assert frame.surface is not None
            face = frame.surface.face_at(ca.SX(ca.DM(np.asarray(center))))
            found.append((visit.first, None if face is None else np.array(ca.evalf(face)).ravel()))
        size = next((len(face) for _, face in found if face is not None), 0)
        nothing = np.zeros(size)
        return _Faces(size, [(row, nothing if face is None else face) for row, face in found])

    def _measured_poses(self, frame: FrameModel) -> _Faces:
        """(12,) the pose that was measured last before each row; NaN before the first time."""
        measured = self._frames[frame.estimated_in]
        unknown = np.full(estimated_frames.SIZE, np.nan)
        found = [(0, unknown)]
        for visit in self._visits:
            following = visit.last + 1
            if visit.stage != measured.estimate or following == len(self._history):
                continue
            place = self._tip_rows(slice(following, following + 1))[0][0]
            try:
                R, origin = estimated_frames.measure(measured, self._mean_force(visit), place)
                found.append((following, np.concatenate([R.ravel(order="F"), origin])))
            except estimated_frames.NotEstimatedError:
                found.append((following, unknown))
        return _Faces(estimated_frames.SIZE, found)

    def _tracked(self, frame: FrameModel) -> _Faces:
        """(9,) what a frame that tracks something had in its memory; NaN outside its stages."""
        columns, n = self._history.columns, len(self._history)
        found = np.full((n, tracked_frames.SIZE), np.nan)
        last = self._resumed
        resumed = 0 if last is None else last.tick + 1
        for visit in self._visits:
            plan = self._stages[visit.stage].plan if visit.stage in self._stages else None
            if plan is None or plan.frame.tracking is None or visit.last < resumed:
                continue
            rows, of = slice(max(visit.first, resumed), visit.last + 1), plan.frame.tracking.of
            measured = np.zeros((rows.stop - rows.start, 9))
            for i, axis in enumerate(AXES[:3]):
                if axis in plan.axes:
                    measured[:, i] = opposite(columns[f"force.{axis}.measured"][rows])
            for i, axis in enumerate(AXES):
                if axis in plan.axes:
                    measured[:, 3 + i] = columns[f"velocity.{axis}"][rows]
            R = _matrices(self._tip_rows(rows)[1])
            first = tracked_frames.begun(plan.frame, ca.SX(ca.DM(R[0])))
            begun = np.array(ca.evalf(first)).ravel()
            if last is not None and last.of == of and last.tick + 1 == rows.start:
                begun = last.before if rows.start == visit.first else last.after
            after = _tracking(self._robot, plan.frame, self._period).mapaccum(len(measured))
            states = np.array(after(begun, measured.T, R.reshape(len(R), 9).T))
            behind = states[:, -1]
            # What a tick puts out is of before it.
            states = np.column_stack([begun, states[:, :-1]])
            last = TrackingMemory(of, states[:, -1], behind, visit.last)
            if plan.frame.name == frame.name:
                found[rows] = states.T
        self._memory = last
        return _Faces(tracked_frames.SIZE, list(enumerate(found)))

    @cached_property
    def _period(self) -> float:
        return float(np.median(np.diff(self._history.columns["clock"])))

    def _mean_force(self, visit: Visit) -> Vector:
        """(3,) mean force by the environment that the controller measured at a visit's end."""
        stage, columns = self._stages[visit.stage], self._history.columns
        first = max(visit.first, visit.last + 1 - estimated_frames.window(self._period))
        rows = slice(first, visit.last + 1)
        measured = np.zeros((visit.last + 1 - first, 3))
        for i, axis in enumerate(AXES[:3]):
            if axis in stage.plan.axes:
                measured[:, i] = columns[f"force.{axis}.measured"][rows]
        R = _matrices(self._placed_rows(stage.plan.frame, rows)[1])
        return opposite(np.asarray(np.einsum("kij,kj->ki", R, measured).mean(axis=0)))


def constant_axes(
    robot: RobotModel, frame: FrameModel, base: MovingBase | None
) -> NDArray[np.float64] | None:
    """(3, 3) axes of a frame in the world; None where they depend on the tool, time or the run."""
    if frame.kind == "estimated" or frame.tracking is not None:
        return None
    if frame.surface is not None and frame.surface.face_at(ca.SX.sym("center", 3)) is not None:
        return None
    placed = _placed(robot, frame, base, 0)
    if any(placed.jac_sparsity(1, i).nnz() for i in range(placed.n_in())):
        return None
    axes = placed(*(ca.DM.zeros(placed.sparsity_in(i)) for i in range(placed.n_in())))[1]
    return np.array(axes).reshape(3, 3, order="F")


class TrackingMemory(NamedTuple):
    """The memory of a tracking frame: of what, (9,) before and after a tick, and which tick."""

    of: str
    before: Vector
    after: Vector
    tick: int


class _Faces:
    """Numbers that a frame needs in addition to the tool, each from some tick to the next one's.

    Attributes:
        size: how many numbers.
    """

    def __init__(self, size: int, found: Sequence[tuple[int, Vector]]) -> None:
        """Takes ticks, in order, and the numbers (size,) from there on."""
        self.size = size
        self._firsts = np.array([row for row, _ in found], dtype=np.int64)
        self._values = np.array([values for _, values in found]).reshape(len(found), size)

    def at(self, rows: slice) -> Vector:
        """(k, size) at some ticks."""
        ticks = np.arange(rows.start, rows.stop)
        last = np.searchsorted(self._firsts, ticks, side="right") - 1
        return np.asarray(self._values[last])


def _turns(steps: Vector) -> Vector:
    """Full turns to add to steps of an angle (k,) so that none is half a turn or more [rad]."""
    nearest = np.mod(steps + np.pi, 2 * np.pi) - np.pi
    nearest[(nearest == -np.pi) & (steps > 0)] = np.pi
    return np.where(np.abs(steps) < np.pi, 0.0, nearest - steps)


def _matrices(rows: Vector) -> Vector:
    """(n, 3, 3) of matrices that stand in rows (n, 9), by columns."""
    return np.asarray(rows.reshape(-1, 3, 3).transpose(0, 2, 1))


def _matrix(name: str) -> tuple[ca.SX, ca.SX]:
    """A (9,) symbol, and the (3, 3) matrix that it holds by columns."""
    symbol = ca.SX.sym(name, 9)
    return symbol, ca.reshape(symbol, 3, 3)


def _tip(robot: RobotModel) -> ca.Function:
    """Joint positions (n,) -> place of the tip and its axes, by columns (12,)."""
    q = ca.SX.sym("q", robot.n)
    p, R = rigid_body(robot).tip(q)
    return ca.Function("tip", [q], [ca.densify(ca.vertcat(p, ca.vec(R)))])


def _placed(
    robot: RobotModel, frame: FrameModel, base: MovingBase | None, parameters: int
) -> ca.Function:
    """A frame where the tool is: what `Replay._placed_rows` has in a row.

    Its arguments are p (3,) and R (9,) of the tip in the world, the clock, and the parameters that
    the frame needs, if any.
    """
    p, clock, face = ca.SX.sym("p", 3), ca.SX.sym("clock"), ca.SX.sym("face", parameters)
    symbol, R = _matrix("R")
    nothing = ca.SX.zeros(6)
    terms = kinematic_terms(p, R, nothing)
    placed = place(robot, frame, base, terms, nothing, clock, None, face if parameters else None)
    at, now, tip = placed.at, placed.moving_base, placed.terms
    if at.origin is not None:
        origin = at.origin
    elif at.foot is not None:
        origin = at.foot
    else:
        origin = tip.p + tip.R @ ca.DM(frame.origin) if frame.kind == "tool" else tip.p
    world = (origin, at.R) if now is None else (now.world(origin), now.A @ at.R)
    outputs = [world[0], ca.vec(world[1]), origin, ca.vec(at.R)]
    arguments = [p, symbol, clock, face] if parameters else [p, symbol, clock]
    return ca.Function("placed", arguments, [ca.densify(x) for x in outputs])


def _tracking(robot: RobotModel, frame: FrameModel, period: float) -> ca.Function:
    """The memory update of a tracking frame.

    (9,) before a tick, the force by the environment (3,) and the tip's twist (6,) in the frame's
    axes, the tip's axes (9,) by rows -> (9,) after it.
    """
    state, measured = ca.SX.sym("state", tracked_frames.SIZE), ca.SX.sym("measured", 9)
    tip, tool = ca.SX.sym("tip", 9), robot.tool
    R, _ = tracked_frames.axes(frame, state[3:6])
    local = np.zeros(3) if tool.flat else tool.centers[0]
    lever = ca.reshape(tip, 3, 3).T @ ca.DM(local)
    velocity = R @ measured[3:6] + ca.cross(R @ measured[6:], lever)
    now = tracked_frames.tracked(frame, R @ measured[:3], velocity)
    return ca.Function(
        "tracking", [state, measured, tip], [tracked_frames.step(frame, state, now, period)]
    )


@cache
def _in_frame(name: str) -> tuple[ca.Function, tuple[str, ...]]:
    """A framed signal in the axes of a frame, and the names of what it needs of each tick."""
    (tool_symbol, tool), (own_symbol, own), (frame_symbol, frame) = (
        _matrix(each) for each in ("tip_rotation", "own", "frame")
    )
    six = {each: ca.SX.sym(each, 6) for each in ("wrench", "twist", "between", "error")}
    three = {each: ca.SX.sym(each, 3) for each in ("tip", "point", "origin")}
    both = ca.diagcat(own, own)
    error = ca.diagcat(frame, frame).T @ both @ six["error"]
    local = frame.T @ (three["point"] - three["origin"])
    at = Situation(
        axes=AXES,
        tip=MovingPose(three["tip"], tool),
        frame=frame,
        applied=both @ six["wrench"],
        twist=both @ six["twist"] + six["between"],
        position={axis: local[axis.row] for axis in AXES[:3]},
        error={axis: error[axis.row] for axis in AXES},
    )
    signal = VECTORS.get(name) or SCALARS[name]
    value = ca.vertcat(*at.components(signal).values()) if signal.axes else at.signal(name)
    symbols = {
        "tip_rotation": tool_symbol,
        "own": own_symbol,
        "frame": frame_symbol,
        **six,
        **three,
    }
    used = {each: symbol for each, symbol in symbols.items() if ca.depends_on(value, symbol)}
    return ca.Function(name, list(used.values()), [ca.densify(value)]), tuple(used)


@cache
def _moved() -> ca.Function:
    """Axes (9,), a place and the one before (3,) -> the displacement along the axes (3,)."""
    symbol, R = _matrix("R")
    here, before = ca.SX.sym("here", 3), ca.SX.sym("before", 3)
    return ca.Function("moved", [symbol, here, before], [R.T @ (here - before)])


@cache
def _turned() -> ca.Function:
    """Axes and tool now, tool and axes as the visit began (9,) -> how the tool has turned (9,)."""
    pairs = [_matrix(name) for name in ("base", "tool", "begun", "onto")]
    base, tool, begun, onto = (matrix for _, matrix in pairs)
    turned = base.T @ tool @ begun.T @ onto
    return ca.Function("turned", [symbol for symbol, _ in pairs], [ca.vec(turned)])


def _base_twist(base: MovingBase) -> ca.Function:
    """Clock and a world point (3,) -> velocity (6,) that a moving base has there."""
    clock, point = ca.SX.sym("clock"), ca.SX.sym("point", 3)
    return ca.Function("base", [clock, point], [ca.densify(base.at(clock).twist(point))])


def _on_handle(frame: FrameModel) -> tuple[ca.Function, ca.Function]:
    """A point (3,) -> the handle's angle, less whole turns; and with angles -> coordinates (3,)."""
    assert frame.mechanism is not None
    point, angle, since = ca.SX.sym("point", 3), ca.SX.sym("angle"), ca.SX.sym("since")
    about = frame.mechanism.angle(point, ca.SX.eye(3), ca.SX(0))
    coordinates = on_handle(frame, frame.mechanism, point, angle, since)
    return (
        ca.Function("angle", [point], [about]),
        ca.Function("on_handle", [point, angle, since], [coordinates]),
    )
