from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from taskspec.spec.schema import FILE_NAME, is_stale, schema_text
from taskspec.spec.schema_meanings import MEANINGS

sys.path.insert(0, str(Path(__file__).parent.parent / "corpus"))

from reading import data_of

ROOT = Path(__file__).parent.parent.parent
GOOD = sorted((ROOT / "tests" / "corpus" / "ok").glob("*.yaml")) + sorted(
    (ROOT / "tasks").glob("*.yaml")
)
SCHEMA = json.loads(schema_text())
#: `jsonschema.validate` would check the schema itself anew for each file.
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def test_file_in_the_repository_is_not_stale() -> None:
    assert not is_stale(ROOT / "schemas" / FILE_NAME)


def test_stale_or_absent_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / FILE_NAME
    assert is_stale(path)
    path.write_text(schema_text(), encoding="utf-8")
    assert not is_stale(path)
    path.write_text(schema_text() + " ", encoding="utf-8")
    assert is_stale(path)


def test_schema_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("path", GOOD, ids=lambda p: p.stem)
def test_schema_rejects_nothing_that_loads(path: Path) -> None:
    VALIDATOR.validate(data_of(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "text",
    [
        "taskspec: 2\nrobot: {model: panda}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda, modle: x}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nstages: {a: {axes: {rz: {force: 3 N}}, time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nstages: {a: {axes: {w: hold}, time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nlaw: hybird\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nworld: {a: {shape: plan}}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda, base: {xyz: [0, 0]}}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nstages: {a: {time: 1 s}}\n",
    ],
)
def test_editors_see_common_mistakes(text: str) -> None:
    with pytest.raises(jsonschema.ValidationError):
        VALIDATOR.validate(data_of(text))


def fields(form: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    nested = [form, *form.get("anyOf", [])]
    return [pair for part in nested for pair in part.get("properties", {}).items()]


MODELS = {"Task": SCHEMA, **SCHEMA["$defs"]}


@pytest.mark.parametrize("model", MODELS)
def test_every_field_says_what_it_is(model: str) -> None:
    assert MODELS[model]["description"]
    assert fields(MODELS[model])
    for name, field in fields(MODELS[model]):
        # A field that has its model's title refers to it for both.
        assert "$ref" in field or field["title"] not in ("", name)


def keys_of(form: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """The keys of a form and of its variants, and of what is written out inside of them."""
    found = []
    for name, field in fields(form):
        found += [(name, field), *((f"{name}.{n}", f) for n, f in keys_of(field))]
    return found


def leaf(field: dict[str, Any]) -> bool:
    """Whether a key is one of a gain's axes, which the gain itself describes."""
    return field.get("title", "").startswith(("Along ", "About ", "All "))


@pytest.mark.parametrize("model", MODELS)
def test_what_an_editor_shows_of_a_key_says_what_it_is(model: str) -> None:
    """A title, a description that is more than the title and a unit, and what may be written."""
    for name, field in keys_of(MODELS[model]):
        where = f"{model}.{name}"
        title, said = field.get("title", ""), field.get("description", "")
        assert title[:1].isupper() or title[:3] in ("x, ", "q1 "), where
        written = json.dumps(field)
        shown = ('"examples"', '"enum"', '"const"', "$ref", "such as", "A plain number")
        assert any(s in written for s in shown), where
        if not leaf(field):
            assert len(said.split()) >= 3, where
            assert said.rstrip(".").lower() != title.lower(), where
            assert not said.startswith(("A plain", "An angle (", "A length (", "A force (")), where


def test_every_word_that_fits_is_enumerated() -> None:
    """What takes one of a few words offers them all."""
    offered = {
        f"{model}.{name}": field["enum"]
        for model, form in MODELS.items()
        for name, field in keys_of(form)
        if "enum" in field
    }
    assert offered["Shape.shape"] == [
        "plane", "box", "cylinder", "sphere", "hole", "slot", "groove", "mesh"
    ]  # fmt: skip
    assert offered["Tool.shape"] == ["sphere", "cylinder", "box"]
    assert offered["Hinge.knob"] == ["free", "fixed"]
    assert offered["Sensor.at"] == ["wrist", "contact"]
    assert {"hybrid", "parallel", "impedance", "stiffness"} <= set(offered["Law.kind"])
    assert offered["Law.solve"] == ["closed-form", "qp"]
    assert offered["Frame.point"] == ["origin"]


def test_every_meaning_is_of_a_key() -> None:
    there = {model: {name for name, _ in keys_of(form)} for model, form in MODELS.items()}
    strange = {f"{m}.{n}" for m, names in MEANINGS.items() for n in names if n not in there[m]}
    # One list of keys serves all mechanisms, and one both kinds of axes.
    assert strange == {"Hinge.mass", "Slide.inertia"}


@pytest.mark.parametrize("model", MEANINGS)
def test_examples_of_meanings_fit_their_keys(model: str) -> None:
    for name, field in keys_of(MODELS[model]):
        form = jsonschema.Draft202012Validator(field | {"$defs": SCHEMA["$defs"]})
        for example in MEANINGS[model].get(name, ("", ()))[1]:
            assert form.is_valid(example), (model, name, example)
