"""The house of docs/architecture.md: floors, imports that run down, nouns that exist once.

Imports in functions and those for types alone count as any other.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "architecture.md"
ROOTS = {"taskspec": ROOT / "taskspec", "taskspec_runner": ROOT / "runner" / "taskspec_runner"}


@cache
def floors() -> list[tuple[str, ...]]:
    """Modules and packages of each floor, from the ground up, as the page lists them."""
    table = PAGE.read_text(encoding="utf-8").split("<!-- table: floors -->")[1]
    rows = re.findall(r"^\| [^|]+ \| ([^|]+) \|", table.split("\n\n")[0], re.M)
    named = [re.findall(r"`([\w.]+)`", row) for row in rows]
    return [tuple(names) for names in reversed([n for n in named if n])]


def floor_of(module: str) -> int:
    """The number of a module's floor, that of the longest name that holds it."""
    found = [
        (len(name), number)
        for number, names in enumerate(floors())
        for name in names
        if module == name or module.startswith(f"{name}.")
    ]
    assert found, f"{module} stands on no floor of {PAGE.name}"
    return max(found)[1]


@cache
def sources() -> dict[str, ast.Module]:
    found = {}
    for name, folder in ROOTS.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            module = ".".join((name, *(p for p in parts if p != "__init__")))
            found[module] = ast.parse(path.read_text(encoding="utf-8"))
    return found


@cache
def imports() -> dict[str, set[str]]:
    """By module, the modules of the project that it imports: in functions and for types, too."""
    found: dict[str, set[str]] = {module: set() for module in sources()}
    for module, tree in sources().items():
        for node in ast.walk(tree):
            named = []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{module} imports relative to itself"
                wholes = [f"{node.module}.{alias.name}" for alias in node.names]
                named = [whole if whole in found else str(node.module) for whole in wholes]
            elif isinstance(node, ast.Import):
                named = [alias.name for alias in node.names]
            found[module] |= {name for name in named if name in found and name != module}
    assert sum(map(len, found.values())) > len(found)
    return found


def test_no_import_runs_up():
    up = [
        f"{module} -> {imported}"
        for module, others in imports().items()
        for imported in others
        if module not in ROOTS and imported not in ROOTS and floor_of(imported) > floor_of(module)
    ]
    assert up == []


def circle_of(graph: Mapping[str, set[str]]) -> list[str]:
    """Names that lead back to the first of them; empty where no graph's edges do."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_imports_go_in_a_circle():
    assert circle_of(imports()) == []


def test_no_packages_import_each_other():
    packages: dict[str, set[str]] = defaultdict(set)
    for module, others in imports().items():
        for other in others:
            own, its = (".".join(name.split(".")[:2]) for name in (module, other))
            if own != its:
                packages[own].add(its)
    assert len(packages) > len(floors())
    assert circle_of(packages) == []


def test_every_public_class_name_is_used_once():
    places = defaultdict(list)
    for module, tree in sources().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(module)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}
