"""Defaults that a task takes where its file says nothing (docs/language/defaults.md)."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.modes import DEFAULT_RAMP
from taskspec.program.program import Program
from taskspec.program.stages.null_space import goals
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world.stiffness import Compliance
from taskspec.robot.tool import LENGTH
from taskspec.shapes import tool_shapes
from taskspec.spec import Bushing, EquationObject, Mechanism, Robot, Shape, Task
from taskspec.text.nodes import find
from taskspec.text.units import DAMPING, INERTIA, MASS, STIFFNESS, scaled, show

_SENSOR = {
    "at": "contact: neither weight nor inertia of the tool",
    "rate": "that of the controller",
    "delay": "0 s beyond the one tick",
    "noise": "none",
    "bias": "none",
    "filter": "none",
}


def default_rows(program: Program) -> Iterator[tuple[str, str]]:
    """What the file leaves out, and what stands in its place."""
    task = program.context.loaded.task
    yield from _sections(task)
    yield from _rates(program)
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


def _rates(program: Program) -> Iterator[tuple[str, str]]:
    loaded = program.context.loaded
    for key in ("rate", "plant_rate"):
        _, found = find(loaded.root, ("control", key))
        if found < len(("control", key)):
            yield f"control.{key}", show(getattr(loaded.task.control, key), "kHz")


def _robot(program: Program) -> Iterator[tuple[str, str]]:
    robot, model = program.context.loaded.task.robot, program.context.robot
    given = robot.model_fields_set
    if "tool" not in given:
        planar = "z" not in model.axes
        end = "where the last link ends" if planar else "100 mm from the flange"
        yield "robot.tool", f"a massless sphere of radius 10 mm, its tip {end}"
    else:
        own = robot.tool.model_fields_set
        if "shape" not in own:
            yield "robot.tool.shape", robot.tool.shape
        if "length" not in own:
            yield "robot.tool.length", show(LENGTH if "z" in model.axes else 0.0, "mm")
        if "radius" not in own and tool_shapes()[robot.tool.shape].tool_keys.get("radius") is False:
            yield "robot.tool.radius", show(float(model.tool.radii[0]), "mm")
        if "mass" not in own:
            yield "robot.tool.mass", "0 kg"
    if "base" not in given:
        yield "robot.base", "the world's origin"
    yield from _start(robot, vertical="z" in model.axes)
    laws = [stage.plan.law for stage in program.stages]
    if "posture" not in given and any("posture" in goals(a, model, model.axes) for a in laws):
        yield "robot.posture", "the start configuration"
    if "sensor" not in given:
        yield "robot.sensor", "contact wrench, every tick, one tick late, no noise"
    else:
        own = robot.sensor.model_fields_set
        yield from ((f"robot.sensor.{k}", v) for k, v in _SENSOR.items() if k not in own)


def _start(robot: Robot, *, vertical: bool) -> Iterator[tuple[str, str]]:
    start = robot.start
    if start is None and robot.grasp is None:
        yield "robot.start", "the model's home position"
    elif start is None or start.joints is None:
        if start is None or start.xyz is None:
            yield "robot.start.xyz", f"where the tip takes hold of {robot.grasp}"
        if vertical and (start is None or start.rpy is None):
            yield "robot.start.rpy", "pointing down"


def _world(program: Program) -> Iterator[tuple[str, str]]:
    context = program.context
    for name, declared in context.loaded.task.world.items():
        if isinstance(declared, Bushing):
            yield from _bushing(name, declared)
            continue
        if not isinstance(declared, EquationObject):
            left_out = (key for key in ("xyz", "rpy") if key not in declared.model_fields_set)
            yield from ((f"world.{name}.{key}", "[0, 0, 0]") for key in left_out)
        if isinstance(declared, Mechanism):
            found = _mechanism(declared)
        else:
            found = _compliant(declared, context.compliances[name])
        yield from ((f"world.{name}.{key}", value) for key, value in found)


def _bushing(name: str, declared: Bushing) -> Iterator[tuple[str, str]]:
    if "rpy" not in declared.model_fields_set:
        yield f"world.{name}.rpy", "pointing down"
    if declared.damping is None:
        yield f"world.{name}.damping", "a tenth of critical for 1 kg and 0.05 kg*m^2"


def _compliant(declared: Shape | EquationObject, contact: Compliance) -> Iterator[tuple[str, str]]:
    """Of something that is touched, or of an equation."""
    given = declared.model_fields_set
    equation = declared.equation if isinstance(declared, EquationObject) else None
    angular = equation is not None and equation.angular
    if equation is not None and not equation.joints and "frame" not in given:
        yield "frame", "world"
    if "stiffness" not in given:
        yield "stiffness", scaled(contact.stiffness, STIFFNESS.on(rotation=angular))
    if "damping" not in given and not contact.exact:
        yield "damping", show(contact.damping, DAMPING.on(rotation=angular))
    if isinstance(declared, Shape) and "friction" not in given:
        yield "friction", "0"


def _mechanism(declared: Mechanism) -> Iterator[tuple[str, str]]:
    given = declared.model_fields_set
    if "handle" not in given:
        yield "handle", "at the origin of its axes"
    if "knob" not in given:
        yield "knob", declared.knob
    for key, dimension in (("inertia", INERTIA), ("mass", MASS)):
        if key in type(declared).model_fields and key not in given:
            yield key, show(getattr(declared, key), dimension)
    yield from ((key, "0") for key in ("damping", "friction") if key not in given)
    yield from ((key, "none") for key in ("stop", "detent") if key not in given)


def _stage(stage: CompiledStage) -> Iterator[tuple[str, str]]:
    plan = stage.plan
    holding = [a for a, p in plan.plans.items() if a not in plan.spec.axes and not p.mode.moves]
    holding = holding if plan.joint_path is None else []
    if holding:
        yield f"stages.{stage.name}.axes: {' '.join(holding)}", "hold"
    for name, wanted in stage.plan.spec.constraints.items():
        if wanted.ramp is None:
            yield f"stages.{stage.name}.constraints.{name}.ramp", show(DEFAULT_RAMP, "s")
    for axis, entry in stage.plan.spec.axes.items():
        place = f"stages.{stage.name}.axes.{axis}"
        force = entry.set_point
        for key, value in () if force is None else force.defaults():
            yield f"{place}.{key}", value
        for key, value in entry.mode.defaults(axis):
            yield f"{place}.{key}", value
