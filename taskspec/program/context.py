"""What all stages of one task share while they are compiled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.control import gains as gain_design
from taskspec.control.state import AXES
from taskspec.geometry.surface import Surface
from taskspec.program.equations import EquationModel
from taskspec.program.frames import FrameModel
from taskspec.program.stiffness import Compliance
from taskspec.robot import RobotModel
from taskspec.spec import Law, Limits, LoadedTask, Stage

_GEOMETRIC = np.eye(3)


@dataclass(frozen=True, slots=True)
class StartEquation:
    """An equation at the start pose.

    Attributes:
        distance: r / |r_x| [m, rad]. normal: (n,) unit normal on the joints' rates.
        scale: |r_x|.
    """

    distance: float
    normal: NDArray[np.float64]
    scale: float


@dataclass(frozen=True, slots=True)
class Context:
    """One task's robot, start, frames and surfaces.

    Attributes:
        loaded: the task and its places in the file.
        robot: both models of the arm with its tool.
        start: (n,) joint configuration of the first tick. posture: (n,) of a redundant arm.
        frames: every frame of the file. surfaces: every object's geometry.
        compliances: believed contact of each object.
        equations: every constraint equation. start_equations: where they are at `start`.
        start_jacobian: (6, n) of the tip at `start`, world axes; start_inertia: (n, n) H there.
        start_p, start_R: (3,), (3, 3) tip pose at `start`.
        start_gaps: distance [m] of the tool from each object there.
        start_normals: (3,) outward normal of each object at the tool, world.
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
    start_jacobian: NDArray[np.float64]
    start_inertia: NDArray[np.float64]
    start_p: NDArray[np.float64]
    start_R: NDArray[np.float64]
    start_gaps: Mapping[str, float]
    start_normals: Mapping[str, NDArray[np.float64]]
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
        """The object that a force in this frame is believed to act on.

        The surface that the frame follows, or the object that it is fixed on; in other frames the
        object nearest to the tool at the
        start pose.
        """
        if frame.surface_name or frame.owner:
            return frame.surface_name or frame.owner
        if not self.surfaces:
            return None
        return min(self.start_gaps, key=lambda name: self.start_gaps[name])

    def plants(
        self,
        axes: tuple[str, ...],
        rotation: NDArray[np.float64],
        k: float,
        rates: NDArray[np.float64] = _GEOMETRIC,
    ) -> dict[str, gain_design.Plant]:
        """Mass and stiffness of each axis at the start pose, for gain design.

        Args:
            axes: axes of the stage's frame. rotation: (3, 3) that frame at the start pose.
            k: contact stiffness [N/m] along a translation; a rotation feels it at the tool's
                radius.
            rates: (3, 3) from angular velocity in the frame to the rates of rotational rows.
        """
        J = _resolved(self.start_jacobian, rotation, rates)
        rows = [AXES.index(a) for a in axes]
        mobility = (J @ np.linalg.inv(self.start_inertia) @ J.T)[np.ix_(rows, rows)]
        held = np.diag(np.linalg.inv(mobility))
        tool = self.robot.tool
        reach = float(np.max(np.linalg.norm(tool.centers[:, :2], axis=1) + tool.radii))
        return {
            a: gain_design.Plant(
                h=1.0 / mobility[i, i],
                held=held[i],
                k=k * reach**2 if a.startswith("r") else k,
                period=self.period,
            )
            for i, a in enumerate(axes)
        }

    def joint_plants(
        self,
        axes: tuple[str, ...],
        rotation: NDArray[np.float64],
        stiffness: list[float],
        rates: NDArray[np.float64] = _GEOMETRIC,
    ) -> list[gain_design.Plant]:
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
            gain_design.Plant(h=free[j], held=held[j], k=about[j], period=self.period)
            for j in range(len(held))
        ]


def _resolved(
    J: NDArray[np.float64], rotation: NDArray[np.float64], rates: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(6, n) Jacobian J in the axes of a frame, its angular part as `rates` makes of it."""
    return np.vstack([rotation.T @ J[:3], rates @ rotation.T @ J[3:]])
