"""What all stages of one task share while they are compiled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import AxisPlant
from taskspec.program.axes import MOSTLY
from taskspec.program.contacts import Obstacles
from taskspec.program.world.equations import EquationModel, StartEquation
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.program.world.stiffness import GRIP, Compliance
from taskspec.robot import RobotModel
from taskspec.shapes import Surface
from taskspec.spec import Law, Limits, LoadedTask, Stage

#: From here on J H^-1 J^T counts as singular.
_CONDITION = 1e12
_GEOMETRIC = np.eye(3)


@dataclass(frozen=True, slots=True)
class Context:
    """One task's robot, start, frames and surfaces.

    Attributes:
        loaded: the task and its places in the file.
        robot: both models of the arm with its tool.
        start: (n,) joint configuration of the first tick. posture: (n,) of a redundant arm.
        frames: every frame of the file. surfaces: every object's geometry.
        compliances: nominal contact of each object.
        mechanisms: nominal geometry of each. moving_bases: of the objects that move by themselves.
        equations: every constraint equation. start_equations: where they are at `start`.
        start_jacobian: (6, n) of the tip at `start`, world axes; start_inertia: (n, n) H there;
            start_gravity: (n,) g there.
        start_p, start_R: (3,), (3, 3) tip pose at `start`.
        start_gaps: distance [m] of the tool from each object there.
        start_normals: (3,) outward normal of each object at the tool, world.
        obstacles: the objects that the tool may touch.
        period: control period [s].
    """

    loaded: LoadedTask
    robot: RobotModel
    start: NDArray[np.float64]
    posture: NDArray[np.float64]
    frames: Mapping[str, FrameModel]
    surfaces: Mapping[str, Surface]
    compliances: Mapping[str, Compliance]
    equations: Mapping[str, EquationModel]
    start_equations: Mapping[str, StartEquation]
    mechanisms: Mapping[str, MechanismModel]
    moving_bases: Mapping[str, MovingBase]
    start_jacobian: NDArray[np.float64]
    start_inertia: NDArray[np.float64]
    start_gravity: NDArray[np.float64]
    start_p: NDArray[np.float64]
    start_R: NDArray[np.float64]
    start_gaps: Mapping[str, float]
    start_normals: Mapping[str, NDArray[np.float64]]
    obstacles: Obstacles
    period: float

    def frame_of(self, stage: Stage) -> FrameModel:
        """The stage's task frame."""
        return self.frames[stage.frame or self.loaded.task.frame]

    def law_of(self, stage: Stage) -> Law:
        """The stage's law: its own replaces the file's."""
        return stage.law or self.loaded.task.law

    def limits_of(self, stage: Stage) -> Limits:
        """The file's limits, with those of the stage put over them key by key."""
        common = self.loaded.task.limits
        if stage.limits is None:
            return common
        own = {k: v for k, v in stage.limits.model_dump().items() if v is not None}
        return common.model_copy(update=own)

    def contact_of(self, frame: FrameModel) -> str | None:
        """The object that a force in this frame nominally acts on.

        The surface that the frame follows, or the object that it is fixed on; in other frames the
        object nearest to the tool at the start pose. None where the grip returns the force, or
        nothing does.
        """
        owner = frame.surface_name or frame.owner
        if owner in self.surfaces and owner != self.loaded.task.robot.grasp:
            return owner
        if self.gripped(frame):
            return None
        return self._nearest()

    def _nearest(self) -> str | None:
        """The object nearest to the tool at the start, what it holds left out."""
        gaps = self.touchable_gaps
        return min(gaps, key=lambda name: gaps[name]) if gaps else None

    @property
    def touchable_gaps(self) -> dict[str, float]:
        """Distance [m] at the start from each object but a loose body that the tool holds."""
        held = self.loaded.task.robot.grasp
        return {name: gap for name, gap in self.start_gaps.items() if name != held}

    @property
    def held(self) -> str:
        """The mechanism whose handle the robot holds; empty for none."""
        name = (self.loaded.task.robot.grasp or "").removesuffix(".handle")
        return name if name in self.mechanisms else ""

    def tracked(self, frame: FrameModel) -> MechanismModel | None:
        """The mechanism whose coordinate a stage in this frame keeps."""
        return frame.mechanism or self.mechanisms.get(self.held)

    def base_of(self, frame: FrameModel) -> MovingBase | None:
        """How the object moves that carries a frame; None where none does."""
        return self.moving_bases.get(frame.base_name)

    def gripped(self, frame: FrameModel) -> bool:
        """Whether a force in this frame is returned by what the robot holds, and both ways.

        A handle returns it in every frame but those of an object; a loose body where the world
        has no other object.
        """
        if self.loaded.task.robot.grasp is None:
            return False
        owner = frame.surface_name or frame.owner
        if owner in self.surfaces and owner != self.loaded.task.robot.grasp:
            return False
        return bool(self.held) or self._nearest() is None

    def stiffness_of(self, frame: FrameModel) -> float:
        """Nominal stiffness [N/m] of what a force in this frame acts on, 0 without any."""
        contact = self.contact_of(frame)
        if contact is not None:
            return self.compliances[contact].stiffness
        return GRIP.stiffness if self.gripped(frame) else 0.0

    def felt_stiffness(
        self, frame: FrameModel, axes: tuple[Axis, ...], rotation: NDArray[np.float64]
    ) -> float | dict[Axis, float]:
        """Nominal stiffness of the environment, for `plants`: of a grip, axis by axis.

        Along the way that the mechanism leaves open there is none [N/m, N m/rad].

        Args:
            frame: of the stage. axes: that exist in it. rotation: (3, 3) it at the start pose.
        """
        if not self.gripped(frame):
            return self.stiffness_of(frame)
        open_ways = np.zeros((2, 3))
        if self.held:
            point = frame.origin if frame.at_origin else self.start_p
            open_ways = np.array(self.mechanisms[self.held].open_ways(point))
        found: dict[Axis, float] = {}
        lever = self.lever_of(frame)
        for a in axes:
            turns = a.is_rotation
            axis = rotation[:, AXES.index(a) % 3]
            free = abs(float(axis @ open_ways[int(turns)])) > MOSTLY
            k = GRIP.stiffness
            if turns:
                k = GRIP.angular_stiffness + k * float(np.sum(np.cross(axis, lever) ** 2))
            found[a] = 0.0 if free else k
        return found

    def lever_of(self, frame: FrameModel) -> NDArray[np.float64]:
        """(3,) from the tip to the control point of a frame at the start, world axes [m]."""
        if not frame.at_origin:
            return np.zeros(3)
        if frame.kind == "tool":
            return np.asarray(self.start_R @ frame.origin)
        return np.asarray(self.placed(frame)[1] - self.start_p)

    def placed(self, frame: FrameModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(3, 3), (3,) pose of a fixed frame in the world as the run begins."""
        moving_base = self.base_of(frame)
        if moving_base is None:
            return frame.rotation, frame.origin
        A, a = moving_base.pose(0.0)
        return A @ frame.rotation, A @ frame.origin + a

    def plants(
        self,
        axes: tuple[Axis, ...],
        rotation: NDArray[np.float64],
        k: float | Mapping[Axis, float],
        rates: NDArray[np.float64] = _GEOMETRIC,
        lever: NDArray[np.float64] | None = None,
    ) -> dict[Axis, AxisPlant]:
        """Mass and stiffness of each axis at the start pose, for gain design.

        Args:
            axes: axes of the stage's frame. rotation: (3, 3) that frame at the start pose.
            k: contact stiffness [N/m] along a translation; a rotation feels it at the tool's
                radius. Or of every axis [N/m, N m/rad].
            rates: (3, 3) from angular velocity in the frame to the rates of rotational rows.
            lever: (3,) from the tip to the control point, world axes; None for none.
        """
        J = self.start_jacobian.copy()
        if lever is not None:
            J[:3] += np.cross(J[3:], lever, axis=0)
        J = _resolved(J, rotation, rates)
        rows = [AXES.index(a) for a in axes]
        mobility = (J @ np.linalg.inv(self.start_inertia) @ J.T)[np.ix_(rows, rows)]
        if np.linalg.cond(mobility) > _CONDITION:
            # The run stops before its first tick; that it is said needs gains that are finite.
            mobility = mobility + np.eye(len(rows)) / _CONDITION
        held = np.diag(np.linalg.inv(mobility))
        reach = self.robot.tool.reach
        if not isinstance(k, Mapping):
            k = {a: k * reach**2 if a.is_rotation else k for a in axes}
        return {
            a: AxisPlant(h=1.0 / mobility[i, i], held=held[i], k=k[a], period=self.period)
            for i, a in enumerate(axes)
        }

    def joint_plants(
        self,
        axes: tuple[Axis, ...],
        rotation: NDArray[np.float64],
        stiffness: list[float],
        rates: NDArray[np.float64] = _GEOMETRIC,
    ) -> list[AxisPlant]:
        """Inertia and stiffness about each joint at the start pose, for gain design.

        Args:
            axes: axes of the stage's frame. rotation: (3, 3) that frame at the start pose.
            stiffness: of spring and contact together, on those axes [N/m, N m/rad].
            rates: as for `plants`.
        """
        rows = [AXES.index(a) for a in axes]
        J = _resolved(self.start_jacobian, rotation, rates)[rows]
        about = np.einsum("ij,i,ij->j", J, stiffness, J)
        free = 1.0 / np.diag(np.linalg.inv(self.start_inertia))
        held = np.diag(self.start_inertia)
        return [
            AxisPlant(h=free[j], held=held[j], k=about[j], period=self.period)
            for j in range(len(held))
        ]


def _resolved(
    J: NDArray[np.float64], rotation: NDArray[np.float64], rates: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(6, n) Jacobian J in the axes of a frame, its angular part as `rates` makes of it."""
    return np.vstack([rotation.T @ J[:3], rates @ rotation.T @ J[3:]])
