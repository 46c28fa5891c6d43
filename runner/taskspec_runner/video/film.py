"""A run as frames, and as a file of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.whole import whole
from taskspec_runner.video.camera import frame_run, seen_from
from taskspec_runner.video.canvas import Image, new_context
from taskspec_runner.video.encoder import Encoder, ffmpeg
from taskspec_runner.video.panel import HEIGHT, WIDTH, SignalPanel
from taskspec_runner.video.picture import SPLIT, Pictures
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

_SUFFIXES = (".mp4", ".mkv", ".mov")


@dataclass(frozen=True, slots=True)
class Clip:
    """The part of a run that is shown, and how.

    Attributes:
        start, end: run time [s]; None for the whole.
        speed: 2 shows it twice as fast.
        width, height: [px], even.
        fps: frames a second.
        camera: azimuth, elevation [deg] and distance [m] of the picture of the arm; None to find.
    """

    start: float | None = None
    end: float | None = None
    speed: float = 1.0
    width: int = 1280
    height: int = 720
    fps: float = 25.0
    camera: tuple[float, float, float] | None = None

    def clocks(self, recording: Recording) -> list[float]:
        """Run time [s] of every frame.

        Raises:
            InputError: nothing of the run lies within.
        """
        first = float(recording.clock[0])
        start = first if self.start is None else max(self.start, first)
        end = recording.end if self.end is None else min(self.end, recording.end)
        if not start < end:
            raise InputError(f"nothing to show: the log goes from {first:g} to {recording.end:g} s")
        step = self.speed / self.fps
        return [start + i * step for i in range(max(1, int(np.ceil((end - start) / step - 1e-9))))]


class Film:
    """Frames of a run: picture above, panel below."""

    def __init__(self, recording: Recording, cut: Clip) -> None:
        """Prepares the frames of a cut.

        Raises:
            NoCanvasError: there is nothing to draw with.
            InputError: nothing of the run lies within the cut.
        """
        self.rows = [recording.row(clock) for clock in cut.clocks(recording)]
        below = min(round(cut.height * 0.3), round(HEIGHT * cut.width / WIDTH))
        world = RecordedWorld(recording)
        above = cut.height - below
        view = None
        if cut.camera is not None:
            shown = frame_run(world).view(world.model, SPLIT * cut.width / above)
            view = seen_from(shown, *cut.camera)
        self._panel = SignalPanel(recording, cut.width, below)
        self._pictures = Pictures(world, cut.width, above, view, many=True)

    def __enter__(self) -> Film:
        return self

    def __exit__(self, *_: object) -> None:
        self._pictures.close_canvas()

    def frame(self, row: int) -> Image:
        """(height, width, 3) the run at a row of its log."""
        return np.vstack([self._pictures.draw(row), self._panel.draw(row)])

    def frames(self) -> Iterator[Image]:
        """All frames in order; where the run stands still on one row, it is drawn once."""
        before, image = -1, np.zeros((0, 0, 3), dtype=np.uint8)
        for row in self.rows:
            if row != before:
                before, image = row, self.frame(row)
            yield image


def check_video(path: Path) -> None:
    """Finds out whether a video could be written, before anything else is done.

    Raises:
        NoCanvasError: there is nothing to draw with.
        InputError: there is no ffmpeg, or the name is not that of a video.
        MissingLibraryError: there is nothing that brings ffmpeg.
        OutputError: the file's folder is not there.
    """
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path} is not the name of a video; it ends in {', '.join(_SUFFIXES)}")
    if not path.absolute().parent.is_dir():
        raise OutputError(path, f"there is no folder {path.absolute().parent}")
    ffmpeg()
    new_context(64, 64).free()


def write_video(
    recording: Recording,
    path: Path,
    cut: Clip,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Writes a run as an H.264 video, whole or not at all.

    Args:
        recording: of the run.
        path: of the file, such as out.mp4.
        cut: what of it, and how.
        progress: called with the frames done and the frames there are.

    Raises:
        NoCanvasError: there is nothing to draw with.
        InputError: there is no ffmpeg, or nothing of the run lies within the cut.
        OutputError: the file cannot be written.
    """
    check_video(path)
    with (
        Film(recording, cut) as film,
        whole(path) as partial,
        Encoder(partial, cut.width, cut.height, cut.fps) as encoder,
    ):
        for number, frame in enumerate(film.frames(), 1):
            encoder.write(frame)
            if progress is not None:
                progress(number, len(film.rows))
