"""`expect`: what counts as success."""

from __future__ import annotations

import re
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.phrases import is_condition, meant_by
from taskspec.text.data import Items, Map, Text

_LONGEST_NAME = 64
NAME_PATTERN = f"^[A-Za-z0-9][A-Za-z0-9_-]{{0,{_LONGEST_NAME - 1}}}$"
"""What a name of an expectation is."""
_NAME = re.compile(NAME_PATTERN[:-1] + r"\Z")


@dataclass(frozen=True, slots=True)
class Expectation:
    """A condition on the whole run, or on one stage of it.

    Attributes:
        expression: the checked condition.
        text: as written, on one line.
        name: that the file gives it; empty in a list.
    """

    expression: Expression
    text: str
    name: str = ""

    @property
    def title(self) -> str:
        """The condition, and its name before it."""
        return titled(self.name, self.text)


def titled(name: str, text: str) -> str:
    """The text of an expectation, and its name, if it has one, before it."""
    return f"{name}: {text}" if name else text


def _condition(entry: object, context: ParseContext) -> Expression | None:
    if isinstance(entry, Map) and len(entry) == 1:
        (key,) = entry
        message = "a condition is needed here, this is a mapping"
        meant = meant_by(f"{key} < {entry[key]}", context)
        hint = f"write {meant or f'the relation instead of the colon: {key} < …'}"
        context.error("TS022", message, span_of(entry), hint)
        return None
    said = " ".join(entry.split()) if isinstance(entry, Text) else ""
    if said and (condition := meant_by(said, context)) and not is_condition(said, context):
        message = f"'{said}' is no expression"
        context.error("TS101", message, span_of(entry), f"write {condition}")
        return None
    return values.expression(entry, None, ScopeKind.EXPECT, context)


def _check_name(name: str, value: Map, context: ParseContext) -> None:
    """Reports a name that cannot be given, which may be a condition in its place."""
    if _NAME.match(name):
        return
    rule = "a name is letters, digits, '-' and '_', and begins with a letter or a digit"
    near = re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-_")[:_LONGEST_NAME]
    hint = f"{rule}: {near}" if _NAME.match(near) and len(name) <= _LONGEST_NAME else rule
    if any(sign in name for sign in "<>("):
        hint = f"{rule}; conditions without names are a list, each begun with '- '"
    message = f"'{name}' cannot be the name of an expectation"
    context.error("TS125", message, value.node.key_span(name), hint)


def _meant(name: str, entry: object, context: ParseContext) -> str:
    """The condition that `max force: 30 N` stands for; empty where it is none of that kind."""
    bound = isinstance(entry, Text) and not any(sign in entry for sign in "<>(")
    return meant_by(f"{name} < {entry}", context) if bound else ""


@dataclass(frozen=True)
class Expectations(FieldType):
    """Conditions: a list, or a mapping of names to them."""

    def read(self, value: object, context: ParseContext) -> tuple[Expectation, ...]:
        """The expectations in the order in which they are written."""
        if not isinstance(value, Items | Map):
            message = f"conditions are needed here, this is {kind_of(value)}"
            hint = "begin each with '- ', or with a name as 'soft-touch: '"
            if isinstance(value, Text) and (meant := meant_by(" ".join(value.split()), context)):
                hint = f"write expect: [{meant}]"
            context.error("TS022", message, span_of(value), hint)
            return ()
        named = value if isinstance(value, Map) else Map()
        phrases = {name: m for name, e in named.items() if (m := _meant(name, e, context))}
        for name in named:
            if name in phrases:
                message = f"'{name}: {named[name]}' is no condition"
                hint = f"write {name.replace(' ', '-')}: {phrases[name]}"
                context.error("TS101", message, named.node.key_span(name), hint)
            else:
                _check_name(name, named, context)
        if not context.stages:
            return ()  # What is expected of stages that are not there is no further mistake.
        entries = value.items() if isinstance(value, Map) else (("", entry) for entry in value)
        found = ((n, _condition(entry, context)) for n, entry in entries if n not in phrases)
        return tuple(Expectation(e, str(e), name) for name, e in found if e is not None)

    def json(self) -> dict[str, Any]:
        """Describes the list and the mapping."""
        condition = {"type": "string"}
        named = {"type": "object", "propertyNames": {"pattern": NAME_PATTERN}}
        return {
            "anyOf": [
                {"type": "array", "items": condition},
                {**named, "additionalProperties": condition},
            ]
        }
