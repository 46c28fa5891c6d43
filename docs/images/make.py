"""Makes the pictures of the documents again, from runs of the shipped tasks.

    python docs/images/make.py           # all of them
    python docs/images/make.py laws      # those of docs/laws only

A frame of the video of a wiping arm and what its run recorded, for the README; what the press of
each control law and tasks with constraints and limits recorded, for docs/laws. The frame needs a
headless OpenGL, EGL or OSMesa; the others do not.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image

from taskspec.compiler import compile_task
from taskspec.spec import LAWS, load_task
from taskspec_runner.report import write_overview_svg
from taskspec_runner.session import execute_program
from taskspec_runner.video.film import Cut, Film
from taskspec_runner.video.recording import Recording, read_recording

HERE = Path(__file__).resolve().parent
TASKS = HERE.parent.parent / "tasks"
LIMITS = ("wipe-friction", "reach-limits")
#: Tasks of which a frame of the video is shown, and its run time [s].
FRAMES = {"wipe-table": 3.4}


def main() -> None:
    """Makes what the command line names."""
    if sys.argv[1:] != ["laws"]:
        record("wipe-table")
    for task in (*(f"press-{law}" for law in LAWS), "ring", "linkage", *LIMITS):
        record(task)


def record(task: str) -> None:
    """Runs a shipped task once and draws what it recorded as TASK.svg, and a frame of some."""
    program = compile_task(load_task(TASKS / f"{task}.yaml"))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        execute_program(program, out, report=False)
        write_overview_svg(out, HERE / f"{task}.svg")
        if task in FRAMES:
            draw_frame(read_recording(out, program), FRAMES[task], HERE / f"{task}.png")


def draw_frame(recording: Recording, clock: float, path: Path) -> None:
    """Draws the frame of a run's video at a run time [s], with few colours that keep it small."""
    with Film(recording, Cut()) as film:
        frame = film.frame(recording.row(clock))
    coarse = (frame & 0xFC) | (frame >> 6)
    Image.fromarray(coarse).save(path, optimize=True)


if __name__ == "__main__":
    main()
