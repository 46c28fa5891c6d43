"""At which level of a file a key belongs that stands at another one."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import get_args

from taskspec.motion.paths import PATHS
from taskspec.spec.axis import AxesForm, Rotation, Translation
from taskspec.spec.bushing import Bushing
from taskspec.spec.control import Control
from taskspec.spec.equation import EquationObject
from taskspec.spec.frame import Frame
from taskspec.spec.law import ForceGains, Law, StiffnessEstimate
from taskspec.spec.limits import Limits
from taskspec.spec.mechanism import Hinge, Screw, Slide
from taskspec.spec.model import Model
from taskspec.spec.path import Path
from taskspec.spec.reward import Reward
from taskspec.spec.robot import Noise, Robot, Sensor, Start, Tool
from taskspec.spec.stage import Stage
from taskspec.spec.sweep import Sweep
from taskspec.spec.task import Task
from taskspec.spec.world import Shape
from taskspec.text.units import alternatives

#: More places than this are read by nobody.
_SHOWN = 3

_OBJECT = "world.NAME."

_MODELS: tuple[tuple[str, type[Model]], ...] = (
    ("", Task),
    ("robot.", Robot),
    ("robot.tool.", Tool),
    ("robot.start.", Start),
    ("robot.sensor.", Sensor),
    ("stages.NAME.", Stage),
    ("stages.NAME.axes.", AxesForm),
    ("stages.NAME.axes.z.", Translation),
    ("stages.NAME.axes.rz.", Rotation),
    ("stages.NAME.path.", Path),
    (_OBJECT, Shape),
    (_OBJECT, Hinge),
    (_OBJECT, Slide),
    (_OBJECT, Screw),
    (_OBJECT, EquationObject),
    (_OBJECT, Bushing),
    ("frames.NAME.", Frame),
    ("law.", Law),
    ("limits.", Limits),
    ("control.", Control),
    ("sweep.", Sweep),
    ("reward.", Reward),
    ("law.force.", ForceGains),
    ("law.estimate.", StiffnessEstimate),
    ("robot.sensor.noise.", Noise),
)
"""Models of a file and the paths at which they stand, the outer ones first."""


def level_of(key: str, model: type[Model]) -> str:
    """Where a key belongs that a model does not have; empty where nothing has it.

    Args:
        key: the key.
        model: in which it stands.
    """
    if model in _curves().values():
        # The keys of a curve are few, and say more than where else there is one of that name.
        return ""
    owners = _keys().get(key, ())
    if any(path == _OBJECT and owner is model for path, owner in _MODELS):
        kinds = ["a shape" if o is Shape else o.noun for path, o in owners if path == _OBJECT]
        if kinds:
            return f"it is a key of {alternatives(kinds)}"
    places = list(dict.fromkeys(f"{path}{key}" for path, _ in owners))
    if not places:
        return ""
    if places[0] == key:
        return f"'{key}' belongs to the top level of the file"
    return f"it belongs at {alternatives(places[:_SHOWN])}"


@cache
def _keys() -> dict[str, list[tuple[str, type[Model]]]]:
    """By key the places that it may have."""
    found: dict[str, list[tuple[str, type[Model]]]] = {}
    for path, model in _all():
        for key in (*model.model_fields, *model.aliases, *model.composed):
            found.setdefault(key, []).append((path, model))
    return found


def _all() -> Iterator[tuple[str, type[Model]]]:
    yield from _MODELS
    for name, kind in _curves().items():
        yield f"stages.NAME.path.{name}.", kind


@cache
def _curves() -> dict[str, type[Model]]:
    """The models of the kinds of paths, by the key of a path."""
    kinds = {name: get_args(Path.model_fields[name].annotation) for name in PATHS}
    return {
        name: kind
        for name, options in kinds.items()
        for kind in options
        if isinstance(kind, type) and issubclass(kind, Model)
    }
