"""Defaults that a task has taken, because its file does not say otherwise (language.md 7)."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.compiler import Program
from taskspec.program.null_space import goals
from taskspec.program.references import DEFAULT_RAMP
from taskspec.program.stage import CompiledStage
from taskspec.program.tracks import move_speed
from taskspec.spec import Axis, Task
from taskspec.text.show import show
from taskspec_runner.cli.measures import speed, stiffness


def speed_of(axis: str, entry: Axis) -> str:
    """The speed of a move, given or not."""
    return speed(entry.speed or float(move_speed(axis)), axis)


def ramp_of(entry: Axis) -> str:
    """The time in which a force is reached, given or not."""
    return show(DEFAULT_RAMP if entry.ramp is None else entry.ramp, "s")


def defaults_taken(program: Program) -> Iterator[tuple[str, str]]:
    """What the file leaves out, and what stands in its place."""
    task = program.context.loaded.task
    yield from _sections(task)
    yield from _robot(program)
    yield from _world(program)
    for stage in program.stages:
        yield from _stage(stage)


def _sections(task: Task) -> Iterator[tuple[str, str]]:
    given = task.model_fields_set
    for key in ("name", "frame", "law"):
        if key not in given:
            value = task.law.kind if key == "law" else str(getattr(task, key))
            yield key, value
    if "limits" not in given:
        yield "limits", "the robot's own joint limits only"
    for key in ("rate", "plant_rate"):
        if key not in task.control.model_fields_set:
            yield f"control.{key}", show(getattr(task.control, key), "kHz")


def _robot(program: Program) -> Iterator[tuple[str, str]]:
    robot, model = program.context.loaded.task.robot, program.context.robot
    given = robot.model_fields_set
    if "tool" not in given:
        planar = "z" not in model.axes
        end = "where the last link ends" if planar else "100 mm from the flange"
        yield "robot.tool", f"a massless sphere of radius 10 mm, its tip {end}"
    else:
        own = robot.tool.model_fields_set
        if robot.tool.shape == "sphere" and "radius" not in own:
            yield "robot.tool.radius", show(float(model.tool.radii[0]), "mm")
        if "mass" not in own:
            yield "robot.tool.mass", "0 kg"
    if "base" not in given:
        yield "robot.base", "the world's origin"
    if robot.start is None:
        yield "robot.start", "the model's home position"
    elif robot.start.joints is None and robot.start.rpy is None and "z" in model.axes:
        yield "robot.start.rpy", "pointing down"
    laws = [program.context.law_of(stage) for stage in program.context.loaded.task.stages.values()]
    if "posture" not in given and any("posture" in goals(a, model, model.axes) for a in laws):
        yield "robot.posture", "the start configuration"
    if "sensor" not in given:
        yield "robot.sensor", "contact wrench, every tick, one tick late, no noise"


def _world(program: Program) -> Iterator[tuple[str, str]]:
    context = program.context
    task = context.loaded.task
    for name, shape in task.shapes.items():
        given = shape.model_fields_set
        if "stiffness" not in given:
            yield f"world.{name}.stiffness", stiffness(float(shape.stiffness))
        if "damping" not in given:
            damping = context.compliances[name].damping
            yield f"world.{name}.damping", show(damping, "N*s/m")
        if "friction" not in given:
            yield f"world.{name}.friction", "0"


def _stage(stage: CompiledStage) -> Iterator[tuple[str, str]]:
    holding = [a for a in stage.plans if a not in stage.spec.axes and stage.plans[a].mode == "hold"]
    if holding:
        yield f"stages.{stage.name}.axes: {' '.join(holding)}", "hold"
    for axis, entry in stage.spec.axes.items():
        place = f"stages.{stage.name}.axes.{axis}"
        if (entry.force is not None or entry.torque is not None) and entry.ramp is None:
            yield f"{place}.ramp", ramp_of(entry)
        if entry.move is not None and entry.speed is None:
            yield f"{place}.speed", speed_of(axis, entry)
