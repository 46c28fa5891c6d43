"""Signals of a finished run in another frame than their stage's: the logged poses, replayed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.program.prepare import chart_at
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world import estimated_frames
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.robot import RobotModel
from taskspec.shapes import SurfaceChart
from taskspec_runner.record.history import History, Visit
from taskspec_runner.verdict.moving import Ride, handle_axes, handle_coordinates, ride

Vector = NDArray[np.float64]
_PART = (slice(0, 3), slice(3, 6))


class Replay:
    """Where the tool was at every tick, and its signals resolved in any nominal frame.

    Forces, moments, velocities and errors belong to the control point of the stage that logged
    them; only their axes change, and a velocity becomes one against what carries the frame. A
    position in a following frame counts from where the visit of
    its stage began; on a box, the frame is that of the face nearest there.
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
        self._rides: dict[str, Ride] = {}
        self._stages = {stage.name: stage for stage in stages}
        self._visits = tuple(history.visits())
        self._tip: tuple[Vector, Vector] | None = None
        self._posed: dict[str, tuple[Vector, Vector]] = {}

    def signal(self, name: str, axis: str | None, frame_name: str) -> Vector:
        """(n,) `name.axis` in the axes of a frame, or `tilt` against it.

        Args:
            name: force, torque, position, velocity, error or tilt.
            axis: of the frame; None for tilt.
            frame_name: a frame of the task.
        """
        frame = self._frames[frame_name]
        if axis is None:
            R = self.tip_pose()[1]
            along = np.einsum("ki,ki->k", R[:, :, 2], self.pose(frame)[1][:, :, 2])
            return np.asarray(np.arccos(np.clip(-along, -1.0, 1.0)))
        number = AXES.index(axis)
        if name != "position":
            return self._turned(name, number, frame)
        turned = number > 2
        result = self._turning(frame) if turned else self._place(frame)
        column = result[:, number % 3]
        for visit in self._visits:
            if self._stages[visit.stage].plan.frame is frame:
                own = self._history.columns[f"position.{axis}"]
                column[visit.rows] = own[visit.rows]
        return column

    def _turned(self, name: str, number: int, frame: FrameModel) -> Vector:
        """One component of a logged vector, from the stage's axes to those of a frame."""
        axes = AXES[3:] if number > 2 else AXES[:3]
        result = np.empty(len(self._history))
        R = self.pose(frame)[1]
        for visit in self._visits:
            stage, rows = self._stages[visit.stage], visit.rows
            logged = np.zeros((visit.last + 1 - visit.first, 3))
            for i, axis in enumerate(axes):
                # An axis that the arm does not have is one along which nothing happens.
                if axis in stage.plan.axes:
                    logged[:, i] = self._history.columns[f"{name}.{axis}"][rows]
            own = self.pose(stage.plan.frame)[1][rows]
            vector = np.einsum("kji,ki->kj", own, logged)
            if name == "velocity":
                vector = (
                    vector + self._between(stage.plan.frame, frame, rows)[:, _PART[number // 3]]
                )
            result[rows] = np.einsum("kj,kj->k", R[rows, :, number % 3], vector)
        return result

    def _between(self, inner: FrameModel, outer: FrameModel, rows: slice) -> Vector:
        """(k, 6) velocity at the control point of what carries `inner` against that of `outer`."""
        if inner.base_name not in self._bases and outer.base_name not in self._bases:
            return np.zeros((rows.stop - rows.start, 6))
        point = self.tip_pose()[0] + self.offset()
        return np.asarray(
            self._ride(inner).twist(point)[rows] - self._ride(outer).twist(point)[rows]
        )

    def _ride(self, frame: FrameModel) -> Ride:
        """What carries a frame, at every tick."""
        name = frame.base_name if frame.base_name in self._bases else ""
        if name not in self._rides:
            clock = self._history.columns["clock"]
            self._rides[name] = ride(self._bases.get(name), clock)
        return self._rides[name]

    def _place(self, frame: FrameModel) -> Vector:
        """(n, 3) coordinates of the control point in a frame, as docs/language.md counts."""
        foot, R = self.pose(frame)
        point = self.tip_pose()[0] + self.offset()
        if frame.still:
            return np.asarray(np.einsum("kji,kj->ki", R, point - foot))
        if frame.mechanism is not None:
            away = handle_coordinates(frame.mechanism, point)
            for visit in self._visits:
                away[visit.rows, 1] -= away[visit.first, 1]
            return np.asarray((away - frame.origin) @ frame.rotation)
        carried = self._ride(frame)
        here = carried.place(foot if frame.kind == "following" else point)
        R = np.einsum("kji,kjl->kil", carried.A, R)
        result = np.zeros((len(here), 3))
        for visit in self._visits:
            rows = visit.rows
            steps = np.einsum("kji,kj->ki", R[rows][1:], np.diff(here[rows], axis=0))
            result[rows][1:] = np.cumsum(steps, axis=0)
        if frame.kind == "following":
            result[:, 2] = self._history.columns[f"{frame.surface_name}.gap"]
        return result

    def _turning(self, frame: FrameModel) -> Vector:
        """(n, 3) rotation vector of the tool since its visit began, in a frame's axes."""
        tool, R = self.tip_pose()[1], self.pose(frame)[1]
        result = np.zeros((len(tool), 3))
        for visit in self._visits:
            base = R[visit.rows]
            if frame.kind == "tool":
                base = np.broadcast_to(base[0], base.shape)
            start = R[visit.first].T @ tool[visit.first]
            away = np.einsum("kji,kjl,ml->kim", base, tool[visit.rows], start)
            result[visit.rows] = [pin.log3(rotation) for rotation in away]
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
                origin = self.pose(frame)[0][visit.first]
                lever = R[visit.first].T @ (origin - p[visit.first])
            result[visit.rows] = R[visit.rows] @ lever
        return result

    def tip_pose(self) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) pose of the tip in the world, from the logged joint positions."""
        if self._tip is None:
            model, tip = self._robot.pin, self._robot.tip
            data = model.createData()
            columns = self._history.columns
            q = np.column_stack([columns[f"joint.{i + 1}.position"] for i in range(model.nv)])
            p, R = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
            for row, joints in enumerate(q):
                pin.forwardKinematics(model, data, joints)
                pose = data.oMi[self._robot.tip_joint] * tip
                p[row], R[row] = pose.translation, pose.rotation
            self._tip = p, R
        return self._tip

    def pose(self, frame: FrameModel) -> tuple[Vector, Vector]:
        """(n, 3), (n, 3, 3) origin (of a following frame: the foot) and axes in the world."""
        if frame.name not in self._posed:
            self._posed[frame.name] = self._new_pose(frame)
        return self._posed[frame.name]

    def _new_pose(self, frame: FrameModel) -> tuple[Vector, Vector]:
        p, R = self.tip_pose()
        carried = self._ride(frame)
        if frame.kind == "fixed":
            return carried.world(np.broadcast_to(frame.origin, p.shape)), carried.A @ frame.rotation
        if frame.mechanism is not None:
            return p, handle_axes(frame.mechanism, p) @ frame.rotation
        if frame.kind == "tool":
            return p + R @ frame.origin, R @ frame.rotation
        if frame.kind == "estimated":
            return self._felt_pose(frame)
        assert frame.surface is not None
        tool = self._robot.tool
        centers = carried.place(p if tool.flat else p + R @ tool.centers[0])
        feet, axes = np.empty_like(p), np.empty_like(R)
        for visit in self._visits:
            rows = visit.rows
            follow = _follower(frame, chart_at(frame.surface, centers[visit.first]))
            turned, foot = (np.array(v) for v in follow(centers[rows].T))
            feet[rows], axes[rows] = foot.T, turned.T.reshape(-1, 3, 3).transpose(0, 2, 1)
        return carried.world(feet), carried.A @ axes

    def _felt_pose(self, frame: FrameModel) -> tuple[Vector, Vector]:
        """The pose that was measured last before each row; NaN before the first time."""
        measured = self._frames[frame.estimated_in]
        p = self.tip_pose()[0]
        origins, axes = np.full((len(p), 3), np.nan), np.full((len(p), 3, 3), np.nan)
        for visit in self._visits:
            following = slice(visit.last + 1, None)
            if visit.stage != measured.estimate or visit.last + 1 == len(p):
                continue
            try:
                R, origin = estimated_frames.measure(
                    measured, self._mean_force(visit), p[visit.last + 1]
                )
            except estimated_frames.NotEstimatedError:
                R, origin = np.full((3, 3), np.nan), np.full(3, np.nan)
            local_R, local_origin = frame.in_estimated
            origins[following], axes[following] = origin + R @ local_origin, R @ local_R
        return origins, axes

    def _mean_force(self, visit: Visit) -> Vector:
        """(3,) mean force by the environment that the controller measured at a visit's end."""
        stage, columns = self._stages[visit.stage], self._history.columns
        clock = columns["clock"]
        period = float(np.median(np.diff(clock)))
        first = max(visit.first, visit.last + 1 - estimated_frames.window(period))
        rows = slice(first, visit.last + 1)
        seen = np.zeros((visit.last + 1 - first, 3))
        for i, axis in enumerate(AXES[:3]):
            if axis in stage.plan.axes:
                seen[:, i] = columns[f"force.{axis}.measured"][rows]
        R = self.pose(stage.plan.frame)[1][rows]
        return -np.asarray(np.einsum("kij,kj->ki", R, seen).mean(axis=0))


def _follower(frame: FrameModel, chart: SurfaceChart) -> ca.Function:
    """Centre of the tool (3,) -> axes (9,) and foot (3,) of a following frame; maps columns."""
    center = ca.SX.sym("center", 3)
    R = chart.frame(center, frame.heading)
    return ca.Function("follow", [center], [ca.vec(R), chart.foot(center)])
