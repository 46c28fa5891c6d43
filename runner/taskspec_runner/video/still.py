"""One picture of the arm in contact, for reports."""

from __future__ import annotations

import base64
import io

from PIL import Image as Images

from taskspec_runner.runs import Run
from taskspec_runner.video.canvas import backends
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
    return _png(Recording.of(run), clock, size)


def _png(recording: Recording, clock: float | None, size: tuple[int, int]) -> bytes:
    row = steadiest_contact(recording) if clock is None else recording.row(clock)
    pictures = Pictures(RecordedWorld(recording), *size)
    try:
        drawn = pictures.draw(row)
    finally:
        pictures.close_canvas()
    file = io.BytesIO()
    # Two bits less in each colour are invisible, and halve the file; a palette would be visible.
    coarse = (drawn & 0xFC) | (drawn >> 6)
    Images.fromarray(coarse).save(file, "png", optimize=True)
    return file.getvalue()


def still_for_report(run: Run) -> tuple[str, float] | None:
    """The picture as a `data:` address with its run time [s]; None where none can be drawn."""
    if not backends():
        return None
    try:
        recording = Recording.of(run)
        clock = float(recording.clock[steadiest_contact(recording)])
        png = _png(recording, clock, SIZE)
    # Whatever keeps it from being drawn: a report without a picture is still a report.
    except Exception:
        return None
    if len(png) > MOST_BYTES:
        return None
    return f"data:image/png;base64,{base64.b64encode(png).decode()}", clock
