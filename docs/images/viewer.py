"""Makes the picture of the viewer: the window of `taskspec replay RUN --view`.

    python docs/images/viewer.py

It opens a screen of its own, with Xvfb, ImageMagick's import and OpenGL for X; where they are not
there, the picture stays as it is. Which moment it shows depends on how fast the machine draws.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

from taskspec.compiler import compile_task
from taskspec.spec import load_task
from taskspec_runner.session import execute_program

HERE = Path(__file__).resolve().parent
TASK = HERE.parent / "tutorial" / "wipe-2.yaml"
DISPLAY, SCREEN = ":93", (1440, 900)
#: Of the screen, what the window takes.
_WINDOW = 2 / 3
#: When the run is looked at [s], and how long the window has to show it [s].
_FROM, _PATIENCE = "3.4", 30


def main() -> None:
    """Makes it, where that can be."""
    missing = [tool for tool in ("Xvfb", "import") if shutil.which(tool) is None]
    if missing:
        sys.stderr.write(f"no {', '.join(missing)}: the picture of the viewer stays as it is\n")
        return
    size = f"{SCREEN[0]}x{SCREEN[1]}x24"
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "wipe"
        execute_program(compile_task(load_task(TASK)), run, report=False)
        screen = subprocess.Popen(["Xvfb", DISPLAY, "-screen", "0", size, "+extension", "GLX"])
        try:
            time.sleep(1)
            shoot(run, Path(folder) / "screen.png")
        finally:
            screen.terminate()
            screen.wait()


def shoot(run: Path, shot: Path) -> None:
    """Opens the window slowed down, and takes its picture."""
    command = [sys.executable, "-m", "taskspec_runner", "replay", str(run), "--view"]
    command += ["--from", _FROM, "--speed", "0.01", "--quiet"]
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"} | {"DISPLAY": DISPLAY}
    viewer = subprocess.Popen(command, env=environment)
    try:
        time.sleep(_PATIENCE)
        if viewer.poll() is not None:
            sys.exit("the viewer has ended before its picture was taken")
        subprocess.run(["import", "-window", "root", str(shot)], env=environment, check=True)
    finally:
        viewer.kill()
        viewer.wait()
    window = tuple(round(_WINDOW * side) for side in SCREEN)
    picture = Image.open(shot).convert("RGB").crop((0, 0, *window))
    picture.quantize(256).save(HERE / "viewer.png", optimize=True)


if __name__ == "__main__":
    main()
