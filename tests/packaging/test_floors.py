"""The house of docs/architecture.md: floors, imports that run down, nouns that exist once."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
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


def at_run_time(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a module but those under `if TYPE_CHECKING`: annotations may name it."""
    for node in ast.iter_child_nodes(tree):
        typing = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        if not typing:
            yield node
            yield from at_run_time(node)


def imports_of(tree: ast.Module) -> Iterator[str]:
    """Modules of the project that a module imports, wherever in it."""
    for node in at_run_time(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in sources() else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_no_import_runs_up():
    up = [
        f"{module} -> {imported}"
        for module, tree in sources().items()
        if module not in ROOTS
        for imported in imports_of(tree)
        if imported.split(".")[0] in ROOTS
        and imported not in ROOTS
        and floor_of(imported) > floor_of(module)
    ]
    assert up == []


def test_every_public_class_name_is_used_once():
    places = defaultdict(list)
    for module, tree in sources().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(module)
    assert {name: where for name, where in places.items() if len(where) > 1} == {}
