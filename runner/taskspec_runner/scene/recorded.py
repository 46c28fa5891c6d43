"""The scene of a recorded run, with the rows that move it: from its log alone."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import TRANSLATIONS
from taskspec_runner.scene.meshes import text
from taskspec_runner.scene.model import Json, geom_data, model_scene, positions
from taskspec_runner.video.camera import frame_run
from taskspec_runner.video.equations import equation_surfaces
from taskspec_runner.video.marks import SURFACE, arrow_scale, kind_of
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

Vector = NDArray[np.float64]

#: Rows of a run [Hz]; of a long one as many as there is room for.
RATE, MOST_ROWS = 50.0, 4000


def recorded_scene(world: RecordedWorld) -> Json:
    """The scene of a run, as `taskspecScene.create` and `taskspecScene.track` take it.

    Returns:
        That of its model, with `scale` of the force arrow [m/N], the `visits` of stages (`start`
        [s] and `axes`: what controls each translation), and `track`: `clock` (n,) [s] and `values`
        (columns, n) as float32 in base 64, whose columns are a row of positions, the control
        point (3,), the quaternion of the stage's frame (4,), the applied force (3,) [N] and the
        reference of the control point (3,), all in the world; NaN where it is not known.
    """
    recording, model = world.recording, world.model
    tip = model.body(recording.program.context.robot.tip_body).id
    scene = model_scene(model, frame_run(world), tip, links=world.links)
    scene["geoms"] += _equations(recording)
    return {
        **scene,
        "scale": arrow_scale(recording),
        "visits": _visits(recording),
        "track": track(world),
    }


def _rows(recording: Recording) -> NDArray[np.int64]:
    """The rows of the log that move the scene."""
    clock = recording.clock
    count = min(round((clock[-1] - clock[0]) * RATE) + 1, MOST_ROWS)
    wanted = np.linspace(clock[0], clock[-1], max(count, 2))
    return np.unique(np.searchsorted(clock, wanted - recording.period / 2)).astype(np.int64)


def track(world: RecordedWorld) -> Json:
    """The rows of a run, as `recorded_scene` has them."""
    recording = world.recording
    rows = _rows(recording)
    values = np.column_stack(
        [
            [positions(world.show(int(row))) for row in rows],
            recording.point[rows],
            [_quaternion(axes) for axes in recording.axes[rows]],
            recording.force[rows],
            recording.wanted[rows],
        ]
    )
    return {
        "clock": text(recording.clock[rows].astype("<f4")),
        "values": text(values.T.astype("<f4")),
    }


def _quaternion(axes: Vector) -> Vector:
    """(4,) w, x, y, z of axes (3, 3); NaN where they are not known."""
    found = np.full(4, np.nan)
    if np.isfinite(axes).all():
        mujoco.mju_mat2Quat(found, axes.ravel())
    return found


def _visits(recording: Recording) -> list[Json]:
    found = []
    for visit in recording.visits:
        stage = recording.stage(visit)
        axes = {name: kind_of(stage, name) for name in TRANSLATIONS if name in stage.plan.axes}
        found.append({"start": float(recording.clock[visit.first]), "axes": axes})
    return found


def _equations(recording: Recording) -> list[Json]:
    """Surfaces of constraint equations."""
    found = []
    for each in equation_surfaces(recording.program.context.equations.values(), recording.tip):
        shape = each.kind.name.removeprefix("mjGEOM_").lower()
        place = each.center, _quaternion(each.rotation)
        found.append(geom_data(0, shape, each.size, *place, SURFACE))
    return found
