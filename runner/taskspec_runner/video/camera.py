"""The cameras of a run: all of it in the picture, the tool in sight."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.video.world import RecordedWorld

Vector = NDArray[np.float64]

#: Candidates, in degrees, and the one that is taken where all see alike.
_AZIMUTHS = range(0, 360, 15)
_ELEVATIONS = (-14.0, -24.0, -36.0)
_USUAL_AZIMUTH = 125.0
_FITTED_ROWS = 12
#: Nearer to the tip than this [m], what hides it is what it touches.
_TIP_RADIUS = 0.035
_VIEW_DISTANCE = 2.5
#: Share of a picture that what is shown fills.
_FILL = 0.92
#: Less than this [m] to either side is not shown.
_LEAST_HALF = 0.05
#: Links are about so thick [m].
_LINK_OFFSETS = 0.07 * np.vstack([np.eye(3), -np.eye(3)])
#: Of the close view: what it shows around the tool's path [m], how far away it may be [m], and over
#: how long its path is smoothed [s].
_CLOSE_MARGIN, _LARGEST_CLOSE_DISTANCE, _SMOOTHING_TIME = 0.07, 0.5, 1.0
#: At how many rows the visibility of the tool is checked, how far up the tool, and the share of
#: visible rows that is enough.
_CHECKED_ROWS, _TOOL_HEIGHT, _VISIBLE_SHARE = 5, 0.4, 0.85


@dataclass(frozen=True, slots=True)
class View:
    """A camera: azimuth and elevation [deg], distance [m] from its target (3,)."""

    azimuth: float
    elevation: float
    distance: float
    lookat: tuple[float, float, float]

    def camera(self) -> mujoco.MjvCamera:
        """The view as MuJoCo's camera."""
        camera = mujoco.MjvCamera()
        camera.azimuth, camera.elevation = self.azimuth, self.elevation
        camera.distance = self.distance
        camera.lookat[:] = self.lookat
        return camera


def axes_of(azimuth: float, elevation: float) -> Vector:
    """(3, 3) right, up and backward of a camera, in rows."""
    a, e = np.radians([azimuth, elevation])
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return np.array([right, np.cross(right, forward), -forward])


@dataclass(frozen=True, slots=True)
class Framing:
    """What a picture is to show, and from where.

    Attributes:
        azimuth, elevation: of the camera's direction [deg].
        middle: (3,) of what is shown, in the world [m].
        half: (3,) half of its extent to the right, upwards and along the view [m].
    """

    azimuth: float
    elevation: float
    middle: tuple[float, float, float]
    half: tuple[float, float, float]

    @classmethod
    def of(cls, points: Vector, angles: tuple[float, float]) -> Framing:
        """All points (k, 3) [m], under two angles [deg]."""
        axes = axes_of(*angles)
        projected = points @ axes.T
        low, high = projected.min(axis=0), projected.max(axis=0)
        x, y, z = ((low + high) / 2 @ axes).tolist()
        right, up, deep = ((high - low) / 2).tolist()
        return cls(*angles, (x, y, z), (right, up, deep))

    def view(self, model: mujoco.MjModel, aspect: float) -> View:
        """The nearest view that has it all in a picture of some width over height."""
        tangent = np.tan(np.radians(model.vis.global_.fovy) / 2)
        room = np.array([aspect, 1.0]) * tangent * _FILL
        half = np.maximum(self.half[:2], _LEAST_HALF)
        # Points in front of the middle are nearer to the eye, and need more room.
        distance = float((half / room).max()) + 0.6 * self.half[2]
        return View(self.azimuth, self.elevation, distance, self.middle)


def frame_run(world: RecordedWorld) -> Framing:
    """A whole run: the tool's path, the arm and its base, from where they are best visible."""
    rows, points, samples = _looked_at(world)
    best = max(
        ((a, e) for e in _ELEVATIONS for a in _AZIMUTHS),
        key=lambda angles: _score(world, rows, points, samples, angles),
    )
    return Framing.of(points, (float(best[0]), best[1]))


def frame_arm(model: mujoco.MjModel, data: mujoco.MjData, tip_body: int) -> Framing:
    """An arm as it stands: of a run of which nothing is known yet."""
    arm = arm_bodies(model, tip_body)
    points = np.vstack([data.xpos[arm] + offset for offset in _LINK_OFFSETS])
    return Framing.of(points, (_USUAL_AZIMUTH, _ELEVATIONS[1]))


def arm_bodies(model: mujoco.MjModel, tip_body: int) -> list[int]:
    """Bodies from the tip to the base."""
    arm = [tip_body]
    while model.body_parentid[arm[-1]] > 0:
        arm.append(int(model.body_parentid[arm[-1]]))
    return arm


def seen_from(view: View, azimuth: float, elevation: float, distance: float) -> View:
    """A view of the same point from elsewhere: two angles [deg] and a distance [m]."""
    return View(azimuth, elevation, distance, view.lookat)


@dataclass(frozen=True, slots=True)
class CloseView:
    """A camera near the tool, that goes along where its path is long.

    Attributes:
        view: of the first row.
        path: (n, 3) the point that it is aimed at in each row [m].
    """

    view: View
    path: Vector

    def at(self, row: int) -> View:
        """The camera at a row."""
        x, y, z = self.path[row].tolist()
        return replace(self.view, lookat=(x, y, z))


