"""The picture of a task: whole arm and near view side by side, and a row for each stage."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.plan import TaskPlan
from taskspec.program.world.holding import truly_holding
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.plant.shapes import visible_name
from taskspec_runner.preview.rays import RayCamera, RayPicture
from taskspec_runner.preview.sheets import DrawingSheet, PixelSheet, SvgSheet
from taskspec_runner.preview.stages import PicturedStage, pictured, triad
from taskspec_runner.video.camera import Framing, View, arm_bodies, axes_of
from taskspec_runner.video.equations import equation_surfaces
from taskspec_runner.video.labels import Labels, Rectangle, width_of
from taskspec_runner.video.lettering import Color, rgb
from taskspec_runner.video.marks import COLORS, MOTION, TRACE
from taskspec_runner.video.world import DrawnWorld

Vector = NDArray[np.float64]

#: Lengths are in units of the picture, which is as wide as a page's column at most.
WIDTH = 640.0
_SCENE, _SPLIT, _GAP = 400.0, 0.54, 4.0
#: Heights: of the title, of a line of text, around a row, and of the legend.
_TITLE, _LINE, _ROOM, _LEGEND = 44.0, 24.0, 12.0, 40.0
_NAME, _WORD, _SMALL = 21.0, 18.0, 17.0
#: Columns of a row: number, small frame, words.
_NUMBER, _FRAME, _WORDS = 24.0, 56.0, 124.0
_ARROW, _TINY = 62.0, 26.0
#: Places of frames nearer than this are one [units].
_ONE_PLACE = 26.0
_PAPER: Color = (240, 243, 246)
_INK, _SOFT, _LINES, _CARD = (22, 27, 34), (82, 93, 108), (214, 220, 227), (255, 255, 255)
_AZIMUTHS, _ELEVATIONS, _USUAL = range(0, 360, 15), (-16.0, -26.0, -38.0), 125.0
#: Around what the near view has to show, and the least that it shows [m].
_NEAR_MARGIN = 0.05
#: A link is about so thick [m]; nearer than this to a point, what hides it is what it touches.
_LINK, _TOUCH = 0.07, 0.02
#: Points of a path that views go by; an object with a larger half length [m] may be cut.
_MOST_PATH, _LARGE = 200, 0.3


class TaskPicture:
    """The picture of a planned task; no OpenGL is needed."""

    def __init__(self, task: TaskPlan) -> None:
        """Prepares the picture of a plan.

        Args:
            task: of an examination without errors.
        """
        context = task.context
        loaded = context.loaded.task
        self._name, self._context, self._task = loaded.name, context, loaded
        self._stages = pictured(task)
        world = DrawnWorld(context, loaded)
        world.place_arm(truly_holding(context, loaded))
        self._model, self._data = world.model, world.data
        self._tip = world.model.body(context.robot.tip_body).id
        self._arm = arm_bodies(world.model, self._tip)
        world.settle(self._path)
        mujoco.mj_kinematics(world.model, world.data)

    def svg(self, *, rows: bool = True, fineness: float = 1.5) -> bytes:
        """The picture as an SVG file, readable from 390 px on and on any background.

        Args:
            rows: whether the stages follow below the scene, with a title above it.
            fineness: pixels of the scene for a unit, of which the picture is 640 wide.
        """
        return self._drawn(SvgSheet(WIDTH, self._height(rows), self._name, fineness), rows)

    def png(self, *, rows: bool = True, fineness: float = 2.0) -> bytes:
        """The picture as a PNG file; see `svg`."""
        return self._drawn(PixelSheet(WIDTH, self._height(rows), fineness), rows)

    # The whole

    def _height(self, rows: bool) -> float:
        if not rows:
            return _SCENE
        return _TITLE + _SCENE + sum(map(_row_height, self._stages)) + _LEGEND

    def _drawn(self, sheet: DrawingSheet, rows: bool) -> bytes:
        top = 0.0
        _fill(sheet, Rectangle(0, 0, WIDTH, self._height(rows)), _CARD)
        if rows:
            sheet.text(
                (14, _TITLE / 2), _cut(self._name, _NAME, WIDTH - 28), _NAME, _INK, bold=True
            )
            top = _TITLE
        left = round(_SPLIT * WIDTH)
        for near, panel in (
            (False, Rectangle(0, top, left - _GAP / 2, top + _SCENE)),
            (True, Rectangle(left + _GAP / 2, top, WIDTH, top + _SCENE)),
        ):
            _Panel(self, sheet, panel, near=near).draw()
        if rows:
            top += _SCENE
            for number, stage in enumerate(self._stages, 1):
                top = self._row(sheet, number, stage, top)
            _legend(sheet, top + _LEGEND / 2)
        return sheet.finish()

    def _row(self, sheet: DrawingSheet, number: int, stage: PicturedStage, top: float) -> float:
        height = _row_height(stage)
        if number > 1:
            sheet.line(np.array([[14, top], [WIDTH - 14, top]]), _LINES, 1)
        first = top + _ROOM + _LINE / 2
        _badge(sheet, np.array([_NUMBER, first]), str(number))
        sheet.text((_FRAME - 12, first), _cut(stage.name, _NAME, 340), _NAME, _INK, bold=True)
        at = _FRAME + width_of(stage.name, _NAME) + 14
        frame = _cut(f"in frame {stage.frame}", _SMALL, WIDTH - 14 - at)
        sheet.text((WIDTH - 14, first), frame, _SMALL, _SOFT, anchor="r")
        middle = np.array([_FRAME, first + (height - 2 * _ROOM) / 2 + 0.3 * _LINE])
        axes = axes_of(*self._angles)
        for axis, kind, direction in _front_last(stage, axes):
            flat = np.array([axes[0] @ direction, -axes[1] @ direction])
            _arrow(sheet, middle, middle + _TINY * flat, rgb(COLORS[kind]), 3.0)
            if np.linalg.norm(flat) > 0.3:
                sheet.text(
                    middle + (_TINY + 11) * flat, axis, 15, _ink(kind), anchor="m", halo=_CARD
                )
        for i, (kind, text) in enumerate(stage.words, 1):
            y = first + i * _LINE
            sheet.disc(np.array([_WORDS, y]), 5, rgb(COLORS[kind]))
            shown = _cut(text, _WORD, WIDTH - _WORDS - 28)
            sheet.text((_WORDS + 14, y), shown, _WORD, _ink(kind))
        return top + height

    # What is shown, and from where

    @cached_property
    def _path(self) -> Vector:
        """(n, 3) the expected path of the tool over all stages [m]."""
        return np.vstack([self._context.start_p, *(stage.path for stage in self._stages)])

    @cached_property
    def _angles(self) -> tuple[float, float]:
        """Azimuth and elevation [deg] from which tool, frames and path are most visible."""
        choices = [(float(a), e) for e in _ELEVATIONS for a in _AZIMUTHS]
        return max(choices, key=self._worth)

    def _worth(self, angles: tuple[float, float]) -> float:
        axes = axes_of(*angles)
        targets = np.array([self._context.start_p, *(stage.point for stage in self._stages)])
        open_ = [self._open(point, axes[2]) for point in np.unique(targets.round(3), axis=0)]
        directions = [d for stage in self._stages for _, _, d in triad(stage)]
        across = np.mean([np.hypot(*(axes[:2] @ d)) for d in directions] or [1.0])
        least = min([float(np.hypot(*(axes[:2] @ d))) for d in directions] or [1.0])
        spread = np.linalg.norm(np.ptp(self._path @ axes[:2].T, axis=0))
        whole = np.linalg.norm(np.ptp(self._path, axis=0)) + 1e-3
        reach = axes[:2] @ (self._context.start_p - self._data.xpos[self._arm[-1]])
        away = abs((angles[0] - _USUAL + 180.0) % 360.0 - 180.0) / 180.0
        return float(
            3.0 * np.mean(open_)
            + across
            + min(least, 0.4)
            + 0.6 * spread / whole
            + 0.6 * abs(reach[0])
            - 0.6 * away
            - 0.1 * abs(angles[1] - _ELEVATIONS[1]) / 10
        )

    def _open(self, point: Vector, backward: Vector) -> bool:
        """Whether nothing but the tool lies between a point and an eye."""
        hit, shown = np.zeros(1, dtype=np.int32), np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        start = point + _TOUCH * backward
        at = mujoco.mj_ray(
            self._model, self._data, start, backward, shown, True, self._tip, hit, None
        )
        return bool(at < 0)

    def view(self, aspect: float, *, near: bool) -> View:
        """The view of the whole arm, or that of what the tool is to do."""
        points = [self._path[:: max(1, len(self._path) // _MOST_PATH)]]
        offsets = np.vstack([np.eye(3), -np.eye(3)])
        if near:
            points = [points[0] + _NEAR_MARGIN * each for each in offsets]
        else:
            points += [self._data.xpos[self._arm] + _LINK * each for each in offsets]
            points += list(self._small_objects())
        return Framing.of(np.vstack(points), self._angles).view(self._model, aspect)

    def objects(self) -> Iterator[tuple[str, int]]:
        """Names of the objects, and the geom that is drawn of each."""
        for name in [*self._task.shapes, *self._task.mechanisms]:
            names = (visible_name(name), PREFIX + name, f"{PREFIX}{name}/rail")
            geom = _geom(self._model, names)
            if geom is not None:
                yield name, geom

    def _small_objects(self) -> Iterator[Vector]:
        """(8, 3) corners of the boxes about objects that fit into the picture."""
        corners = np.array(list(product((-1, 1), repeat=3)))
        for _, geom in self.objects():
            box = self._model.geom_aabb[geom]
            if self._model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE or box[3:].max() > _LARGE:
                continue
            R = self._data.geom_xmat[geom].reshape(3, 3)
            yield self._data.geom_xpos[geom] + (box[:3] + corners * box[3:]) @ R.T


class _Panel:
    """One view of a task, with its marks."""

    def __init__(
        self, of: TaskPicture, sheet: DrawingSheet, panel: Rectangle, *, near: bool
    ) -> None:
        self._of, self._sheet, self._near, self._panel = of, sheet, near, panel
        width, height = panel.right - panel.left, panel.bottom - panel.top
        view = of.view(width / height, near=near)
        tangent = float(np.tan(np.radians(of._model.vis.global_.fovy) / 2))
        self._camera = RayCamera(view, round(width), round(height), tangent)
        fine = round(width * sheet.fineness), round(height * sheet.fineness)
        self._fine = RayCamera(view, *fine, tangent)
        inner = Rectangle(panel.left + 4, panel.top + 4, panel.right - 4, panel.bottom - 4)
        self._labels = Labels(inner)

    def draw(self) -> None:
        panel, of = self._panel, self._of
        pixels = RayPicture(of._model, of._data, np.array(_PAPER) / 255).draw(self._fine)
        size = panel.right - panel.left, panel.bottom - panel.top
        self._sheet.image(panel.left, panel.top, *size, pixels)
        self._equations()
        for stage in of._stages:
            path = self._places(stage.path)
            if len(path) > 1 and np.ptp(path, axis=0).max() > 2:
                self._sheet.line(_thinned(path), rgb(TRACE), 2.2 if self._near else 1.8)
        self._frames()
        self._names()

    def _places(self, points: Vector) -> Vector:
        """(k, 2) units of the picture of points (k, 3), none of them outside of the panel."""
        panel = self._panel
        found = self._camera.project(points) + np.array([panel.left, panel.top])
        return np.asarray(np.clip(found, [panel.left, panel.top], [panel.right, panel.bottom]))

    def _frames(self) -> None:
        """The frames of the stages; those at one place are one, coloured as where a force acts."""
        for place, numbers in self._grouped():
            stages = [self._of._stages[i] for i in numbers]
            shown = max(stages, key=lambda s: sum(kind == "force" for kind in s.kinds.values()))
            length = _ARROW if self._near else 0.5 * _ARROW
            size = self._camera.pixel_size(shown.point)
            ends, axes = [], axes_of(*self._of._angles)
            for axis, kind, direction in _front_last(shown, axes):
                (end,) = self._places((shown.point + size * length * direction)[None])
                _arrow(self._sheet, place, end, rgb(COLORS[kind]), 5.0 if self._near else 3.0)
                for share in (0.2, 0.6, 1.0):
                    self._labels.keep(Rectangle.about(place + share * (end - place), 9, 9))
                ends.append((axis, kind, end))
            if not self._near:
                continue
            for axis, kind, end in ends:
                way = end - place
                if np.linalg.norm(way) > 8:
                    self._write(end, axis, 20, _ink(kind), way)
            for i in numbers:
                at = self._labels.place(place, "00", 18, np.array([-0.6, 0.8]))
                if at is not None:
                    _badge(self._sheet, at, str(i + 1))

    def _grouped(self) -> Iterator[tuple[Vector, list[int]]]:
        """Places (2,) of frames with the stages that begin there."""
        found: list[tuple[Vector, list[int]]] = []
        for i, stage in enumerate(self._of._stages):
            (place,) = self._places(stage.point[None])
            near = [g for g in found if np.linalg.norm(g[0] - place) < _ONE_PLACE]
            if near:
                near[0][1].append(i)
            else:
                found.append((place, [i]))
        yield from found

    def _names(self) -> None:
        """Names of the objects, in the view of the whole."""
        of = self._of
        if self._near:
            return
        for name, geom in of.objects():
            (place,) = self._places(of._data.geom_xpos[geom][None])
            self._write(place, name, _SMALL, _INK, np.array([0.3, 1.0]))

    def _equations(self) -> None:
        """The surfaces of constraint equations, in outline."""
        of = self._of
        for surface in equation_surfaces(of._context.equations.values(), of._path):
            turns = np.linspace(0, 2 * np.pi, 25)[:-1]
            if surface.kind == mujoco.mjtGeom.mjGEOM_BOX:
                local = np.array(list(product((-1, 1), repeat=3))) * surface.size
            elif surface.kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
                ring = np.column_stack([np.cos(turns), np.sin(turns)]) * surface.size[0]
                ends = [np.column_stack([ring, np.full(24, s * surface.size[2])]) for s in (-1, 1)]
                local = np.vstack(ends)
            else:
                polar = np.linspace(0, np.pi, 13)
                local = surface.size[0] * np.array(
                    [[np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)]
                     for p in polar for t in turns]
                )  # fmt: skip
            places = self._places(surface.center + local @ surface.rotation.T)
            outline = _hull(places)
            if len(outline) > 2:
                self._sheet.polygon(outline, rgb(MOTION), 0.14)

    def _write(self, at: Vector, text: str, size: float, color: Color, way: Vector) -> None:
        middle = self._labels.place(at, text, size, way)
        if middle is not None:
            self._sheet.text(middle, text, size, color, anchor="m", bold=True, halo=_CARD)


def _geom(model: mujoco.MjModel, names: Sequence[str]) -> int | None:
    """The first of some geoms that there is."""
    found = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in names)
    return next((geom for geom in found if geom >= 0), None)


def _front_last(stage: PicturedStage, axes: Vector) -> list[tuple[str, str, Vector]]:
    """A stage's axes, those that point to the eye last."""
    return sorted(((str(a), k, d) for a, k, d in triad(stage)), key=lambda each: axes[2] @ each[2])


