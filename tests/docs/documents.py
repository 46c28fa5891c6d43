"""Reading the documents: their blocks, and the tables that are held against the code.

Such a table stands below a comment, `<!-- table: units -->` or `<!-- keys: robot.tool -->`. A YAML
block is a whole task, or stands below `<!-- completes: NAME -->`: its sections then take the place
of those of the task with that name in the same document, or in the README of its folder. Blocks of
files that lie beside the documents are those of `shown_pages`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.expression import FloatAlgebra, evaluate, parse
from taskspec.spec import LoadedTask, load_text
from taskspec.spec.model import Model
from taskspec.text.diagnostic import Severity, SpecError
from taskspec.text.units import NUMBER, parse_unit

ROOT = Path(__file__).resolve().parent.parent.parent
TASKS = ROOT / "tasks"
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: The reference of the language, a folder: where a folder is read, its pages are one text.
LANGUAGE = ROOT / "docs" / "language"
CONVENTIONS = ROOT / "docs" / "conventions.md"
EXAMPLE = "press-and-slide"

BLOCK = re.compile(
    r"(?:^<!-- (?P<shown>task|part): .+ -->\n|^<!-- completes: (?P<name>\S+) -->\n)?"
    r"^```(?P<kind>\w*)\n(?P<text>.*?)^```$",
    re.M | re.S,
)


def blocks(kind: str) -> list[Any]:
    """Every block of one kind, as (document, name of the task that it completes, its text)."""
    found = []
    for path in DOCUMENTS:
        if path.parent.name == "diagnostics":
            continue  # their files are wrong on purpose, and have a test of their own
        text = path.read_text(encoding="utf-8")
        for match in BLOCK.finditer(text):
            if match["kind"] == kind and not match["shown"]:
                line = text.count("\n", 0, match.start("text")) + 1
                label = f"{path.name}:{line}"
                found.append(pytest.param(path, match["name"], match["text"], id=label))
    return found


def is_task(text: str) -> bool:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return bool(lines) and lines[0].startswith("taskspec:")


def sections(text: str) -> dict[str, str]:
    """The top-level sections of a task by their keys."""
    parts = re.split(r"^(?=[a-z]+:)", text, flags=re.M)
    return {part.partition(":")[0]: part for part in parts if part.strip()}


@cache
def example(path: Path = LANGUAGE, name: str = EXAMPLE) -> str:
    """The text of the task with this name in a document, or in the README of its folder."""
    index = (path if path.is_dir() else path.parent) / "README.md"
    for match in BLOCK.finditer(text_of(path) + text_of(index)):
        if is_task(match["text"]) and f"\nname: {name}\n" in match["text"]:
            return match["text"]
    raise LookupError(f"{path.name} has no task {name!r}")


@cache
def text_of(path: Path) -> str:
    """The text of a document; of a folder that of its pages, one after another."""
    pages = sorted(path.glob("*.md")) if path.is_dir() else [path]
    assert pages, path
    return "\n".join(page.read_text(encoding="utf-8") for page in pages)


def completed(text: str, path: Path = LANGUAGE, name: str = EXAMPLE) -> str:
    return "".join((sections(example(path, name)) | sections(text)).values())


def load(text: str, overrides: Mapping[str, str] | None = None) -> LoadedTask:
    return load_text(text, "example.yaml", overrides, base=TASKS)


def codes_of(text: str) -> list[str]:
    """Codes of everything that keeps a task from running, but that it is unstable."""
    try:
        admit(examine(load(text), stability=False))
    except SpecError as error:
        return [d.code for d in error.diagnostics if d.severity is Severity.ERROR]
    return []


def table(path: Path, name: str) -> list[list[str]]:
    """The rows of a marked table, without its head; one text for each cell."""
    text = text_of(path)
    match = re.search(rf"^<!-- {re.escape(name)} -->\n((?:\|.*\n)+)", text, re.M)
    assert match is not None, f"{path.name} has no table '{name}'"
    lines = match[1].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def words(cell: str) -> list[str]:
    """What a cell has in code quotes."""
    return re.findall(r"`([^`]+)`", cell)


def first_words(path: Path, name: str) -> list[str]:
    found = [word for row in table(path, name) for word in words(row[0])]
    assert len(found) == len(set(found)), f"'{name}' lists something twice"
    return found


def value(text: str, known: Mapping[str, float] | None = None) -> float:
    """The SI value of a constant expression."""
    names = {"pi": 3.141592653589793} | dict(known or {})
    tree = parse(text, "sum")
    return evaluate(tree, FloatAlgebra(), lambda name: names[".".join(name.path)])


def units_written(cell: str) -> set[object]:
    if cell in ("number", "condition"):
        return {NUMBER if cell == "number" else "condition"}
    return {parse_unit(word).dimension for word in words(cell)}


def models_of(base: type[Model]) -> set[type[Model]]:
    """Every model below a model."""
    direct = base.__subclasses__()
    return {*direct, *(found for model in direct for found in models_of(model))}
