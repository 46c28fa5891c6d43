"""The JSON Schema of task files, for editors; generated from the models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from taskspec.spec.schema_notes import annotate
from taskspec.spec.task import VERSION, Task
from taskspec.spec.truth import FAULTS

FILE_NAME = f"taskspec-{VERSION}.schema.json"
_ID = f"urn:taskspec:schema:{VERSION}"


def schema_text() -> str:
    """The JSON Schema as the text of its file.

    It rejects nothing that `load_task` accepts; what only the compiler can know, it lets pass.
    """
    generated = tidy(Task.model_json_schema())
    # It stands in a list that is read by hand.
    faults = generated["properties"]["truth"]["properties"][FAULTS]
    generated["$defs"]["Fault"] = faults["items"]
    faults["items"] = {"$ref": "#/$defs/Fault"}
    for name, form in {"Task": generated, **generated["$defs"]}.items():
        annotate(name, form)
    # What a file needs may come from one that it includes.
    generated["required"].remove("robot")
    generated["anyOf"] = [{"required": ["robot"]}, {"required": ["include"]}]
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": _ID,
        "title": f"A task of the taskspec language, version {VERSION}",
    }
    return json.dumps(head | {k: v for k, v in generated.items() if k not in head}, indent=2) + "\n"


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