def close_view(world: RecordedWorld, view: View, aspect: float) -> CloseView:
    """A view of the control point, from the side of `view` if nothing hides the tool there.

    Else it is from where most of the tool is visible over the run. It stands still over a
    path that fits in, otherwise it follows the mean over `_SMOOTHING_TIME` seconds.
    """
    recording = world.recording
    point = recording.point
    room = np.vstack([point - _CLOSE_MARGIN, point + _CLOSE_MARGIN])
    fitted = _open_to(world, room, view, aspect)
    if fitted.distance <= _LARGEST_CLOSE_DISTANCE:
        return CloseView(fitted, np.broadcast_to(np.array(fitted.lookat), point.shape))
    width = 2 * (round(_SMOOTHING_TIME / recording.period) // 2) + 1
    padded = np.pad(point, ((width // 2, width // 2), (0, 0)), mode="edge")
    sums = np.cumsum(np.vstack([np.zeros((1, 3)), padded]), axis=0)
    return CloseView(
        replace(fitted, distance=_LARGEST_CLOSE_DISTANCE), (sums[width:] - sums[:-width]) / width
    )


def _open_to(world: RecordedWorld, room: Vector, view: View, aspect: float) -> View:
    """The view of some points (k, 3) from nearest to that of `view` that sees the tool."""
    recording, model = world.recording, world.model
    tip_body = model.body(recording.program.context.robot.tip_body).id
    rows = np.unique(np.linspace(0, len(recording) - 1, _CHECKED_ROWS).astype(int))

    def fitted(angles: tuple[float, float]) -> View:
        return Framing.of(room, angles).view(model, aspect)

    def visible_share(angles: tuple[float, float]) -> float:
        back = min(fitted(angles).distance, _LARGEST_CLOSE_DISTANCE) * axes_of(*angles)[2]
        sights = []
        for row in rows:
            data = world.show(int(row))
            tip, flange = data.xpos[tip_body], data.xpos[model.body_parentid[tip_body]]
            for point in (recording.point[row], tip + _TOOL_HEIGHT * (flange - tip)):
                eye = recording.point[row] + back
                # In both directions: from inside of a link's mesh its faces are not met.
                sights.append(
                    _unhidden(model, data, eye, point, tip_body)
                    and _unhidden(model, data, point, eye, tip_body, near=_TIP_RADIUS)
                )
        return float(np.mean(sights))

    usual = view.azimuth, view.elevation
    if visible_share(usual) > _VISIBLE_SHARE:
        return fitted(usual)

    def worth(angles: tuple[float, float]) -> float:
        turned = abs((angles[0] - usual[0] + 180.0) % 360.0 - 180.0) / 180.0
        return visible_share(angles) - 0.2 * turned - 0.2 * abs(angles[1] - usual[1]) / 90.0

    return fitted(max(((float(a), e) for e in _ELEVATIONS for a in _AZIMUTHS), key=worth))


def _looked_at(world: RecordedWorld) -> tuple[NDArray[np.int64], Vector, Vector]:
    """Rows that stand for a run, the points that should be in the picture, and bodies' places."""
    recording, model = world.recording, world.model
    rows = np.unique(np.linspace(0, len(recording) - 1, _FITTED_ROWS).astype(int))
    tip_body = model.body(recording.program.context.robot.tip_body).id
    arm = arm_bodies(model, tip_body)
    bodies, samples = [], []
    for row in rows:
        data = world.show(int(row))
        bodies += [data.xpos[arm] + offset for offset in _LINK_OFFSETS]
        samples.append(data.xpos[tip_body].copy())
    points = np.vstack([*bodies, recording.point[:: max(1, len(recording) // 200)]])
    return rows, points, np.array(samples)


def _score(
    world: RecordedWorld,
    rows: NDArray[np.int64],
    points: Vector,
    samples: Vector,
    angles: tuple[float, float],
) -> float:
    """Score of a view of a run: the tip in sight, forces and path across, the arm apart."""
    recording = world.recording
    axes = axes_of(*angles)
    eye = _VIEW_DISTANCE * axes[2]
    tool = world.model.body(recording.program.context.robot.tip_body).id
    visible = []
    for row, tip in zip(rows[::3], samples[::3], strict=True):
        data = world.show(int(row))
        visible.append(_unhidden(world.model, data, tip + eye, tip, tool))
    force = recording.force[rows].mean(axis=0)
    size = float(np.linalg.norm(force))
    across = 1.0 if size < 0.2 else float(np.hypot(*(axes[:2] @ force))) / size
    spread = np.ptp(samples @ axes[:2].T, axis=0)
    whole = float(np.linalg.norm(np.ptp(samples, axis=0))) + 1e-3
    reach = points[0] - points.mean(axis=0)
    apart = float(np.hypot(*(axes[:2] @ reach))) / (float(np.linalg.norm(reach)) + 1e-3)
    away = abs((angles[0] - _USUAL_AZIMUTH + 180.0) % 360.0 - 180.0) / 180.0
    usual = abs(angles[1] - _ELEVATIONS[1]) / 30.0
    return (
        3.0 * float(np.mean(visible))
        + across
        + 0.6 * float(np.linalg.norm(spread)) / whole
        + 0.8 * apart
        - 0.6 * away
        - 0.2 * usual
    )


def _unhidden(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    start: Vector,
    end: Vector,
    tool: int = -1,
    near: float = 0.0,
) -> bool:
    """Whether nothing is between two places.

    Args:
        model, data: of the world.
        start, end: (3,) where the ray begins, and the place that should be met [m].
        tool: the body that hides nothing.
        near: what is nearer to the start than this hides nothing either [m].
    """
    hit = np.zeros(1, dtype=np.int32)
    ray = end - start
    length = float(np.linalg.norm(ray))
    along = ray / length
    shown = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    at = mujoco.mj_ray(model, data, start + near * along, along, shown, 1, tool, hit, None)
    return bool(at < 0 or near + at > length - _TIP_RADIUS)
