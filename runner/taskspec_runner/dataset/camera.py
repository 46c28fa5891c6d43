"""What a camera beside the arm shows of a run, frame by frame, as a video of its episode."""

from __future__ import annotations

from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec_runner.dataset.frames import RunFrames
from taskspec_runner.dataset.statistics import Colours
from taskspec_runner.video.camera import View, frame_run, seen_from
from taskspec_runner.video.canvas import Canvas, new_context
from taskspec_runner.video.encoder import SEEKABLE, Encoder, ffmpeg
from taskspec_runner.video.marks import Marks
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

#: Edge of the map of the shadows [px].
_SHADOW = 512


@dataclass(slots=True)
class Camera:
    """A camera that stands still: arm and world without arrows, paths and words.

    Attributes:
        width, height: [px], even.
        place: azimuth, elevation [deg] and distance [m]; None to find one that has all of the first
            run in its picture. All runs are filmed from there.
    """

    width: int
    height: int
    place: tuple[float, float, float] | None = None
    _view: View | None = None

    @staticmethod
    def check() -> None:
        """Finds out whether videos can be made, before anything else is done.

        Raises:
            NoCanvasError: there is nothing to draw with.
            InputError: there is no ffmpeg.
            MissingLibraryError: there is nothing that brings it.
        """
        ffmpeg()
        new_context(64, 64).free()

    def film(self, frames: RunFrames, path: Path) -> Colours:
        """Writes the frames of a run into a new file as H.264; returns their colours.

        Raises:
            InputError: the run cannot be drawn.
            OSError: the encoder has failed.
        """
        run, fps = frames.run, frames.layout.fps
        recording = Recording.of(run)
        world = RecordedWorld(recording)
        # Of pictures as small as these, a finer one shows nothing more.
        world.model.vis.quality.shadowsize = _SHADOW
        view = self._placed(world)
        marks, colours = Marks(world), Colours()
        with (
            Canvas(world.model, self.width, self.height, many=True) as canvas,
            Encoder(path, self.width, self.height, fps, SEEKABLE) as encoder,
        ):
            for clock in run.history.columns["clock"][frames.rows]:
                canvas.update(world.show(recording.row(float(clock))), view.camera())
                marks.draw_bodies(canvas.scene)
                picture = canvas.render()
                encoder.write(picture)
                colours.add(picture)
        return colours

    def _placed(self, world: RecordedWorld) -> View:
        if self._view is None:
            found = frame_run(world).view(world.model, self.width / self.height)
            self._view = found if self.place is None else seen_from(found, *self.place)
        return self._view
