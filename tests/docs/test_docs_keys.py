"""The tables of keys list every key of every model, with its unit and its default."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

import pytest
from documents import LANGUAGE, first_words, models_of, table, units_written, value, words
from pydantic.json_schema import SkipJsonSchema

from taskspec.spec import Law, Robot, Task
from taskspec.spec.adapt import Adapt, PayloadAdaptation
from taskspec.spec.axis import Rotation, Translation
from taskspec.spec.bushing import Bushing, SixBySix
from taskspec.spec.control import Control
from taskspec.spec.disturbance_observer import DisturbanceObserver
from taskspec.spec.equation import EquationObject, JointEquation, RotationEquation
from taskspec.spec.fault import Fault
from taskspec.spec.followed import Followed
from taskspec.spec.frame import Frame
from taskspec.spec.gains import GainField
from taskspec.spec.gripper import GripCommand, Gripper
from taskspec.spec.joint_expressions import JointExpressions
from taskspec.spec.joint_friction import FrictionCompensation
from taskspec.spec.joint_targets import JointTargets
from taskspec.spec.joint_velocity import VelocitySource
from taskspec.spec.law import ForceGains, StiffnessEstimate
from taskspec.spec.limits import Limits
from taskspec.spec.mechanism import (
    AngularDetent,
    Hinge,
    LinearDetent,
    Screw,
    Slide,
)
from taskspec.spec.model import Model
from taskspec.spec.path import Path
from taskspec.spec.protection import (
    ProtectedJoints,
    ProtectedTip,
    ProtectedTurn,
    Protection,
    Reflex,
    SensorRange,
)
from taskspec.spec.quantities import (
    Constant,
    EitherQuantity,
    Entries,
    ForJoints,
    Formula,
    IntervalAroundZero,
    PositiveInterval,
    QuantityInterval,
    QuantityList,
)
from taskspec.spec.reward import Reward
from taskspec.spec.robot import Flange, JointEncoder, Noise, Payload, Pose, Sensor, Start, Tool
from taskspec.spec.servo import Servo
from taskspec.spec.set_point import SetPoint
from taskspec.spec.sliding import Sliding
from taskspec.spec.stage import Branch, Stage, Within
from taskspec.spec.sweep import Sweep
from taskspec.spec.tank import Tank
from taskspec.spec.world import Motion, Shape
from taskspec.text.units import ANGLE

KEYS: dict[str, tuple[type[Model], ...]] = {
    "task": (Task,),
    "robot": (Robot,),
    "robot.flange": (Flange,),
    "robot.base": (Pose,),
    "robot.tool": (Tool,),
    "robot.start": (Start,),
    "robot.sensor": (Sensor,),
    "robot.encoder": (JointEncoder,),
    "robot.sensor.noise": (Noise,),
    "robot.servo": (Servo,),
    "robot.protection": (Protection,),
    "robot.protection.joints": (ProtectedJoints,),
    "robot.protection.tip": (ProtectedTip,),
    "robot.protection.turn": (ProtectedTurn,),
    "robot.protection.wrenches": (Reflex, SensorRange),
    "world": (Shape,),
    "motion": (Motion,),
    "equation": (EquationObject, RotationEquation, JointEquation),
    "bushing": (Bushing,),
    "mechanism": (Hinge, Slide, Screw),
    "mechanism.detent": (AngularDetent, LinearDetent),
    "constraints": (SetPoint,),
    "frames": (Frame,),
    "stages": (Stage,),
    "within": (Within,),
    "next": (Branch,),
    "axes": (Translation, Rotation),
    "path": (Path,),
    "law": (Law,),
    "law.force": (ForceGains,),
    "law.sliding": (Sliding,),
    "law.disturbance_observer": (DisturbanceObserver,),
    "law.adapt": (Adapt,),
    "law.adapt.payload": (PayloadAdaptation,),
    "law.estimate": (StiffnessEstimate,),
    "law.tank": (Tank,),
    "limits": (Limits,),
    "control": (Control,),
    "control.velocity": (VelocitySource,),
    "control.friction": (FrictionCompensation,),
    "payload": (Payload,),
    "sweep": (Sweep,),
    "reward": (Reward,),
    "fault": (Fault,),
    "gripper": (Gripper,),
    "grip": (GripCommand,),
}


def kinds(annotation: object) -> Iterator[object]:
    """What reads a field, wherever it stands in the field's type."""
    for part in get_args(annotation):
        if isinstance(
            part,
            Constant
            | Entries
            | EitherQuantity
            | QuantityInterval
            | QuantityList
            | JointTargets
            | JointExpressions
            | ForJoints
            | GainField
            | Formula
            | Followed
            | IntervalAroundZero
            | PositiveInterval
            | SixBySix,
        ):
            yield part
        else:
            yield from kinds(part)


