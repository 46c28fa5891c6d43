"""A stage's frame and the arm in it: at the start pose, and where the stage starts."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.program.axes import existing_axes
from taskspec.program.context import Context
from taskspec.program.prepare import frame_at_start
from taskspec.program.reference import orientation
from taskspec.program.world.frames import FrameModel
from taskspec.spec import Law

Vector = NDArray[np.float64]


class StageKinematics:
    """Axes, Jacobian and inertia of a stage at the start pose, and the pose at which it starts."""

    def __init__(
        self,
        context: Context,
        frame: FrameModel,
        law: Law,
        at: Callable[[], tuple[Vector, Vector]] | None,
    ) -> None:
        """Of a stage.

        Args:
            context: robot and start pose.
            frame: of the stage.
            law: of the stage, whose representation of the orientation rotational rows take.
            at: where the tip is as the stage starts, asked when that is first needed; None for
                the start pose.
        """
        self._context, self._frame, self._law, self._at = context, frame, law, at

    @cached_property
    def rotation(self) -> Vector:
        """(3, 3) the frame in the world at the start pose."""
        return frame_at_start(self._context, self._frame)

    @cached_property
    def lever(self) -> Vector:
        """(3,) from the tip to the control point at the start pose, world axes [m]."""
        frame, context = self._frame, self._context
        if not frame.at_origin:
            return np.zeros(3)
        if frame.kind == "tool":
            return np.asarray(context.start_R @ frame.origin)
        return np.asarray(context.placed(frame)[1] - context.start_p)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of the frame that the arm can move.

        Raises:
            SkewedAxisError: the frame is not aligned with the plane of a planar arm.
        """
        return existing_axes(self._context.robot.axes, self.rotation)

    @property
    def rows(self) -> list[int]:
        """Of the six of a twist, those of the axes."""
        return [a.row for a in self.axes]

    def along(self, axis: Axis, direction: Vector) -> float:
        """Component of a direction (3,), world axes, along an axis at the start pose."""
        return float(self.rotation[:, axis.column] @ direction)

    @cached_property
    def tool(self) -> tuple[Vector, Vector]:
        """(3,), (3, 3) where the tip is expected to be as the stage starts, world axes."""
        context = self._context
        return (context.start_p, context.start_R) if self._at is None else self._at()

    @cached_property
    def frame_at_tool(self) -> Vector:
        """(3, 3) the frame as the stage starts, if that turns with the tool; else at the start."""
        turned = self._frame.kind == "tool"
        return self.tool[1] @ self._frame.rotation if turned else self.rotation

    # Velocity and inertia at the start pose

    @cached_property
    def rates(self) -> Vector:
        """(3, 3) from angular velocity in the frame to the rates of the law's rotational rows."""
        return orientation.rates_of(self._law, self.rotation.T @ self._context.start_R)

    @property
    def jacobian(self) -> Vector:
        """(6, n) of the control point at the start pose, its rows those of the law."""
        J = self._context.start_jacobian.copy()
        J[:3] += np.cross(J[3:], self.lever, axis=0)
        return self._resolved(J)

    @property
    def tip_jacobian(self) -> Vector:
        """(m, n) of the tip at the start pose, on the axes."""
        return self._resolved(self._context.start_jacobian)[self.rows]

    def _resolved(self, J: Vector) -> Vector:
        return np.vstack([self.rotation.T @ J[:3], self.rates @ self.rotation.T @ J[3:]])

    @property
    def axis_mobility(self) -> Vector:
        """(m, m) J H^-1 J^T of the axes at the start pose [1/kg, 1/(kg m^2)]."""
        J = self.jacobian[self.rows]
        return np.asarray(J @ np.linalg.solve(self._context.start_inertia, J.T))

    @property
    def mobility(self) -> Vector:
        """(6, 6) the same, 0 on axes that the arm cannot move."""
        return self._on_six(self.axis_mobility)

    @property
    def task_inertia(self) -> Vector:
        """(6, 6) (J H^-1 J^T)^-1 of the axes, 0 on others [kg, kg m^2]."""
        return self._on_six(np.asarray(np.linalg.inv(self.axis_mobility), dtype=float))

    def _on_six(self, block: Vector) -> Vector:
        found = np.zeros((6, 6))
        found[np.ix_(self.rows, self.rows)] = block
        return found
