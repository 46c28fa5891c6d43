"""A Rerun recording: every column as a scalar over simulated time, the arm in its world, panels."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from taskspec.missing import library
from taskspec_runner.export.scene import WORLD, RunScene, ScenePiece
from taskspec_runner.export.stream import LogStream
from taskspec_runner.record.history import history_of
from taskspec_runner.video.marks import WANTED

TIMELINE, _STAGE = "clock", "stage"
#: Of the arrows of forces and axes, and of the path's lines [m].
_FORCE_RADIUS, _AXIS_RADIUS, _PATH_RADIUS = 0.006, 0.003, 0.0015
_AXES = "xyz"


def write_rerun(log: LogStream, path: Path) -> None:
    """Writes a log as a recording; `force.z.ref` becomes the entity `signals/force/z/ref`.

    Raises:
        MissingLibraryError: the library rerun-sdk is not installed.
    """
    rr = library("rerun", "a Rerun recording")
    recording = rr.RecordingStream("taskspec", make_default=False, make_thread_default=False)
    recording.save(str(path), default_blueprint=_panels(rr, log))
    last = ""
    for name, unit in log.units.items():
        if unit:
            label = rr.SeriesLines(names=f"{name} [{unit}]")
            recording.log(_entity(name), label, static=True)
    if log.scene is not None:
        _add_scene(rr, recording, log.scene)
    for batch in log:
        rows = history_of(batch)
        time = rr.TimeColumn(TIMELINE, duration=rows.columns["clock"])
        for name, values in rows.columns.items():
            if name != "clock":
                scalars = rr.Scalars.columns(scalars=values)
                recording.send_columns(_entity(name), indexes=[time], columns=scalars)
        for visit in rows.visits():
            if visit.first or visit.stage != last:
                recording.set_time(TIMELINE, duration=float(rows.columns["clock"][visit.first]))
                recording.log(_STAGE, rr.TextLog(visit.stage))
            last = visit.stage
        poses = log.poses.add(rows) if log.poses else ()
        for name, found in zip(("tool", "task", "control_point"), poses, strict=bool(poses)):
            known = found.known
            at = rr.TimeColumn(TIMELINE, duration=rows.columns["clock"][known])
            places = rr.Transform3D.columns(
                translation=found.places[known], quaternion=found.turns[known]
            )
            recording.send_columns(f"{WORLD}/{name}", indexes=[at], columns=places)
    recording.disconnect()


def _add_scene(rr: Any, recording: Any, scene: RunScene) -> None:
    """Writes solids in their frames, how these move in the world, arrows, and the path."""
    recording.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    time = rr.TimeColumn(TIMELINE, duration=scene.clock)
    for frame in [*scene.fixed, *scene.moving]:
        entity, poses = rr.new_entity_path([WORLD, frame]), scene.placed(frame)
        if len(poses) == 1:
            place = rr.Transform3D(
                translation=poses[0, :3], quaternion=rr.Quaternion(xyzw=poses[0, 3:])
            )
            recording.log(entity, place, static=True)
        else:
            places = rr.Transform3D.columns(translation=poses[:, :3], quaternion=poses[:, 3:])
            recording.send_columns(entity, indexes=[time], columns=places)
    for number, piece in enumerate(scene.pieces):
        under = [WORLD] if piece.frame == WORLD else [WORLD, piece.frame]
        entity = rr.new_entity_path([*under, f"{piece.owner} {number}"])
        place = rr.Transform3D(
            translation=piece.pose[:3], quaternion=rr.Quaternion(xyzw=piece.pose[3:])
        )
        recording.log(entity, _solid(rr, piece), place, static=True)
    for name, track in scene.arrows.items():
        entity = f"{WORLD}/arrows/{name}"
        radius = _FORCE_RADIUS if name == "force" else _AXIS_RADIUS
        recording.log(entity, rr.Arrows3D.from_fields(radii=[radius]), static=True)
        # Where there is none, it has no length.
        vectors = np.where(track.shown[:, None], track.ends - track.starts, 0.0)
        arrows = rr.Arrows3D.columns(origins=track.starts, vectors=vectors, colors=track.colors)
        recording.send_columns(entity, indexes=[time], columns=arrows)
    path = rr.LineStrips3D(scene.path, colors=[WANTED], radii=[_PATH_RADIUS])
    recording.log(f"{WORLD}/path", path, static=True)


def _solid(rr: Any, piece: ScenePiece) -> Any:
    """A piece as Rerun has it."""
    look = {"colors": [piece.color], "fill_mode": "solid"}
    if piece.kind == "box":
        return rr.Boxes3D(half_sizes=[piece.size / 2], **look)
    if piece.kind == "sphere":
        return rr.Ellipsoids3D(half_sizes=[piece.size / 2], **look)
    if piece.kind == "cylinder":
        return rr.Cylinders3D(lengths=[piece.size[2]], radii=[piece.size[0] / 2], **look)
    assert piece.vertices is not None
    # Each triangle has corners of its own: edges are sharp.
    corners = piece.vertices[piece.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0),
        albedo_factor=piece.color,
    )


def _panels(rr: Any, log: LogStream) -> Any:
    """The blueprint: the scene, forces beside their references, errors, and the stages."""
    views = rr.blueprint
    groups = {
        "Force [N]": [f"force.{a}{s}" for a in _AXES for s in ("", ".ref")],
        "Torque [N m]": [f"torque.r{a}{s}" for a in _AXES for s in ("", ".ref")],
        "Position error [m]": [f"error.{a}" for a in _AXES],
    }
    plots = [
        views.TimeSeriesView(name=title, origin="signals", contents=contents)
        for title, names in groups.items()
        if (contents := _known(names, log))
    ]
    beside = views.Vertical(*plots, views.TextLogView(name="Stages", origin=_STAGE))
    scene = views.Spatial3DView(name="Scene", origin=WORLD)
    panels = views.Horizontal(scene, beside, column_shares=[3, 2]) if log.scene else beside
    return views.Blueprint(panels, collapse_panels=True)


def _known(names: Iterable[str], log: LogStream) -> list[str]:
    return [f"/{_entity(name)}" for name in names if name in log.units]


def _entity(column: str) -> str:
    return "signals/" + column.replace(".", "/")
