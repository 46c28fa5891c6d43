"""Marks in a scene beside the robot and its world: forces, frames, paths, equations."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import TRANSLATIONS, Axis
from taskspec.program.stages.stage import CompiledStage
from taskspec_runner.video.equations import equation_surfaces
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

Vector = NDArray[np.float64]
Color = tuple[float, float, float, float]

#: Force axes are red and motion axes blue, what nothing controls is grey; so is it in the report.
FORCE: Color = (0.86, 0.15, 0.15, 1.0)
MOTION: Color = (0.13, 0.38, 0.92, 1.0)
FREE: Color = (0.55, 0.58, 0.62, 1.0)
APPLIED: Color = (0.98, 0.66, 0.05, 1.0)
WANTED: Color = (0.45, 0.70, 0.98, 1.0)
TRACE: Color = (0.10, 0.13, 0.20, 1.0)
SURFACE: Color = (0.35, 0.62, 0.85, 0.22)
LINK: Color = (0.80, 0.82, 0.85, 1.0)

#: Of an arrow for the largest force of a run [m]; below this force [N] none is drawn.
_LONGEST_ARROW, _LEAST_FORCE = 0.16, 0.2
#: Length and half widths [m].
_TRIAD, _TRIAD_WIDTH, _ARROW_WIDTH = 0.085, 0.0035, 0.0075
_WANTED_WIDTH, _TRACE_WIDTH, LINK_RADIUS = 0.0022, 0.0026, 0.035
#: Most pieces of a path; nearer than this [m] two of its points are one; further, a jump.
_MOST_PIECES, _POINT_SPACING, _JUMP_DISTANCE = 150, 5e-4, 0.03
_EMISSION = 0.25


@dataclass(frozen=True, slots=True)
class Arm:
    """An arrow that a label can be put to.

    Attributes:
        kind: force, motion or free for an axis of the frame, applied for the force.
        name: of the axis.
        start, end: (3,) in the world [m].
    """

    kind: str
    name: str
    start: Vector
    end: Vector


COLORS = {"force": FORCE, "motion": MOTION, "free": FREE, "applied": APPLIED}


def kind_of(stage: CompiledStage, axis: Axis) -> str:
    """The control of a translation in a stage: force, motion or free."""
    plan = stage.plan.plans.get(axis)
    if plan is None:
        return "free"
    if plan.set_point:
        return "force"
    return "motion" if plan.motion else "free"


@dataclass(frozen=True, slots=True)
class DrawnPath:
    """A path as thin bars: the row that each ends at, its middle, axes and half length."""

    rows: NDArray[np.int64]
    middles: Vector
    axes: Vector
    halves: Vector


def arrow_scale(recording: Recording) -> float:
    """Length of the force arrow [m/N], 0 where a run has no force."""
    force = np.linalg.norm(recording.force, axis=1)
    # A short impact should not make everything after it small.
    largest = float(np.quantile(force, 0.995))
    return _LONGEST_ARROW / largest if largest > _LEAST_FORCE else 0.0


class Marks:
    """The marks of a run, for any of its rows.

    Attributes:
        scale: length of the force arrow [m/N], 0 where a run has no force.
        wanted: the path of the reference.
        surfaces: those of constraint equations.
    """

    def __init__(self, world: RecordedWorld, size: float = 1.0) -> None:
        """Prepares the marks of a world, `size` times as large."""
        self._world, self._size = world, size
        recording = self.recording = world.recording
        self.scale = size * arrow_scale(recording)
        jumps = [visit.first for visit in recording.visits]
        self.wanted = _bars(recording.wanted, jumps)
        self._traced = _bars(recording.point, jumps)
        equations = recording.program.context.equations.values()
        self.surfaces = equation_surfaces(equations, recording.tip)

    def arms(self, row: int) -> list[Arm]:
        """The arrows at a row: the frame's axes that are known, and the force."""
        recording = self.recording
        stage = recording.stage(recording.visit(row))
        at, axes = recording.point[row], recording.axes[row]
        arms = []
        for i, name in enumerate(TRANSLATIONS):
            if name in stage.plan.axes and np.isfinite(axes[:, i]).all():
                end = at + self._size * _TRIAD * axes[:, i]
                arms.append(Arm(kind_of(stage, name), name, at, end))
        force = recording.force[row]
        size = float(np.linalg.norm(force))
        if self.scale and size > _LEAST_FORCE:
            # What overshoots by far is drawn no longer than fits.
            length = min(self.scale * size, 1.5 * self._size * _LONGEST_ARROW)
            arms.append(Arm("applied", f"{size:.1f} N", at, at + length / size * force))
        return arms

    def draw_bodies(self, scene: mujoco.MjvScene) -> None:
        """Adds equations' surfaces, and links without meshes, to a scene that shows the world."""
        data = self._world.data
        for upper, lower in self._world.links:
            geom = _new(scene, LINK)
            if geom is not None:
                # It ends where the link does: a rounded end would reach over the tool.
                kind = mujoco.mjtGeom.mjGEOM_CYLINDER.value
                ends = data.xpos[upper], data.xpos[lower]
                mujoco.mjv_connector(geom, kind, LINK_RADIUS, *ends)
        for surface in self.surfaces:
            place = surface.size, surface.center, surface.rotation
            _new(scene, SURFACE, surface.kind, *place)

    def draw(self, scene: mujoco.MjvScene, row: int) -> None:
        """Adds paths, frame and force at a row."""
        self._path(scene, self.wanted, _WANTED_WIDTH, WANTED, len(self.recording))
        self._path(scene, self._traced, _TRACE_WIDTH, TRACE, row)
        for arm in self.arms(row):
            width = _ARROW_WIDTH if arm.kind == "applied" else _TRIAD_WIDTH
            geom = _new(scene, COLORS[arm.kind], emission=_EMISSION)
            if geom is not None:
                # MuJoCo draws an arrow half as long as its size says.
                end = arm.start + 2 * (arm.end - arm.start)
                kind = mujoco.mjtGeom.mjGEOM_ARROW.value
                mujoco.mjv_connector(geom, kind, self._size * width, arm.start, end)

    def _path(
        self, scene: mujoco.MjvScene, path: DrawnPath, width: float, color: Color, until: int
    ) -> None:
        """Adds the bars of a path up to a row."""
        size = np.full(3, self._size * width)
        for i in range(int(np.searchsorted(path.rows, until, side="right"))):
            size[2] = path.halves[i]
            box = mujoco.mjtGeom.mjGEOM_BOX
            _new(scene, color, box, size, path.middles[i], path.axes[i], _EMISSION)