def _row_height(stage: PicturedStage) -> float:
    return 2 * _ROOM + _LINE * (1 + max(3, len(stage.words)))


def _legend(sheet: DrawingSheet, y: float) -> None:
    x = 24.0
    kinds = (("force controlled", "force"), ("motion controlled", "motion"), ("free", "free"))
    for text, kind in kinds:
        sheet.disc(np.array([x, y]), 6, rgb(COLORS[kind]))
        sheet.text((x + 12, y), text, _SMALL, _INK)
        x += 40 + width_of(text, _SMALL)
    sheet.line(np.array([[x - 4, y], [x + 22, y]]), rgb(TRACE), 2.5)
    sheet.text((x + 30, y), "path", _SMALL, _INK)


def _badge(sheet: DrawingSheet, at: Vector, number: str) -> None:
    sheet.disc(at, 11, _INK)
    sheet.text(at, number, 15, _CARD, anchor="m", bold=True)


def _arrow(sheet: DrawingSheet, start: Vector, end: Vector, color: Color, width: float) -> None:
    """An arrow with its head within its length, on a light edge."""
    way = end - start
    length = float(np.linalg.norm(way))
    head = min(2.6 * width, 0.6 * length)
    unit = way / max(length, 1e-9)
    across = np.array([-unit[1], unit[0]]) * 1.25 * width
    foot = end - head * unit
    sheet.line(np.array([start, foot]), _CARD, width + 2)
    sheet.line(np.array([start, foot]), color, width)
    sheet.polygon(np.array([end, foot + across, foot - across]), color)


