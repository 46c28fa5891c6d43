"""The JSON Schema of task files, for editors; generated from the models."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taskspec.robot.library import builtin_names
from taskspec.spec.schema_notes import annotate
from taskspec.spec.task import VERSION, Task
from taskspec.spec.truth import FAULTS
from taskspec.text.data import written
from taskspec.text.units import split_quantity

FILE_NAME = f"taskspec-{VERSION}.schema.json"
_ID = f"urn:taskspec:schema:{VERSION}"
#: What `robot.model` may be beside a built-in name: a file, or PACKAGE:NAME.
_OTHER_ROBOT = r"[./\\:]"
#: What editors would offer as it stands: an example's name, a default in SI units.
_NEVER = ("examples", "default")
#: What a quantity consists of in the schema; see `spec.quantities.quantity_schema`.
_OF_QUANTITY = ("type", "pattern", "patternErrorMessage", "if", "then")


def schema_text() -> str:
    """The JSON Schema as the text of its file.

    It rejects nothing that `validate` accepts; what only the compiler can know, it lets pass.
    Editors offer what stands in it, and so nothing does that is right in some files alone:
    examples of names stand in descriptions, as do defaults.
    """
    generated = tidy(Task.model_json_schema())
    # It stands in a list that is read by hand.
    faults = generated["properties"]["truth"]["properties"][FAULTS]
    generated["$defs"]["Fault"] = faults["items"]
    faults["items"] = {"$ref": "#/$defs/Fault"}
    for name, form in {"Task": generated, **generated["$defs"]}.items():
        annotate(name, form)
    model = generated["$defs"]["Robot"]["properties"]["model"]
    del model["type"]
    model["anyOf"] = [
        {"enum": list(builtin_names())},
        {"type": "string", "pattern": _OTHER_ROBOT},
    ]
    # A param may stand for any value of a template, which is read where a stage uses it.
    generated["properties"]["templates"]["additionalProperties"]["properties"] |= {
        key: {word: stage[word] for word in ("title", "description") if word in stage}
        for key, stage in generated["$defs"]["Stage"]["properties"].items()
        if key not in ("use", "with")
    }
    # What a file needs may come from one that it includes.
    generated["required"].remove("robot")
    generated["anyOf"] = [{"required": ["robot"]}, {"required": ["include"]}]
    quantities: dict[str, Any] = {}
    found = _for_editors(generated, quantities)
    found["$defs"] |= dict(sorted(quantities.items()))
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": _ID,
        "title": f"A task of the taskspec language, version {VERSION}",
    }
    return json.dumps(head | {k: v for k, v in found.items() if k not in head}, indent=2) + "\n"


def is_stale(path: Path) -> bool:
    """Whether a file is absent or differs from the schema of these models."""
    try:
        return path.read_text(encoding="utf-8") != schema_text()
    except FileNotFoundError:
        return True


def tidy(value: Any) -> Any:
    """Leaves out what is true of Python but not of a file: null, and defaults made of it."""
    if isinstance(value, list):
        return [tidy(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    choices = [c for c in value.get("anyOf", []) if c != {"type": "null"}]
    rest = {key: entry for key, entry in value.items() if key != "anyOf"}
    if "default" in rest and (rest["default"] is None or isinstance(rest["default"], dict)):
        del rest["default"]
    if len(choices) == 1:
        rest = choices[0] | rest
    elif choices:
        rest["anyOf"] = choices
    if isinstance(rest.get("description"), str):
        rest["description"] = rest["description"].partition("\n\n")[0]
    if "properties" in rest:
        never = {"type": "null"}
        rest["properties"] = {
            name: entry
            for name, entry in rest["properties"].items()
            if {k: v for k, v in entry.items() if k not in ("default", "title")} != never
        }
    return {key: tidy(entry) for key, entry in rest.items()}


def _for_editors(value: Any, quantities: dict[str, Any]) -> Any:
    """The same schema as editors take it, with quantities by reference.

    Args:
        value: of the schema.
        quantities: where definitions of quantities are collected, by name.
    """
    if isinstance(value, list):
        return [_for_editors(entry, quantities) for entry in value]
    if not isinstance(value, dict):
        return value
    found = {key: entry for key, entry in value.items() if key not in _NEVER}
    if isinstance(found.get("description"), str | None) and "examples" in value:
        found |= _shown(value)
    # Beside its properties it would have editors offer a snippet named by the title.
    if "properties" in found and "required" in found:
        found["allOf"] = [{"required": found.pop("required")}]
    found = {key: _for_editors(entry, quantities) for key, entry in found.items()}
    if "patternErrorMessage" in found:
        quantity = {key: found.pop(key) for key in _OF_QUANTITY if key in found}
        name = _quantity_name(quantity["patternErrorMessage"])
        about = f"{quantity['patternErrorMessage'].partition(' is needed')[0].capitalize()}"
        quantities[name] = {"description": f"{about}, as text with its unit", **quantity}
        found = {"$ref": f"#/$defs/{name}", **found}
    return found


def _quantity_name(message: str) -> str:
    """`AngleOrLength` of the message that begins with `an angle or a length is needed`."""
    words = message.partition(" is needed")[0].split()
    return "".join(word.capitalize() for word in words if word not in ("a", "an"))


def _shown(field: Mapping[str, Any]) -> dict[str, Any]:
    """What a key says of its examples: quantities are offered, all others stand in its sentence."""
    offered = [each for each in field["examples"] if _is_quantity(each)]
    others = [written(each) for each in field["examples"] if not _is_quantity(each)]
    about = str(field.get("description", ""))
    if others:
        about = f"{about.rstrip('.')}, such as {' or '.join(others)}".removeprefix(", ")
    shown: dict[str, Any] = {"description": about} if about else {}
    return shown | ({"examples": offered} if offered else {})


def _is_quantity(example: object) -> bool:
    if isinstance(example, str):
        parts = split_quantity(example.removeprefix("-"))
        return parts is not None and bool(parts[1])
    return isinstance(example, int | float)
