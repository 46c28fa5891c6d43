"""The signals of a finished run in another frame than their stage's: formulas mapped over the log.

Frames, moving bases, handles and signals are those of the controller, as the same expressions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, cached_property

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.reference import opposite
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.bound import over_rows
from taskspec.program.reference.coordinates import on_handle
from taskspec.program.signals import place
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world import estimated_frames
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import kinematic_terms
from taskspec.signals import SCALARS, VECTORS, MovingPose, Situation
from taskspec_runner.record.history import History, Visit

Vector = NDArray[np.float64]


class Replay:
    """Where the tool was at every tick, and its signals resolved in any nominal frame.

    Forces, moments, velocities and errors belong to the control point of the stage that logged
    them; only their axes change, and a velocity becomes one against what carries the frame. A
    position in a following frame counts from where the visit of its stage began; on a box, the
    frame is that of the face nearest there.
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
        self._tip: tuple[Vector, Vector] | None = None
        self._placed: dict[str, tuple[Vector, ...]] = {}
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
        key = (name, frame_name)
        if key not in self._found:
            function, used = _in_frame(name)
            given = self._values(frame)
            if "between" in used:
                given["between"] = self._between(frame)
            (found,) = over_rows(function, *(given[each] for each in used))
            # A frame that is not known has no axes; limits of a formula may hide that.
            found[np.isnan(given["frame"][:, 0])] = np.nan
            self._found[key] = found
        found = self._found[key]
        return np.asarray(found[:, 0 if axis is None else Axis(axis).row % found.shape[1]])

    def _values(self, frame: FrameModel) -> dict[str, Vector]:
        """What the formulas of framed signals are told at every tick, in world axes."""
        p, R = self._tip_rows()
        axes = self._placed_rows(frame)[1]
        return {**self._logged, "tip": p, "tip_rotation": R, "frame": axes}

    @cached_property
    def _logged(self) -> Mapping[str, Vector]:
        """Axes of each row's own frame, and the vectors that the log has in them."""
        n, columns = len(self._history), self._history.columns
        own, wrench, twist, error = (np.zeros((n, size)) for size in (9, 6, 6, 6))
        for visit in self._visits:
            stage, rows = self._stages[visit.stage], visit.rows
            own[rows] = self._placed_rows(stage.plan.frame)[1][rows]
            # An axis that the arm does not have is one along which nothing happens.
            for axis in stage.plan.axes:
                wrench[rows, axis.row] = columns[f"{axis.effort}.{axis}"][rows]
                twist[rows, axis.row] = columns[f"velocity.{axis}"][rows]
                error[rows, axis.row] = columns[f"error.{axis}"][rows]
        return {"own": own, "wrench": wrench, "twist": twist, "error": error}

    def _between(self, frame: FrameModel) -> Vector:
        """(n, 6) velocity at the control point of what carries a stage's frame against another's.

        World axes [m/s, rad/s].
        """
        result = -self._base_twist(frame)
        for visit in self._visits:
            own = self._stages[visit.stage].plan.frame
            if own.base_name in self._bases:
                result[visit.rows] += self._base_twist(own)[visit.rows]
        return result

    def _base_twist(self, frame: FrameModel) -> Vector:
        """(n, 6) velocity of what carries a frame at the control point; zero for nothing."""
        base = self._bases.get(frame.base_name)
        if base is None:
            return np.zeros((len(self._history), 6))
        return over_rows(_base_twist(base), self._clock, self._point)[0]

    @property
    def _clock(self) -> Vector:
        return self._history.columns["clock"][:, np.newaxis]

    @cached_property
    def _point(self) -> Vector:
        """(n, 3) the control point of each row's stage in the world [m]."""
        return np.asarray(self._tip_rows()[0] + self.offset())

    def _position(self, axis: Axis, frame: FrameModel) -> Vector:
        result = self._turning(frame) if axis.is_rotation else self._place(frame)
        column = result[:, axis.column]
        for visit in self._visits:
            if self._stages[visit.stage].plan.frame is frame:
                own = self._history.columns[f"position.{axis}"]
                column[visit.rows] = own[visit.rows]
        return column

    def _place(self, frame: FrameModel) -> Vector:
        """(n, 3) coordinates of the control point in a frame, as docs/language.md counts."""
        origin, axes, foot, relative = self._placed_rows(frame)
        if frame.still:
            function, used = _in_frame("position")
            given = {"point": self._point, "origin": origin, "frame": axes}
            return over_rows(function, *(given[each] for each in used))[0]
        if frame.mechanism is not None:
            return self._on_handle(frame)
        here = foot if frame.kind == "following" else self._point
        result = np.zeros_like(here)
        for visit in self._visits:
            now = slice(visit.first + 1, visit.last + 1)
            before = slice(visit.first, visit.last)
            (steps,) = over_rows(_moved(), relative[now], here[now], here[before])
            result[now] = np.cumsum(steps, axis=0)
        if frame.kind == "following":
            result[:, 2] = self._history.columns[f"{frame.surface_name}.gap"]
        return result

    def _on_handle(self, frame: FrameModel) -> Vector:
        """(n, 3) coordinates along the circle of a handle, each visit from where it began."""
        angle_of, coordinates = _on_handle(frame)
        # Whole turns are counted from the angle nearest to that of rest.
        angle = np.unwrap(over_rows(angle_of, self._point)[0], axis=0)
        since = np.zeros_like(angle)
        for visit in self._visits:
            since[visit.rows] = angle[visit.first]
        return over_rows(coordinates, self._point, angle, since)[0]

    def _turning(self, frame: FrameModel) -> Vector:
        """(n, 3) rotation vector of the tool since its visit began, in a frame's axes."""
        tool, axes = self._tip_rows()[1], self._placed_rows(frame)[1]
        result = np.zeros((len(tool), 3))
        for visit in self._visits:
            rows, first = visit.rows, slice(visit.first, visit.first + 1)
            size = tool[rows].shape
            base = np.broadcast_to(axes[first], size) if frame.kind == "tool" else axes[rows]
            begun, onto = np.broadcast_to(tool[first], size), np.broadcast_to(axes[first], size)
            (turned,) = over_rows(_turned(), base, tool[rows], begun, onto)
            # The controller's logarithm has no digits left within 1e-11 of half a turn.
            result[rows] = [pin.log3(R) for R in _matrices(turned)]
        return result

    def offset(self) -> Vector:
        """(n, 3) from the tip to the control point of each row's stage, world axes [m]."""
        p, R = self.tip_pose()
        result = np.zeros_like(p)
        for visit in self._visits:
            frame = self._stages[visit.stage].plan.frame
            if not frame.at_origin:
                continue
            lever = frame.origin
            if frame.kind != "tool":
                origin = self._placed_rows(frame)[0][visit.first]
                lever = R[visit.first].T @ (origin - p[visit.first])
            result[visit.rows] = R[visit.rows] @ lever
        return result

    def tip_pose(self) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) pose of the tip in the world, from the logged joint positions."""
        p, R = self._tip_rows()
        return p, _matrices(R)

    def pose(self, frame: FrameModel) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) origin (of a following frame: the foot) and axes in the world."""
        origin, axes, *_ = self._placed_rows(frame)
        return origin, _matrices(axes)

    def _tip_rows(self) -> tuple[Vector, Vector]:
        if self._tip is None:
            model, tip = self._robot.pin, self._robot.tip
            data = model.createData()
            columns = self._history.columns
            q = np.column_stack([columns[f"joint.{i + 1}.position"] for i in range(model.nv)])
            p, R = np.empty((len(q), 3)), np.empty((len(q), 9))
            for row, joints in enumerate(q):
                pin.forwardKinematics(model, data, joints)
                pose = data.oMi[self._robot.tip_joint] * tip
                p[row], R[row] = pose.translation, pose.rotation.ravel(order="F")
            self._tip = p, R
        return self._tip

    def _placed_rows(self, frame: FrameModel) -> tuple[Vector, ...]:
        """(n, 3), (n, 9) origin and axes of a frame: in the world, and against what carries it."""
        if frame.name not in self._placed:
            p, R = self._tip_rows()
            face = self._faces(frame)
            base = self._bases.get(frame.base_name)
            function = _placed(self._robot, frame, base, face.shape[1])
            arguments = (p, R, self._clock, face)[: function.n_in()]
            self._placed[frame.name] = over_rows(function, *arguments)
        return self._placed[frame.name]

    def _faces(self, frame: FrameModel) -> Vector:
        """(n, k) what a frame needs besides the tool: its part of a surface, or a measured pose."""
        p, R = self.tip_pose()
        if frame.kind == "estimated":
            return self._measured_poses(frame)
        base, tool = self._bases.get(frame.base_name), self._robot.tool
        result = np.zeros((len(p), 0))
        if frame.surface is None:
            return result
        for visit in self._visits:
            center = p[visit.first]
            if not tool.flat:
                center = center + R[visit.first] @ tool.centers[0]
            if base is not None:
                A, a = base.pose(float(self._clock[visit.first, 0]))
                center = A.T @ (center - a)
            face = frame.surface.face_at(center)
            if face is not None:
                result = result if result.size else np.zeros((len(p), len(face)))
                result[visit.rows] = face
        return result

    def _measured_poses(self, frame: FrameModel) -> Vector:
        """(n, 12) the pose that was measured last before each row; NaN before the first time."""
        measured = self._frames[frame.estimated_in]
        p = self._tip_rows()[0]
        result = np.full((len(p), estimated_frames.SIZE), np.nan)
        for visit in self._visits:
            following = visit.last + 1
            if visit.stage != measured.estimate or following == len(p):
                continue
            try:
                R, origin = estimated_frames.measure(
                    measured, self._mean_force(visit), p[following]
                )
                result[following:] = np.concatenate([R.ravel(order="F"), origin])
            except estimated_frames.NotEstimatedError:
                result[following:] = np.nan
        return result

    def _mean_force(self, visit: Visit) -> Vector:
        """(3,) mean force by the environment that the controller measured at a visit's end."""
        stage, columns = self._stages[visit.stage], self._history.columns
        clock = columns["clock"]
        period = float(np.median(np.diff(clock)))
        first = max(visit.first, visit.last + 1 - estimated_frames.window(period))
        rows = slice(first, visit.last + 1)
        measured = np.zeros((visit.last + 1 - first, 3))
        for i, axis in enumerate(AXES[:3]):
            if axis in stage.plan.axes:
                measured[:, i] = columns[f"force.{axis}.measured"][rows]
        R = self.pose(stage.plan.frame)[1][rows]
        return opposite(np.asarray(np.einsum("kij,kj->ki", R, measured).mean(axis=0)))


def _matrices(rows: Vector) -> Vector:
    """(n, 3, 3) of matrices that stand in rows (n, 9), by columns."""
    return np.asarray(rows.reshape(-1, 3, 3).transpose(0, 2, 1))


def _matrix(name: str) -> tuple[ca.SX, ca.SX]:
    """A (9,) symbol, and the (3, 3) matrix that it holds by columns."""
    symbol = ca.SX.sym(name, 9)
    return symbol, ca.reshape(symbol, 3, 3)


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
    """Axes (9,), where something is and where it was (3,) -> its way along the axes (3,)."""
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
