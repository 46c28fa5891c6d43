"""`taskspec replay`: a recorded run as a video, in a page or in a window."""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlencode

import typer

from taskspec_runner.cli.options import CutOptions, ReplayOptions
from taskspec_runner.cli.progress import counted_line
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError
from taskspec_runner.runs import Run

if TYPE_CHECKING:
    from taskspec_runner.video.film import Clip

_SMALLEST_SIZE, _LARGEST_SIZE = (320, 180), (3840, 2160)


def replay_run(
    folder: Path, video: Path | None, cut: CutOptions, shown: ReplayOptions, *, quiet: bool
) -> int:
    """Shows the run of a folder, as a video, in a page, or else in a window."""
    if sum((video is not None, shown.view, shown.web)) > 1:
        raise InputError("give one of --video, --view and --web")
    if shown.port is not None and not shown.web:
        raise InputError("--port is that of the page; give --web, too")
    run = Run.load(folder)
    clip = read_cut(cut)
    if video is not None:
        film(run, video, clip, quiet=quiet)
        typer.echo(str(video))
        return warn_of_damage(run, "the video")
    if shown.web:
        _serve(run, clip, shown.port or 0)
        return warn_of_damage(run)
    from taskspec_runner.video import viewer
    from taskspec_runner.video.recording import Recording

    viewer.check_display()
    viewer.view(Recording.of(run), clip)
    return warn_of_damage(run)


def _serve(run: Run, clip: Clip, port: int) -> None:
    """Serves the report of a run, whose arm moves at once, until Ctrl-C."""
    from taskspec_runner.live.channel import Channel
    from taskspec_runner.live.server import PageServer, announce
    from taskspec_runner.report.page import render
    from taskspec_runner.scene.page import pictured
    from taskspec_runner.video.recording import Recording

    if clip.camera is not None:
        raise InputError("--camera is of a video and of a window; in a page the mouse turns it")
    arm = pictured(run)
    if arm is None:
        # Which says what is wrong with the run.
        Recording.of(run)
    page = render(run, arm)
    wanted = {"play": clip.speed, "from": clip.start, "to": clip.end}
    asked = urlencode({key: f"{value:g}" for key, value in wanted.items() if value is not None})
    with PageServer({"": lambda: page}, Channel(1), port=port) as server:
        announce(f"{server.url}#{asked}")
        server.wait()


def film(run: Run, video: Path, cut: Clip | None = None, *, quiet: bool = False) -> None:
    """Writes a run as a video, with a line of progress."""
    from taskspec_runner.video.film import Clip, check_video, write_video
    from taskspec_runner.video.recording import Recording

    check_video(video)
    recording = Recording.of(run)
    with counted_line("video: frame", shown=not quiet and sys.stderr.isatty()) as progress:
        write_video(recording, video, cut or Clip(), progress)


def read_cut(cut: CutOptions) -> Clip:
    """What of a run is shown, and how, from the command line.

    Raises:
        InputError: a number makes no sense.
    """
    from taskspec_runner.video.film import Clip

    if not 0.001 <= cut.speed <= 1000:
        raise InputError(f"--speed is from 0.001 to 1000, not {cut.speed:g}")
    if not 1 <= cut.fps <= 240:
        raise InputError(f"--fps is from 1 to 240, not {cut.fps:g}")
    for name, value in (("--from", cut.start), ("--to", cut.end)):
        if value is not None and not math.isfinite(value):
            raise InputError(f"{name} needs a time in seconds, not {value:g}")
    width, height = picture_size(cut.size, _SMALLEST_SIZE)
    camera = None if cut.camera is None else camera_place(cut.camera)
    return Clip(cut.start, cut.end, cut.speed, width, height, cut.fps, camera)


def picture_size(text: str, smallest: tuple[int, int]) -> tuple[int, int]:
    """Width and height of pictures [px], from the command line; both are even.

    Raises:
        InputError: it is no size, or too small or too large.
    """
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text.strip())
    width, height = (int(found[1]), int(found[2])) if found else (0, 0)
    good = smallest[0] <= width <= _LARGEST_SIZE[0] and smallest[1] <= height <= _LARGEST_SIZE[1]
    if not good or width % 2 or height % 2:
        limits = " to ".join("x".join(map(str, each)) for each in (smallest, _LARGEST_SIZE))
        raise InputError(
            f"--size needs two even numbers of pixels, {limits}, such as 1280x720, not {text!r}"
        )
    return width, height


def camera_place(text: str, otherwise: str = "") -> tuple[float, float, float]:
    """Azimuth, elevation [deg] and distance [m] of a camera, from the command line.

    Args:
        text: as it was given.
        otherwise: what else the option takes, for the message.

    Raises:
        InputError: it is none.
    """
    try:
        azimuth, elevation, distance = (float(part) for part in text.split(","))
    except ValueError:
        azimuth = elevation = distance = math.nan
    if not (math.isfinite(azimuth) and abs(elevation) <= 90 and 0.05 <= distance <= 100):
        raise InputError(
            f"--camera needs {otherwise}azimuth and elevation in degrees and a distance in metres, "
            f"such as 120,-20,1.2, not {text!r}"
        )
    return azimuth, elevation, distance