def keys_of(model: type[Model]) -> set[str]:
    """The keys that a file may have; fields that no schema shows have other names there."""
    hidden = {
        key
        for key, field in model.model_fields.items()
        if any(isinstance(part, SkipJsonSchema) for part in field.metadata)
    }
    return (model.model_fields.keys() | model.composed.keys()) - hidden


def units_needed(model: type[Model], key: str) -> set[object]:
    """Dimensions of a field; `condition` for a condition; empty for anything else."""
    field = model.model_fields[key]
    found: set[object] = set()
    for kind in [*field.metadata, *kinds(field.annotation)]:
        if isinstance(kind, Formula):
            found.add(kind.dimension or "condition")
        elif isinstance(kind, Followed):
            found.add(kind.expression.dimension)
        elif isinstance(kind, JointTargets):
            found.update({kind.one.dimension, kind.one.other})
        elif isinstance(kind, EitherQuantity | JointExpressions):
            found.update({kind.dimension, kind.other})
        elif isinstance(kind, QuantityList):
            found.update({kind.dimension, kind.other} - {None})
        elif isinstance(
            kind,
            Constant | ForJoints | IntervalAroundZero | PositiveInterval | QuantityInterval,
        ):
            found.add(kind.dimension)
        elif isinstance(kind, Entries):
            found.update(kind.dimensions)
        elif isinstance(kind, SixBySix):
            found.update(kind.linear.on(rotation=turns) for turns in (False, True))
            found.update({kind.coupling, kind.coupling / ANGLE})
        elif isinstance(kind, GainField):
            found.update(kind.dimension.on(rotation=turns) for turns in (False, True))
    return found


@pytest.mark.parametrize("name", KEYS)
def test_keys_are_those_of_the_model(name):
    expected = {key for model in KEYS[name] for key in keys_of(model)}
    assert set(first_words(LANGUAGE, f"keys: {name}")) == expected


@pytest.mark.parametrize("name", KEYS)
def test_units_are_those_of_the_model(name):
    for row in table(LANGUAGE, f"keys: {name}"):
        (key,) = words(row[0])
        having = [model for model in KEYS[name] if key in model.model_fields]
        needed = {d for model in having for d in units_needed(model, key)}
        assert units_written(row[1]) == needed, key


@pytest.mark.parametrize("name", KEYS)
def test_defaults_are_those_of_the_model(name):
    for row in table(LANGUAGE, f"keys: {name}"):
        (key,) = words(row[0])
        if any(key in model.composed for model in KEYS[name]):
            continue
        field = next(m.model_fields[key] for m in KEYS[name] if key in m.model_fields)
        if field.is_required():
            assert row[2].startswith("required"), key
        elif isinstance(field.default, float):
            assert value(words(row[2])[0]) == field.default, key
        elif isinstance(field.default, str) and key != "name":
            assert words(row[2])[0] == field.default, key


def test_no_model_is_left_out():
    listed = {model for models in KEYS.values() for model in models}
    # What several of them have in common.
    listed |= {base for model in listed for base in model.__mro__}
    shown = {m for m in models_of(Model) if m.__module__.startswith("taskspec.spec.")}
    left_out = {model.__name__ for model in shown - listed}
    # Forms of one key, written out in the row of that key, with their base; and the six axes.
    assert left_out == {"Line", "Arc", "Lissajous", "Raster", "Spiral", "Waypoints", "AxesForm",
                        "_PathKeys"}  # fmt: skip
