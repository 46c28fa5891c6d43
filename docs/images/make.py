"""Makes the pictures of the documents again, from runs of the shipped tasks.

    python docs/images/make.py           # all of them
    python docs/images/make.py laws      # those of docs/laws only

A wiping arm and what its run recorded, for the README; what the press of each control law and tasks
with constraints and limits recorded, for docs/laws. The picture of the arm needs a headless
OpenGL, such as EGL (MUJOCO_GL=egl) or OSMesa; the others do not.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from PIL import Image

from taskspec.compiler import Program, compile_task
from taskspec.spec import LAWS, load_task
from taskspec_runner.history import History, read_history
from taskspec_runner.plant.scene import build_scene
from taskspec_runner.report import write_overview_svg
from taskspec_runner.session import execute_program

HERE = Path(__file__).resolve().parent
TASKS = HERE.parent.parent / "tasks"
LIMITS = ("wipe-friction", "reach-limits")
WIDTH, HEIGHT = 1720, 880


def main() -> None:
    """Makes what the command line names."""
    if sys.argv[1:] != ["laws"]:
        program, history = record("wipe-table")
        draw_arm(program, history)
    for task in (*(f"press-{law}" for law in LAWS), "ring", "linkage", *LIMITS):
        record(task)


def record(task: str) -> tuple[Program, History]:
    """Runs a shipped task once and draws what it recorded as TASK.svg."""
    program = compile_task(load_task(TASKS / f"{task}.yaml"))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        execute_program(program, out, report=False)
        write_overview_svg(out, HERE / f"{task}.svg")
        return program, read_history(out / "log.arrow")


def draw_arm(program: Program, history: History) -> None:
    """Renders the arm in the middle of its wipe as wipe-table.png."""
    row = int(np.argmax(history.window("wipe"))) + 2500
    n = program.context.robot.pin.nv
    q = [history.columns[f"joint.{i + 1}.position"][row] for i in range(n)]
    scene = build_scene(program.context.robot, program.context.loaded.task, program.context.start)
    scene.model.vis.global_.offwidth, scene.model.vis.global_.offheight = WIDTH, HEIGHT
    scene.model.vis.quality.offsamples = 8
    data = mujoco.MjData(scene.model)
    data.qpos[:] = q
    mujoco.mj_forward(scene.model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0.28, 0.0, 0.36)
    camera.distance, camera.azimuth, camera.elevation = 1.35, 122.0, -16.0
    with mujoco.Renderer(scene.model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data, camera)
        picture = Image.fromarray(renderer.render())
    picture.resize((WIDTH // 2, HEIGHT // 2), Image.Resampling.LANCZOS).save(
        HERE / "wipe-table.png", optimize=True
    )


if __name__ == "__main__":
    main()
