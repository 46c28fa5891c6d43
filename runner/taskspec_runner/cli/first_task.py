"""`taskspec new --model`: a first task for an arm that has none yet, which has passed once."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.robot import RobotError, RobotModel, load_robot
from taskspec.robot.first_start import FirstStart, first_starts
from taskspec.robot.packages import is_packaged
from taskspec.schema import FILE_NAME
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.given import task_name
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.whole import write_whole
from taskspec_runner.session import execute_program

#: Starts that are tried before it is given up.
_STARTS_TRIED = 6
_FORCES = (15.0, 10.0, 5.0, 3.0, 2.0, 1.0)


def first_task(model: str, target: Path, flange: str | None) -> list[str]:
    """Writes a first task for a robot: it approaches a surface, presses on it, wipes, leaves.

    Args:
        model: as a task file has it, a file's path relative to the working directory.
        target: the task file to be.
        flange: the body that carries the tool; None where it is clear.

    Returns:
        What there is to say of it, a line each.

    Raises:
        InputError: the robot cannot be used, or no task was found for it.
        OutputError: the file cannot be written.
    """
    if target.exists():
        raise InputError(f"{target} exists already; choose another place with --out")
    shown = model if is_packaged(model) else _relative(Path(model), target.parent)
    lines = [] if flange is None else [f"flange: {flange}"]
    robot = _robot(shown, target.parent, lines)
    remarks = robot.remarks
    said = [f"{r.message}{f'; the task has {r.line}' if r.line else ''}" for r in remarks]
    settled = [remark.line for remark in remarks if remark.line]
    if settled:
        lines = settled[:1]
        robot = _robot(shown, target.parent, lines)
    if not {"x", "y", "z"} <= set(robot.axes):
        axes = ", ".join(robot.axes)
        raise InputError(
            f"'{robot.name}' moves its tool along {axes} alone, and a first task needs x, y and z: "
            "begin with a template of a planar arm, such as taskspec new press-impedance"
        )
    reason = (
        "no start was found at which it is bent, clear of its limits and able to bear itself "
        "(springs or counterweights that carry it are said by `balanced: true`)"
    )
    for start in islice(first_starts(robot), _STARTS_TRIED):
        text = _text(shown, robot, start, lines, target)
        reason = _fails(text, target)
        if not reason:
            _write(target, text)
            return said
    raise InputError(f"no first task was found for '{shown}': {reason}")


def _relative(model: Path, folder: Path) -> str:
    """A path relative to a folder."""
    if not model.suffix:
        return str(model)  # The name of a built-in robot.
    return Path(os.path.relpath(model, folder)).as_posix()


def _robot(model: str, folder: Path, lines: Sequence[str]) -> RobotModel:
    """The robot with the tool of the task.

    Raises:
        InputError: it cannot be used.
    """
    text = "\n".join(
        ("taskspec: 1", "robot:", *(f"  {line}" for line in _section(model, lines)),
         "stages: {wait: {time: 1 s}}")
    )  # fmt: skip
    try:
        loaded = load_text(text, "first.yaml", base=folder)
        return load_robot(loaded.task.robot, folder)
    except RobotError as error:
        remedy = f"; {error.hint}" if error.hint else ""
        if error.code == "TS406":
            remedy = remedy.replace("flange: ", "--flange ")
        raise InputError(f"{error.code}: {error.message}{remedy}") from error


def _section(model: str, lines: Sequence[str]) -> Iterator[str]:
    yield f'model: "{model}"' if ":" in model else f"model: {model}"
    yield from lines
    yield "tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 200 g}"


def _text(
    model: str, robot: RobotModel, start: FirstStart, lines: Sequence[str], target: Path
) -> str:
    joints = ", ".join(
        f"{np.degrees(value):.2f} deg" if turns else f"{1e3 * value:.2f} mm"
        for value, turns in zip(start.q, robot.hinges, strict=True)
    )
    stroke = max(1, round(1e3 * start.stroke / 2))
    gap = max(2, round(1e3 * start.stroke / 3))
    force = next((each for each in _FORCES if each <= start.force), _FORCES[-1])
    height = round(1e3 * float(start.tip[2])) - gap
    x, y, z = (f"{1e3 * value:.0f}" for value in start.tip)
    section = "\n".join(f"  {line}" for line in _section(model, lines))
    speed = max(2, min(20, gap))
    return f"""\
# yaml-language-server: $schema={FILE_NAME}
taskspec: 1
name: {task_name(target)}
about: A first task; approach a surface, press on it and wipe.

robot:
{section}
  start: {{joints: [{joints}]}}   # found by search: the tip is at [{x}, {y}, {z}] mm, tool down

world:
  table:
    {{shape: plane, xyz: [0, 0, {height} mm], stiffness: 20 kN/m, damping: 30 N*s/m, friction: 0.2}}

params: {{press: {force:g} N}}
frames: {{task: {{surface: table}}}}            # z is the table's outward normal
frame: task
law: hybrid                               # gains left out are designed; see `taskspec explain`
limits: {{force: {4 * force:g} N}}

stages:
  approach:
    axes: {{z: {{velocity: -{speed} mm/s}}}}
    until: force.z < -{0.1 * force:g} N for 10 ms
    within: {{travel: {2 * gap} mm, time: {max(4, round(3 * gap / speed))} s}}
  wipe:
    axes:
      x: {{position: {stroke} mm * sin(2*pi*t/(4 s))}}
      y: {{position: {stroke // 2} mm * sin(4*pi*t/(4 s))}}
      z: {{force: -press, ramp: 0.3 s}}
    time: 8 s
  retreat:
    axes: {{z: {{move: {gap} mm, speed: {2 * speed} mm/s}}}}

expect:
  - wipe.force.z within -press +- {max(0.5, force / 20):g} N for 90 %
  - rms(wipe.error.x) < {max(1, stroke // 10)} mm      # friction holds a light arm back
  - max(norm(force)) < {3 * force:g} N
"""


def _fails(text: str, target: Path) -> str:
    """Why the task is not written: its first error, its end or what it did not meet; or empty."""
    try:
        loaded = load_text(text, str(target), base=target.parent)
        program = admit(examine(loaded))
    except SpecError as error:
        first = error.diagnostics[0]
        return f"{first.code}, {first.message}"
    with tempfile.TemporaryDirectory() as folder:
        run = execute_program(program, Path(folder) / "run", report=False)
    missed = [judged.title for judged in run.expectations if not judged.passed]
    if run.exit_code == 0:
        return ""
    return f"its run misses {missed[0]}" if missed else "its run does not come to its end"


def _write(target: Path, text: str) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, text.encode())
    except OSError as error:
        raise OutputError.of(target, error) from error
