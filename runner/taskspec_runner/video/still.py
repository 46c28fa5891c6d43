"""One picture of the arm in contact, for reports."""

from __future__ import annotations

import base64
import io

from PIL import Image as Images

from taskspec_runner.runs import Run
from taskspec_runner.video.picture import Pictures
from taskspec_runner.video.recording import Recording, steadiest_contact
from taskspec_runner.video.world import RecordedWorld

#: Size of the picture [px].
SIZE = (1120, 490)
#: A picture in a report has no more bytes than this.
MOST_BYTES = 150_000


def render_still(run: Run, clock: float | None = None, size: tuple[int, int] = SIZE) -> bytes:
    """A PNG of a run at one time.

    Args:
        run: to draw.
        clock: run time [s]; None for the largest force that stays.
        size: width and height [px].

    Raises:
        NoCanvasError: there is nothing to draw with.
        InputError: the run has nothing that can be drawn.
    """
    recording = Recording.of(run)
    row = steadiest_contact(recording) if clock is None else recording.row(clock)
    return _png(RecordedWorld(recording), row, size)


def _png(world: RecordedWorld, row: int, size: tuple[int, int]) -> bytes:
    pictures = Pictures(world, *size)
    try:
        drawn = pictures.draw(row)
    finally:
        pictures.close_canvas()
    file = io.BytesIO()
    # Two bits less in each colour are invisible, and halve the file; a palette would be visible.
    coarse = (drawn & 0xFC) | (drawn >> 6)
    Images.fromarray(coarse).save(file, "png", optimize=True)
    return file.getvalue()


def still_of(world: RecordedWorld, clock: float) -> str:
    """A picture of a run at a time [s] as a `data:` address; empty where it is too large.

    Raises:
        NoCanvasError: there is nothing to draw with.
    """
    png = _png(world, world.recording.row(clock), SIZE)
    if len(png) > MOST_BYTES:
        return ""
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"