def _bars(points: Vector, starts: Sequence[int]) -> DrawnPath:
    """A path (n, 3) as bars, none of them where it jumps as a visit starts."""
    steps = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    jumps = np.array([row for row in starts if steps[row] > _JUMP_DISTANCE], dtype=np.int64)
    steps[jumps] = 0.0
    distance = np.cumsum(steps)
    spacing = max(_POINT_SPACING, float(distance[-1]) / _MOST_PIECES)
    rows = np.flatnonzero(np.diff(np.floor(distance / spacing), prepend=-1.0) > 0)
    rows = np.union1d(rows, np.concatenate([jumps, np.maximum(jumps - 1, 0)]))
    kept = ~np.isin(rows[1:], jumps)
    a, b = points[rows[:-1]][kept], points[rows[1:]][kept]
    along = b - a
    length = np.linalg.norm(along, axis=1)
    z = along / np.maximum(length, 1e-12)[:, None]
    x = np.cross(np.eye(3)[np.argmin(np.abs(z), axis=1)], z)
    x /= np.maximum(np.linalg.norm(x, axis=1), 1e-12)[:, None]
    return DrawnPath(
        rows[1:][kept], (a + b) / 2, np.stack([x, np.cross(z, x), z], axis=2), 0.5 * length
    )


def _new(
    scene: mujoco.MjvScene,
    color: Color,
    kind: mujoco.mjtGeom = mujoco.mjtGeom.mjGEOM_SPHERE,
    size: Vector | None = None,
    center: Vector | None = None,
    axes: Vector | None = None,
    emission: float = 0.0,
) -> mujoco.MjvGeom | None:
    """A new geom of a scene, None where that is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        kind.value,
        np.zeros(3) if size is None else size,
        np.zeros(3) if center is None else center,
        (np.eye(3) if axes is None else axes).ravel(),
        np.array(color, dtype=np.float32),
    )
    geom.emission, geom.specular = emission, 0.1
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
    scene.ngeom += 1
    return geom
