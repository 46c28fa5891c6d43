from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from taskspec.spec.schema import FILE_NAME, is_stale, schema_text, write_schema

sys.path.insert(0, str(Path(__file__).parent.parent / "corpus"))

from reading import data_of

ROOT = Path(__file__).parent.parent.parent
GOOD = sorted((ROOT / "tests" / "corpus" / "ok").glob("*.yaml")) + sorted(
    (ROOT / "tasks").glob("*.yaml")
)
SCHEMA = json.loads(schema_text())


def test_file_in_the_repository_is_not_stale() -> None:
    assert not is_stale(ROOT / "schemas" / FILE_NAME)


def test_stale_or_absent_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / FILE_NAME
    assert is_stale(path)
    assert write_schema(tmp_path) == path
    assert not is_stale(path)
    path.write_text(schema_text() + " ", encoding="utf-8")
    assert is_stale(path)


def test_schema_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("path", GOOD, ids=lambda p: p.stem)
def test_schema_rejects_nothing_that_loads(path: Path) -> None:
    jsonschema.validate(data_of(path.read_text(encoding="utf-8")), SCHEMA)


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
        jsonschema.validate(data_of(text), SCHEMA)


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