def _fill(sheet: DrawingSheet, box: Rectangle, color: Color) -> None:
    corners = [[box.left, box.top], [box.right, box.top]]
    corners += [[box.right, box.bottom], [box.left, box.bottom]]
    sheet.polygon(np.array(corners), color)


def _ink(kind: str) -> Color:
    """A colour of a kind that can be read as text on white: at a contrast of 4.5 and more."""
    red, green, blue = rgb(COLORS[kind])
    return round(0.7 * red), round(0.7 * green), round(0.7 * blue)


def _cut(text: str, size: float, room: float) -> str:
    """A text that fits, cut where it does not."""
    most = max(1, int(room / width_of("x", size)))
    return text if len(text) <= most else f"{text[: most - 1].rstrip()}…"


def _thinned(places: Vector) -> Vector:
    """A path (n, 2) without points that lie nearer than a unit to the one before."""
    kept = [places[0]]
    for place in places[1:]:
        if np.abs(place - kept[-1]).max() >= 1:
            kept.append(place)
    return np.array([*kept, places[-1]])


def _hull(points: Vector) -> Vector:
    """(m, 2) the convex hull of points (n, 2), in order."""
    ordered = sorted(map(tuple, points.tolist()))

    def half(each: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
        found: list[tuple[float, ...]] = []
        for x, y in each:
            while len(found) > 1 and (
                (found[-1][0] - found[-2][0]) * (y - found[-2][1])
                <= (found[-1][1] - found[-2][1]) * (x - found[-2][0])
            ):
                found.pop()
            found.append((x, y))
        return found[:-1]

    return np.array([*half(ordered), *half(ordered[::-1])])
