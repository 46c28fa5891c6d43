"""`world`: which kind of object a mapping declares."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from taskspec.spec.bushing import Bushing
from taskspec.spec.equation import EquationObject, JointEquation, RotationEquation, kind_of_text
from taskspec.spec.fields import EXACT, MECHANISMS
from taskspec.spec.mechanism import OF_KIND, Hinge, Mechanism, Screw, Slide
from taskspec.spec.model import Model, mapping
from taskspec.spec.world import Shape
from taskspec.text.data import Map

Object = Shape | EquationObject | Mechanism | Bushing

MODELS: dict[str, type[Model]] = {
    "shape": Shape,
    "equation": EquationObject,
    "rotation equation": RotationEquation,
    "joint equation": JointEquation,
    **OF_KIND,
    "bushing": Bushing,
}
"""What an object of `world` is read as, by its kind."""


def kind_of_object(data: object) -> str:
    """The kind of a raw object, as `signals.OBJECT` names it; `shape` by default."""
    if not isinstance(data, Map):
        return "shape"
    if "bushing" in data:
        return "bushing"
    if "equation" in data:
        exact = EXACT if data.get("stiffness") == "exact" else ""
        return exact + kind_of_text(data["equation"])
    if "mechanism" in data:
        kind = data["mechanism"]
        return str(kind) if isinstance(kind, str) and kind in MECHANISMS else "hinge"
    # A slide that is called a shape is read as the slide that is meant.
    shape = data.get("shape")
    return str(shape) if isinstance(shape, str) and shape in MECHANISMS else "shape"


class ByKind:
    """Reads an object as the model of its keys."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        choices = {kind: handler.generate_schema(model) for kind, model in MODELS.items()}
        return core_schema.tagged_union_schema(choices, discriminator=_tag)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        found = handler(schema)
        return {"anyOf": found.get("oneOf", [])} if "oneOf" in found else found


def _tag(value: Any) -> str:
    if isinstance(value, BaseModel):
        return next(kind for kind, model in MODELS.items() if type(value) is model)
    return kind_of_object(value).removeprefix(EXACT)


def kinds_of(world: object) -> dict[str, str]:
    """Kinds of all objects of a raw `world`, by name."""
    return {name: kind_of_object(value) for name, value in mapping(world).items()}


def shapes(world: Mapping[str, Object]) -> dict[str, Shape]:
    """The shapes of a world, those on mechanisms where they are with these at coordinate 0."""
    found = {name: o for name, o in world.items() if isinstance(o, Shape)}
    for name, shape in found.items():
        carrier = world.get(shape.on) if shape.on is not None else None
        if isinstance(carrier, Mechanism):
            found[name] = shape.carried_by(carrier)
    return found


def equations(world: Mapping[str, Object]) -> dict[str, EquationObject]:
    """The equations of a world."""
    return {name: o for name, o in world.items() if isinstance(o, EquationObject)}


def bushings(world: Mapping[str, Object]) -> dict[str, Bushing]:
    """The bushings of a world."""
    return {name: o for name, o in world.items() if isinstance(o, Bushing)}


def mechanisms(world: Mapping[str, Object]) -> dict[str, Mechanism]:
    """The mechanisms of a world."""
    return {name: o for name, o in world.items() if isinstance(o, Mechanism)}


__all__ = [
    "MODELS",
    "ByKind",
    "Hinge",
    "Object",
    "Screw",
    "Slide",
    "bushings",
    "equations",
    "mechanisms",
    "shapes",
]
