"""What the language's schema says of the keys and values at a path."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.schema import schema_text
from taskspec.shapes import SHAPES, size_keys, tool_shapes
from taskspec.spec.alias import SAME, Diameter
from taskspec.text.units import Dimension, parse_unit

Json = Mapping[str, Any]
Step = str | int

_UNIT = re.compile(r"\(([^()]*)\), such as '")
_ALTERNATIVES = ("anyOf", "oneOf", "allOf")


@dataclass(frozen=True, slots=True)
class KeyFacts:
    """A key, as the schema has it.

    Attributes:
        name: of the key.
        title: a few words.
        about: a sentence; empty where there is none.
        forms: the alternatives of its value.
    """

    name: str
    title: str
    about: str
    forms: tuple[Json, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """The words that its value may be."""
        found = [str(w) for form in self.forms for w in form.get("enum", ())]
        found += [str(form["const"]) for form in self.forms if "const" in form]
        if any("boolean" in _types(form) and "string" not in _types(form) for form in self.forms):
            found += ["true", "false"]
        return tuple(dict.fromkeys(found))

    @property
    def examples(self) -> tuple[Any, ...]:
        """Values that it may have."""
        return tuple(value for form in self.forms for value in form.get("examples", ()))

    @property
    def dimensions(self) -> tuple[Dimension, ...]:
        """The dimensions of quantities that its value may be."""
        texts = [self.about, *(str(form.get("description", "")) for form in self.forms)]
        units = [unit for text in texts for unit in _UNIT.findall(text)]
        return tuple(dict.fromkeys(parse_unit(unit).dimension for unit in units))


@cache
def _schema() -> Json:
    found: Json = json.loads(schema_text())
    return found


def keys_at(path: Sequence[Step], present: Mapping[str, str]) -> dict[str, KeyFacts]:
    """The keys that a mapping at a path may have beside those that it has, by name.

    Args:
        path: keys and indices that lead to it.
        present: keys that it has, each with the word behind it: of several kinds of mapping those
            count that have all of them with such words.
    """
    forms = [form for form in forms_at(path) if "properties" in form]
    fitting = [form for form in forms if present.keys() <= form["properties"].keys()]
    chosen = [form for form in fitting if all(_takes(form, *pair) for pair in present.items())]
    taken = {*present, *(other for name in present for other in SAME.get(name, ()))}
    taken |= _foreign_sizes(path, present.get("shape", ""))
    found: dict[str, KeyFacts] = {}
    for form in chosen or fitting or forms:
        for name, entry in form["properties"].items():
            if name not in taken:
                found.setdefault(name, _facts(name, entry))
    return found


def _takes(form: Json, name: str, word: str) -> bool:
    """Whether a key may have a word, as far as it takes a few words alone."""
    words = form["properties"][name].get("enum", ())
    return not words or not word or word in words


def _foreign_sizes(path: Sequence[Step], shape: str) -> set[str]:
    """Keys of the sizes that a shape does not have."""
    if path[-1:] == ("tool",) and shape in tool_shapes():
        has = {*tool_shapes()[shape].tool_keys, "length"}
    elif path[:1] == ("world",) and shape in SHAPES:
        has = {key.name for key in SHAPES[shape].keys}
    else:
        return set()
    return {*size_keys(), *(() if Diameter.key in has else ("diameter",))} - has


def key_at(path: Sequence[Step]) -> KeyFacts | None:
    """The key that a path ends with; None where the language has none there."""
    if not path:
        return None
    for form in forms_at(path[:-1]):
        entry = _below(form, path[-1])
        if entry is not None:
            return _facts(str(path[-1]), entry)
    return None


def forms_at(path: Sequence[Step]) -> list[Json]:
    """The alternatives of the value at a path."""
    found = list(_forms(_schema()))
    # A template is a stage with holes.
    for step in ("stages", *path[1:]) if path[:1] == ("templates",) else path:
        below = [_below(form, step) for form in found]
        found = [form for entry in below if entry is not None for form in _forms(entry)]
    return found


def _facts(name: str, entry: Json) -> KeyFacts:
    return KeyFacts(
        name, str(entry.get("title", "")), str(entry.get("description", "")), tuple(_forms(entry))
    )


def _below(form: Json, step: Step) -> Json | None:
    if isinstance(step, int):
        items = form.get("prefixItems", ())
        entry = items[step] if step < len(items) else form.get("items")
    else:
        entry = form.get("properties", {}).get(step, form.get("additionalProperties"))
    return entry if isinstance(entry, Mapping) else None


def _forms(entry: Json) -> Iterator[Json]:
    """The alternatives that a schema stands for, references followed."""
    if "$ref" in entry:
        name = str(entry["$ref"]).rpartition("/")[2]
        beside = {k: v for k, v in entry.items() if k in ("examples", "description", "title")}
        for form in _forms(_schema()["$defs"][name]):
            yield {**form, **beside}
        return
    nested = [form for word in _ALTERNATIVES for form in entry.get(word, ())]
    if not nested or "properties" in entry:
        yield entry
    else:
        for form in nested:
            yield from _forms(form)
        if "examples" in entry:
            yield {"examples": entry["examples"]}


def _types(form: Json) -> list[str]:
    types = form.get("type", [])
    return [types] if isinstance(types, str) else list(types)
