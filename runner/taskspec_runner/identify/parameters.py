"""What can be identified of a task's world and arm: its values, as `vary` and `truth` name them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from taskspec.deferred_methods import dataclass
from taskspec.program.components import changed, value_of
from taskspec.program.program import Program
from taskspec.spec import Task
from taskspec.spec.value_path import ValuePath
from taskspec.text.suggest import suggestion
from taskspec.text.units import Dimension, si_unit
from taskspec_runner.errors import InputError

#: Keys of an object, with how far a value may plausibly be off [SI]; None for its own size.
_OF_SHAPE = {"stiffness": None, "damping": None, "friction": 0.5, "xyz": 0.02, "rpy": 0.1}
_OF_ROBOT = {
    "payload.mass": 1.0,
    "payload.xyz": 0.1,
    "joint_friction": 5.0,
    "joint_damping": 5.0,
    "sensor.bias": 5.0,
    "sensor.delay": 0.02,
    "sensor.filter": 0.005,
}
#: The same of the moments of `sensor.bias`.
_MOMENT = 0.5
DELAY, FILTER = "robot.sensor.delay", "robot.sensor.filter"
BIAS, PAYLOAD = "robot.sensor.bias", "robot.payload"
JOINT_FRICTION, JOINT_DAMPING = "robot.joint_friction", "robot.joint_damping"
FRAMES = "frames"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A component of a value that can be identified.

    Iterations go by its value, but of a filter f by the lag b T/(1 - b), b = exp(-2 pi f T), which
    is 0 for no filter.

    Attributes:
        path: as `vary` names it.
        index: of the component; None for a single number.
        dimension: of the value.
        declared: what iterations start from: that of the value in the file, or what stands for it.
        scale: how far it may plausibly be from that.
        least: it is at least this.
        period: of control [s].
    """

    path: str
    index: int | None
    dimension: Dimension
    declared: float
    scale: float
    least: float = -math.inf
    period: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it places an object: iterations go by how far it is moved along its own axis.

        Of `rpy` that is by how much it is turned about it.
        """
        return self.path.startswith("world.") and self.path.endswith((".xyz", ".rpy"))

    @property
    def name(self) -> str:
        """Of the component, such as `world.table.xyz.2`."""
        return self.path if self.index is None else f"{self.path}.{self.index}"

    @property
    def unit(self) -> str:
        """The SI unit."""
        return si_unit(self.dimension)

    def value(self, found: float) -> float:
        """The value in a file [SI], for what iterations go by; infinite for no filter."""
        if self.path != FILTER:
            return found
        if found <= 0:
            return math.inf
        return math.log1p(self.period / found) / (2 * math.pi * self.period)

    def put(self, task: Task, found: float) -> Task:
        """The task with what iterations go by."""
        value = self.value(found)
        if math.isinf(value):
            sensor = task.robot.sensor.model_copy(update={"filter": None})
            robot = task.robot.model_copy(update={"sensor": sensor})
            return task.model_copy(update={"robot": robot})
        return changed(task, self.path, self.index, value)


def parameters_of(program: Program, what: Sequence[str] | None = None) -> tuple[Parameter, ...]:
    """The parameters of a task that are wanted, in the order of its file.

    Args:
        program: of the task.
        what: paths, or beginnings of paths; None for all that can be identified.

    Raises:
        InputError: a path names nothing that can be.
    """
    found = tuple(_all(program))
    if what is None:
        return found
    if not what:
        named = ", ".join(dict.fromkeys(each.path for each in found))
        raise InputError(f"--what names nothing; values that can be identified: {named}")
    wanted = [_resolved(program, path) for path in what]
    for path, of in zip(what, wanted, strict=True):
        if not any(_names(of_path, each) for of_path in of for each in found):
            names = dict.fromkeys(each.path for each in found)
            hint = suggestion(path, names, "values that can be identified")
            raise InputError(f"--what: '{path}' is no value that can be identified; {hint}")
    return tuple(e for e in found if any(_names(path, e) for of in wanted for path in of))


def _names(path: str, parameter: Parameter) -> bool:
    return parameter.name == path or f"{parameter.path}.".startswith(f"{path}.")


def _resolved(program: Program, path: str) -> tuple[str, ...]:
    """What a path of `--what` stands for: a frame for the pose of the object that it is on."""
    section, _, name = path.partition(".")
    if section != FRAMES or name not in program.context.frames:
        return (path,)
    frame = program.context.frames[name]
    owner = frame.surface_name or frame.owner
    if not owner and name in program.context.loaded.task.shapes:
        owner = name
    return (f"world.{owner}.xyz", f"world.{owner}.rpy") if owner else (path,)


def _all(program: Program) -> Iterator[Parameter]:
    context = program.context
    task = context.loaded.task
    for name, shape in task.shapes.items():
        if not identifiable(task, name):
            continue
        for key, scale in _OF_SHAPE.items():
            path = f"world.{name}.{key}"
            if key == "stiffness" and isinstance(shape.stiffness, str):
                continue
            if key == "rpy" and shape.shape == "sphere":
                continue
            yield from _components(program, path, scale, 0.0 if key in _POSITIVE else -math.inf)
    for key, scale in _OF_ROBOT.items():
        positive = key not in ("payload.xyz", "sensor.bias")
        if key.startswith("joint_") and not task.robot.takes_torques:
            continue
        yield from _components(program, f"robot.{key}", scale, 0.0 if positive else -math.inf)


_POSITIVE = ("stiffness", "damping", "friction")


def identifiable(task: Task, name: str) -> bool:
    """Whether a shape is one whose contact is a function of the tool's motion alone."""
    shape = task.shapes[name]
    return not shape.free and shape.on is None and shape.motion is None


def _components(
    program: Program, path: str, scale: float | None, least: float
) -> Iterator[Parameter]:
    context = program.context
    task = context.loaded.task
    dimensions = task.target_of(path).dimensions
    for i, dimension in enumerate(dimensions):
        index = i if len(dimensions) > 1 else None
        declared = value_of(context, task, path, index)
        own = scale if scale is not None else max(abs(declared), 1.0)
        if path == BIAS and i >= 3:
            own = _MOMENT
        if path == FILTER:
            declared = (
                0.0
                if declared == 0
                else context.period / math.expm1(2 * math.pi * declared * context.period)
            )
        parameter = Parameter(path, index, dimension, declared, own, least, context.period)
        yield replace(parameter, declared=0.0) if parameter.moves else parameter


def owner_of(parameter: Parameter) -> str:
    """The object of the world that a parameter is of; empty for the robot's."""
    return ValuePath.of(parameter.path).owner
