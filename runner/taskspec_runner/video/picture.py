"""A frame without its panel: the arm on the left, what the tool does near by on the right."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Images
from PIL import ImageDraw

from taskspec_runner.video.camera import View, close_view, frame_run
from taskspec_runner.video.canvas import Canvas, Image
from taskspec_runner.video.labels import Labels, Rectangle
from taskspec_runner.video.lettering import Pen, dark, font
from taskspec_runner.video.marks import COLORS, Arm, Marks
from taskspec_runner.video.world import RecordedWorld

Vector = NDArray[np.float64]

#: Share of the width that shows the whole arm.
SPLIT = 0.62
#: How much of a hidden mark shines through what hides it.
_SHINE = 0.55
#: Marks in the close view are smaller than in the other by this.
_CLOSE_SIZE = 0.62
_GAP = 2


class Pictures:
    """Draws any row of a run.

    Attributes:
        view, close: the cameras of the two halves.
        marks: drawn in each of them.
        canvas: holds the scene that was drawn last, that of the right half.
    """

    def __init__(
        self,
        world: RecordedWorld,
        width: int,
        height: int,
        view: View | None = None,
        *,
        many: bool = False,
    ) -> None:
        """Prepares pictures of a size [px]; a `view` replaces that which is found.

        `many` of them are to be drawn quickly.

        Raises:
            NoCanvasError: there is nothing to draw with.
        """
        self._world = world
        self._sizes = (round(SPLIT * width) - _GAP, width - round(SPLIT * width))
        self._width, self._height = width, height
        self.view = view or frame_run(world).view(world.model, self._sizes[0] / height)
        self.close = close_view(world, self.view, self._sizes[1] / height)
        self.marks = Marks(world), Marks(world, _CLOSE_SIZE)
        self.canvas = Canvas(world.model, max(self._sizes), height, many=many)
        self._pen = Pen(height / 560)

    def close_canvas(self) -> None:
        """Gives the canvas back."""
        self.canvas.close()

    def draw(self, row: int) -> Image:
        """(height, width, 3) the run at a row."""
        picture = np.full((self._height, self._width, 3), 255, dtype=np.uint8)
        left, right = self._sizes
        data = self._world.show(row)
        picture[:, :left] = self._half(row, data, self.view.camera(), self.marks[0], left)
        near = self.close.at(row).camera()
        picture[:, -right:] = self._half(row, data, near, self.marks[1], right)
        return picture

    def _half(
        self, row: int, data: mujoco.MjData, camera: mujoco.MjvCamera, marks: Marks, width: int
    ) -> Image:
        canvas = self.canvas
        canvas.update(data, camera)
        marks.draw_bodies(canvas.scene)
        marks.draw(canvas.scene, row)
        solid = canvas.render(width, self._height)
        canvas.clear()
        marks.draw(canvas.scene, row)
        marked = canvas.render(width, self._height)
        picture = _shining(solid, marked)
        return self._labelled(picture, canvas.scene, marks.arms(row))

    def _labelled(self, picture: Image, scene: mujoco.MjvScene, arms: Sequence[Arm]) -> Image:
        drawn = Images.fromarray(picture)
        pen = ImageDraw.Draw(drawn)
        ends = [project(scene, np.array([arm.start, arm.end]), drawn.size) for arm in arms]
        labels = Labels(Rectangle(0.0, 0.0, *map(float, drawn.size)))
        # That of the force comes first: it has the least choice.
        for arm, (start, end) in sorted(
            zip(arms, ends, strict=True), key=lambda each: each[0].kind != "applied"
        ):
            if not np.isfinite([start, end]).all():
                continue
            big = arm.kind == "applied"
            size = self._pen(19 if big else 16)
            along = end - start
            # On the side of the arrow that has fewer of the frame's axes.
            axes = sum((e[1] - e[0] for e in ends[:-1]), np.zeros(2))
            across = np.array([-along[1], along[0]])
            across *= -1.0 if float(axes @ across) > 0 else 1.0
            place = (start + 2 * end) / 3 if big else end
            at = labels.place(place, arm.name, size, across if big else along)
            if at is None:
                continue
            pen.text(
                tuple(at.tolist()),
                arm.name,
                font=font(size),
                fill=dark(COLORS[arm.kind]),
                anchor="mm",
                stroke_width=max(1, self._pen(2.2)),
                stroke_fill="white",
            )
        return np.asarray(drawn)


def _shining(solid: Image, marked: Image) -> Image:
    """A picture through which hidden marks shine; `marked` has them alone, on black."""
    light = np.maximum(np.maximum(marked[..., 0], marked[..., 1]), marked[..., 2])
    at = np.nonzero(light)
    share = np.minimum(light[at].astype(np.float32) / 90.0, 1.0)[:, None] * _SHINE
    picture = solid.copy()
    picture[at] = (solid[at] * (1 - share) + marked[at] * share + 0.5).astype(np.uint8)
    return picture


def project(scene: mujoco.MjvScene, points: Vector, size: tuple[int, int]) -> Vector:
    """Pixels (k, 2) of points (k, 3) of the world; NaN behind the camera."""
    eyes = scene.camera[0], scene.camera[1]
    eye = np.mean([camera.pos for camera in eyes], axis=0)
    forward, up = np.array(eyes[0].forward), np.array(eyes[0].up)
    right = np.cross(forward, up)
    away = points - eye
    depth = away @ forward
    half = float(eyes[0].frustum_top) / float(eyes[0].frustum_near)
    scale = np.where(depth > 0, size[1] / 2 / (half * np.where(depth > 0, depth, 1.0)), np.nan)
    return np.column_stack(
        [size[0] / 2 + scale * (away @ right), size[1] / 2 - scale * (away @ up)]
    )
