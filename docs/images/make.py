"""Makes the pictures of the documents again, from runs of the shipped tasks.

    python docs/images/make.py           # all of them
    python docs/images/make.py laws      # those of docs/laws only

The video of a wiping arm and what its run recorded, for the README; the same of the
tasks of the tutorial, one of them under all laws; what the press of each control law and tasks with
constraints and limits recorded, for docs/laws; a raster, for docs/how-to. Frames need a headless
OpenGL, EGL or OSMesa, and stay as they are where there is none; the others do not.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
from PIL import Image

from taskspec.compiler import compile_task
from taskspec.laws import LAWS
from taskspec.program.worlds import random_world
from taskspec.spec import load_task
from taskspec_runner.cli.compare import compare_laws
from taskspec_runner.cli.options import CompareOptions
from taskspec_runner.compare import PICTURE
from taskspec_runner.pages.chart import Chart, Trace
from taskspec_runner.pages.picture import Picture, picture_svg
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.session import execute_program
from taskspec_runner.video.canvas import backends
from taskspec_runner.video.film import Clip, Film
from taskspec_runner.video.recording import Recording

HERE = Path(__file__).resolve().parent
TASKS = HERE.parent.parent / "tasks"
OTHERS = (
    *("ring", "linkage", "linkage-in-joints", "raster-polish", "fold-out-and-press"),
    *("hand-guiding", "stiffness-identification", "face-alignment"),
    *("peg-in-hole", "groove-following", "contour-unknown", "unplug"),
    *("slot-insertion", "push-button", "edge-following", "snap-fit", "outline-following"),
    *("deburr", "corner-seating", "pivot-box"),
)
#: The task and the picture of what the representation of orientation does to it.
ORIENTATIONS = "unknown-load"
LIMITS = ("wipe-friction", "reach-limits")
TUTORIAL = HERE.parent / "tutorial"
#: Pictures of the tutorial, and the step that they show.
STEPS = {
    "tutorial-press": "press-3",
    "tutorial-wipe": "wipe-2",
    "tutorial-ring": "wipe-3",
    "tutorial-fast": "wipe-4",
}
#: Pictures of which there is a frame of the video too, and its run time [s].
FRAMES = {"tutorial-press": 3.0, "tutorial-wipe": 3.4}
#: Pictures that move, how much of a run is between two of their frames [s], and their size [px].
MOVING, MOVING_STEP, MOVING_SIZE = ("wipe-table",), 0.125, (854, 480)
#: Pictures of runs that readers are told to make in spite of an error.
FORCED = ("tutorial-ring",)
#: Pictures of a random world, by its number: the one that the controller is told searches nothing.
WORLDS = {"peg-in-hole": 5}
#: Pictures of a step of the tutorial under all laws.
COMPARED = {"compare-wipe": "wipe-2"}


def main() -> None:
    """Makes what the command line names."""
    if sys.argv[1:] != ["laws"]:
        record("wipe-table")
        for picture, step in STEPS.items():
            record(picture, TUTORIAL / f"{step}.yaml")
        for picture, step in COMPARED.items():
            compare(picture, TUTORIAL / f"{step}.yaml")
    for task in (
        *(f"press-{law}" for law in LAWS),
        *OTHERS,
        *LIMITS,
    ):
        record(task)
    represent(ORIENTATIONS)


def record(picture: str, task: Path | None = None) -> None:
    """Runs a task once and draws what it recorded as PICTURE.svg, and a frame of some.

    Args:
        picture: name of the picture. task: the file, by default the shipped task of that name.
    """
    # The step of the tutorial that rings is refused, and is drawn all the same.
    loaded = load_task(task or TASKS / f"{picture}.yaml")
    program = compile_task(loaded, force=picture in FORCED)
    number = WORLDS.get(picture)
    world = None if number is None else random_world(program.context, 0, number)
    with tempfile.TemporaryDirectory() as folder:
        run = execute_program(program, Path(folder) / "run", world=world, report=False)
        run.plot().save(HERE / f"{picture}.svg")
        if picture in FRAMES and backends():
            draw_frame(Recording.of(run), FRAMES[picture], HERE / f"{picture}.png")
        if picture in MOVING and backends():
            draw_moving(Recording.of(run), HERE / f"{picture}.webp")


def represent(picture: str) -> None:
    """Runs a task under all representations of orientation and draws its turns as PICTURE.svg."""
    roles = {"so3": "x", "rpy": "y", "zyz": "z"}
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            name: execute_program(
                compile_task(load_task(TASKS / f"{picture}.yaml", {"law.orientation": name})),
                Path(folder) / name,
                report=False,
            )
            for name in roles
        }
        charts = [
            Chart(
                axis,
                f"Turn about {axis[1]} under the load",
                "deg",
                tuple(
                    Trace(name, np.degrees(run.columns[f"position.{axis}"]), roles[name], run=name)
                    for name, run in runs.items()
                ),
            )
            for axis in ("rx", "rz")
        ]
        timeline = Timeline(runs, "so3", dict.fromkeys(runs, 0.0))
        drawn = picture_svg(picture, ", ".join(roles), "", timeline, charts)
        Picture(drawn).save(HERE / f"{picture}.svg")


def compare(picture: str, task: Path) -> None:
    """Runs a task under every law and draws all of them as PICTURE.svg."""
    with tempfile.TemporaryDirectory() as folder:
        with redirect_stdout(StringIO()):
            compare_laws(task, CompareOptions(out=Path(folder), quiet=True))
        shutil.copy(Path(folder) / PICTURE, HERE / f"{picture}.svg")


def draw_frame(recording: Recording, clock: float, path: Path) -> None:
    """Draws the frame of a run's video at a run time [s], with few colours that keep it small."""
    with Film(recording, Clip()) as film:
        frame = film.frame(recording.row(clock))
    coarse = (frame & 0xFC) | (frame >> 6)
    Image.fromarray(coarse).save(path, optimize=True)


def draw_moving(recording: Recording, path: Path) -> None:
    """Draws a run's video as a moving picture that a page shows by itself, at its speed."""
    rows = range(0, len(recording), round(MOVING_STEP / recording.period))
    with Film(recording, Clip()) as film:
        frames = [Image.fromarray(film.frame(row)).resize(MOVING_SIZE) for row in rows]
    length = round(1000 * MOVING_STEP)
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=length, loop=0, quality=55, method=6
    )


if __name__ == "__main__":
    main()
