"""The JSON Schema against `validate`: it rejects nothing that is read without an error.

Spoiled files that are read are held to it where they are examined; see `promises.held`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings

sys.path.insert(0, str(Path(__file__).parent))

from injuries import ROOT
from promises import SCHEMA, assert_accepted
from valid_tasks import tasks

from taskspec.spec import load_text
from taskspec.spec.schema_notes import NOTES

MODELS = {"Task": SCHEMA, **{k: v for k, v in SCHEMA["$defs"].items() if "pattern" not in v}}


@settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(tasks())
def test_valid_tasks_are_accepted(text: str) -> None:
    assert_accepted(load_text(text, "t.yaml", base=ROOT / "tasks"))


@pytest.mark.parametrize(
    "word",
    ["include: [", "use: pause", "on: door", "detent:", "repeat:", "when:", "then:", "track:"],
)
def test_valid_tasks_have_all_ways_of_writing(word: str) -> None:
    quickly = settings(max_examples=1500, phases=[Phase.generate], derandomize=True)
    assert word in find(tasks(), lambda text: word in text, settings=quickly)


def keys(form: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """The keys of a form, those of its variants and of forms inside included."""
    found = []
    for part in (form, *form.get("anyOf", ())):
        for name, field in part.get("properties", {}).items():
            found += [(name, field), *((f"{name}.{n}", f) for n, f in keys(field))]
    return found


def says(field: dict[str, Any], *what: str) -> bool:
    parts = (field, *field.get("anyOf", ()), field.get("additionalProperties") or {})
    return any(key in part for part in parts if isinstance(part, dict) for key in what)


@pytest.mark.parametrize("model", MODELS)
def test_every_key_has_a_title_a_description_and_an_example(model: str) -> None:
    for name, field in keys(MODELS[model]):
        if "$ref" in field:
            continue
        where = f"{model}.{name}"
        assert field.get("title"), where
        assert says(field, "description"), where
        shown = "such as" in json.dumps(field) or "A plain number" in json.dumps(field)
        assert says(field, "examples", "enum", "const", "$ref") or shown, where


def test_every_note_is_of_a_key() -> None:
    there = {f"{model}.{name}" for model, form in MODELS.items() for name, _ in keys(form)}
    assert sorted(set(NOTES) - there) == []


@pytest.mark.parametrize("note", [n for n, (_, examples) in NOTES.items() if examples])
def test_examples_fit_their_keys(note: str) -> None:
    model, name = note.split(".")
    field = dict(keys(MODELS[model]))[name]
    for example in NOTES[note][1]:
        form = jsonschema.Draft202012Validator(field | {"$defs": SCHEMA["$defs"]})
        assert form.is_valid(example), (note, example)


def test_words_are_enumerated() -> None:
    law = dict(keys(MODELS["Law"]))
    assert {"hybrid", "impedance"} <= set(law["kind"]["enum"])
    assert law["solver"]["enum"] == ["daqp", "osqp"]
