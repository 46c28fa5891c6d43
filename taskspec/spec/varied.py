"""Values of a file that may be otherwise in the real world: their paths, dimensions and bounds."""

from __future__ import annotations

from collections.abc import Iterator
from types import MappingProxyType
from typing import get_args

from pydantic.fields import FieldInfo

from taskspec.deferred_methods import dataclass
from taskspec.spec.fields import EXACT, SPRUNG
from taskspec.spec.model import Model, field_types
from taskspec.spec.objects import MODELS
from taskspec.spec.quantities import Constant, Entries, ForJoints
from taskspec.spec.robot import JointEncoder, Payload, Robot, Sensor, Tool
from taskspec.spec.servo import VARIED, Servo
from taskspec.text.units import Dimension


@dataclass(frozen=True, slots=True)
class VariedValue:
    """A value that may be otherwise.

    Attributes:
        dimensions: of its components.
        above: each has to be greater than this [SI]; None for no such bound.
        least: each has to be at least this [SI].
        most: each has to be at most this [SI].
    """

    dimensions: tuple[Dimension, ...]
    above: float | None = None
    least: float | None = None
    most: float | None = None


def targets(model: type[Model]) -> dict[str, VariedValue]:
    """The numbers that a model holds, by their keys; those of a model below it by `key.key`."""
    return dict(_targets(model))


def _targets(model: type[Model]) -> Iterator[tuple[str, VariedValue]]:
    for name, field in model.model_fields.items():
        below = [kind for kind in _kinds(field) if issubclass(kind, Model)]
        for kind in below:
            yield from ((f"{name}.{key}", each) for key, each in _targets(kind))
        for each in field_types(field):
            if isinstance(each, Constant):
                yield name, VariedValue((each.dimension,), each.above, each.least, each.most)
            elif isinstance(each, Entries):
                yield name, VariedValue(each.dimensions, each.above)
            elif isinstance(each, ForJoints):
                yield name, VariedValue((each.dimension,), least=0.0)


def _kinds(field: FieldInfo) -> Iterator[type]:
    """The classes that an annotation allows, without those that are annotated."""
    for each in (field.annotation, *get_args(field.annotation)):
        if isinstance(each, type):
            yield each


OBJECT = MappingProxyType(
    {kind: targets(model) for kind, model in MODELS.items()}
    # Of an equation only the spring has values, and one that is exact has none.
    | {EXACT + kind: {} for kind in SPRUNG}
)
"""Values of an object, by its kind."""

_SENSOR = ("delay", "noise.force", "noise.torque", "bias", "filter")


def _of_the_robot() -> Iterator[tuple[str, VariedValue]]:
    own, sensor = targets(Robot), targets(Sensor)
    yield from ((f"tool.{key}", targets(Tool)[key]) for key in ("mass", "com"))
    yield from ((key, own[key]) for key in ("joint_damping", "joint_friction"))
    yield from ((f"payload.{key}", each) for key, each in targets(Payload).items())
    yield from ((f"encoder.{key}", each) for key, each in targets(JointEncoder).items())
    yield from ((f"sensor.{key}", sensor[key]) for key in _SENSOR)
    yield from ((f"servo.{key}", targets(Servo)[key]) for key in VARIED)


ROBOT = MappingProxyType(dict(_of_the_robot()))
"""Values of the robot; those of joints are those of every joint."""
