from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from taskspec.robot import builtin_names
from taskspec.schema import FILE_NAME, is_stale, schema_text
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, quantity_schema
from taskspec.spec.schema_meanings import MEANINGS
from taskspec.text.data import Map, to_data
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Source
from taskspec.text.units import MEASURES, UNITS, Dimension, usual_units
from taskspec.text.yaml import read as yaml_of

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
        "taskspec: 1\nrobot: {model: pnda}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nlimits: {force: 40}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nlimits: {force: 40 mm}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nstages: {a: {time: 2}}\n",
        "taskspec: 1\nrobot: {model: panda, tool: {mass: 10 kN}}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda, tool: {radius: 10}}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nparams: {press: 1 newton}\nstages: {a: {time: 1 s}}\n",
        "taskspec: 1\nrobot: {model: panda}\nstages: {a: {axes: {z: {force: -10}}, time: 1 s}}\n",
    ],
)
def test_editors_see_common_mistakes(text: str) -> None:
    with pytest.raises(jsonschema.ValidationError):
        VALIDATOR.validate(data_of(text))


def read(text: str, dimension: Dimension) -> bool:
    """Whether the language takes a text for a quantity of a dimension."""
    source = Source("q", f"value: {text}")
    data = to_data(yaml_of(source, Diagnostics("q")), Diagnostics("q"))
    assert isinstance(data, Map)
    context = ParseContext(Diagnostics("q"), data)
    Constant(dimension).read(data["value"], context)
    return not len(context.diagnostics)


@pytest.mark.parametrize(
    "dimension", [m.dimension for m in MEASURES], ids=[m.noun for m in MEASURES]
)
def test_a_lone_number_is_taken_with_the_units_that_fit(dimension: Dimension) -> None:
    """The schema and the language agree on every unit of the table, on 0 and on no unit."""
    form = jsonschema.Draft202012Validator(quantity_schema(dimension))
    units = dict.fromkeys(("", *UNITS, *usual_units(), "newton", "n"))
    assert len(units) > 40
    for unit in units:
        for number in ("40", "-0.5", "1e3", "0"):
            text = f"{number} {unit}".strip()
            datum = data_of(f"value: {text}")["value"]
            assert form.is_valid(datum) == read(text, dimension), text
            assert unit == "" or form.is_valid(f"{number}{unit}") == form.is_valid(text)


@pytest.mark.parametrize(
    "text",
    ["press", "-press", "2 * press", "10 kg*m/s^2", "press / 2 + 1 N", "(3 N)", "sqrt(4) * 1 N",
     "max(1 N, 2 N)", "10 N", "10  N ", "10N", "-press*2", "3*press", "0.0", "1 N + 2 N"],
)  # fmt: skip
def test_expressions_and_names_pass(text: str) -> None:
    assert QUANTITIES["Force"]["patternErrorMessage"].startswith("a force is needed here, in N")
    assert jsonschema.Draft202012Validator(QUANTITIES["Force"]).is_valid(text)


def test_editors_are_offered_nothing_that_is_wrong() -> None:
    """Names of a file, defaults in SI units and examples that are no quantities are not offered."""
    offered: list[object] = []

    def collect(form: object) -> None:
        if isinstance(form, dict):
            assert "default" not in form
            assert not {"properties", "required"} <= form.keys(), form.get("title")
            offered.extend(form.get("examples", ()))
        for part in form.values() if isinstance(form, dict) else form:
            if isinstance(part, dict | list):
                collect(part)

    collect(SCHEMA)
    assert "60 N" in offered
    for example in offered:
        assert isinstance(example, int | float) or re.search(r"\d.*[A-Za-z%]", str(example)), (
            example
        )
    assert SCHEMA["$defs"]["Robot"]["properties"]["model"]["anyOf"][0]["enum"] == [*builtin_names()]
    following = SCHEMA["$defs"]["Stage"]["properties"]["next"]["anyOf"][0]["anyOf"]
    assert following == [{"enum": ["end", "fail"]}, {"type": "string"}]


def fields(form: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    nested = [form, *form.get("anyOf", [])]
    return [pair for part in nested for pair in part.get("properties", {}).items()]


QUANTITIES = {name: form for name, form in SCHEMA["$defs"].items() if "pattern" in form}
MODELS = {"Task": SCHEMA, **{k: v for k, v in SCHEMA["$defs"].items() if k not in QUANTITIES}}


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
