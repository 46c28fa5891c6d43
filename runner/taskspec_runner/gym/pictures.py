"""Pictures of an episode: the arm in its world as it is now."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.worlds import World
from taskspec_runner.gym.episode import Episode
from taskspec_runner.video.camera import View, frame_arm
from taskspec_runner.video.canvas import Canvas
from taskspec_runner.video.world import DrawnWorld


class EpisodePictures:
    """Draws episodes, each in its own world, all from where the first one is best visible."""

    def __init__(self, size: tuple[int, int]) -> None:
        """Prepares pictures of a size: width and height [px]."""
        self._width, self._height = size
        self._world: World | None = None
        self._drawn: DrawnWorld | None = None
        self._canvas: Canvas | None = None
        self._view: View | None = None

    def draw(self, episode: Episode) -> NDArray[np.uint8]:
        """(height, width, 3) an episode as it is now.

        Raises:
            NoCanvasError: there is nothing to draw with.
        """
        if self._drawn is None or self._world is not episode.world:
            self.close()
            context = episode.program.context
            self._world, self._drawn = episode.world, DrawnWorld(context, episode.world.task)
        drawn = self._drawn
        data = drawn.put(*episode.state())
        tip = drawn.model.body(episode.program.context.robot.tip_body).id
        if self._view is None:
            framing = frame_arm(drawn.model, data, tip)
            self._view = framing.view(drawn.model, self._width / self._height)
        if self._canvas is None:
            drawn.settle(data.xpos[[tip]])
            self._canvas = Canvas(drawn.model, self._width, self._height, many=True)
        self._canvas.update(data, self._view.camera())
        return self._canvas.render()

    def close(self) -> None:
        """Gives the canvas back."""
        if self._canvas is not None:
            self._canvas.close()
        self._canvas = None
