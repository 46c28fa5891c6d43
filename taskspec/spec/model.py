"""The base of all models of a task file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    GetJsonSchemaHandler,
    ValidationInfo,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticCustomError

from taskspec.expression.spelling import other_word
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.nodes import Mapping as MappingNode
from taskspec.text.nodes import Scalar
from taskspec.text.suggest import closest, distance, suggestion
from taskspec.text.units import Dimension

if TYPE_CHECKING:
    from taskspec.spec.alias import Alias

register(
    {
        "TS020": "an unknown key",
        "TS022": "a value of the wrong kind",
        "TS026": "keys that do not go together",
    }
)

REPORTED = "reported"
"""Type of a pydantic error that is already in the diagnostics."""


class Model(BaseModel):
    """A mapping of a task file.

    Each class says in `noun` what it is, in `example` how it is written, in `reserved` which keys
    belong to the language but are not supported yet, in `advice` what takes the place of keys that
    people write and it does not have, in `aliases` which keys it reads in place of its own, in
    `composed` the JSON Schema of keys that are gone from the tree when it is read, in `expand`
    which short form it has (`short` is its JSON Schema), and in `rules` which keys go together.
    Rules see the raw mapping, so they hold whatever else is wrong.
    """

    # Most models are parts of a larger one: validators of their own are made at their first use.
    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, defer_build=True
    )

    noun: ClassVar[str] = "this"
    reserved: ClassVar[frozenset[str]] = frozenset()
    example: ClassVar[str] = ""
    advice: ClassVar[Mapping[str, str]] = {}
    aliases: ClassVar[Mapping[str, Alias]] = {}
    composed: ClassVar[Mapping[str, dict[str, Any]]] = {}
    short: ClassVar[dict[str, Any] | None] = None

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """The full form of a short form."""
        return data

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Reports keys that do not go together."""

    @classmethod
    def dimension_of(cls, key: str) -> Dimension:
        """The dimension of the quantity that a key holds, one for all entries of a list.

        Raises:
            KeyError: it holds none.
        """
        for each in field_types(cls.model_fields[key]):
            dimension = getattr(each, "dimension", None)
            if isinstance(dimension, Dimension):
                return dimension
        raise KeyError(key)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        found = handler(schema)
        full = handler.resolve_ref_schema(found)
        full.setdefault("properties", {}).update(
            {key: alias.json() for key, alias in cls.aliases.items()}
            | {key: dict(form) for key, form in cls.composed.items()}
        )
        if cls.short is not None and "anyOf" not in full:
            form = {key: full.pop(key) for key in list(full) if key not in ("title", "description")}
            full["anyOf"] = [cls.short, form]
        return found

    @model_validator(mode="before")
    @classmethod
    def _enter(cls, data: object, info: ValidationInfo) -> object:
        context: ParseContext | None = info.context
        if context is None:
            return data
        if isinstance(data, Map):
            data = cls._in_own_keys(data, context)
        data = cls.expand(data, context)
        if not isinstance(data, Map):
            message = f"{cls.noun} is a mapping of keys to values, this is {kind_of(data)}"
            hint = cls.example or f"keys: {', '.join(cls.model_fields)}"
            context.error("TS022", message, span_of(data), hint)
            raise PydanticCustomError(REPORTED, "reported")
        known = cls._known(data, context)
        cls.rules(known, context)
        return known

    @classmethod
    def _in_own_keys(cls, data: Map, context: ParseContext) -> Map:
        """The mapping with the model's own keys in place of others for them."""
        if not data.keys() & cls.aliases.keys():
            return data
        own = Map({key: value for key, value in data.items() if key not in cls.aliases})
        own.node = data.node
        for name, alias in cls.aliases.items():
            if name not in data:
                continue
            if alias.key in own:
                other = data.node.as_written(alias.key)
                message = f"'{other}' and '{name}' of {cls.noun} say the same thing"
                context.error("TS026", message, data.node.key_span(name), "keep one of the two")
            elif (value := alias.read(data[name], context)) is not None:
                own[alias.key] = value
                data.node.written[alias.key] = name
        return own

    @classmethod
    def _known(cls, data: Map, context: ParseContext) -> Map:
        """Reports and leaves out keys that the model does not have."""
        if all(key in cls.model_fields for key in data):
            return data
        known = Map()
        known.node = data.node
        for key, value in data.items():
            if key in cls.model_fields:
                known[key] = value
            elif key in cls.reserved:
                context.unsupported(key, data.node.key_span(key))
                context.quiet.add(id(data.node))
            else:
                hint = cls._instead_of(key, data, context)
                message = f"unknown key '{key}' in {cls.noun}"
                context.error("TS020", message, data.node.key_span(key), hint)
                context.quiet.add(id(data.node))
        return known

    @classmethod
    def advice_on(cls, key: str, data: Map) -> str:  # noqa: ARG003
        """What takes the place of a key in a mapping; empty where nothing particular does."""
        return cls.advice.get(key, "")

    @classmethod
    def _instead_of(cls, key: str, data: Map, context: ParseContext) -> str:
        """What to write in place of a key that the model does not have."""
        if advice := cls.advice_on(key, data):
            return advice
        keys = [*cls.model_fields, *cls.aliases, *cls.composed]
        if meant := other_word(key, keys):
            return meant
        near = closest(key, keys)
        level = context.level_of(key, cls)
        if level and (near is None or distance(key, near) > 1):
            return level
        return suggestion(key, keys, "keys")


def complete(data: Map, context: ParseContext) -> bool:
    """Whether the absence of a key in a mapping means that the user left it out."""
    return not data.node.broken and id(data.node) not in context.quiet


def mapping(value: object) -> Map:
    """A datum if it is a mapping, else an empty mapping."""
    return value if isinstance(value, Map) else Map()


def short_form(data: object, key: str) -> object:
    """`{key: data}` for a scalar datum, anything else unchanged."""
    node = getattr(data, "node", None)
    if not isinstance(node, Scalar):
        return data
    full = Map({key: data})
    full.node = MappingNode(node.span, flow=True, entries={key: (node, node)})
    return full


def field_types(field: FieldInfo) -> Iterator[object]:
    """What reads a field: the metadata of its annotation, and of those that it is a union of."""
    nested = (
        get_args(each)[1:] for each in get_args(field.annotation) if get_origin(each) is Annotated
    )
    yield from chain(field.metadata, *nested)
