"""Ways to spoil a task file: as text, and as a tree whose parts are swapped for likely ones."""

from __future__ import annotations

import copy
import json
import random
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]
CORPUS = ROOT / "tests" / "corpus"
TASKS = ROOT / "tasks"

_SIGNS = [
    *"{}[],:#&*!|>'\"%@`-?()=<>.^+/~ \n\t\0é🙂\u202e\ud800",
    *("\n  ", ": ", " #", "..", "+-"),
]
_NUMBERS = [
    *("0", "-1", "1e-9", "1e-3", "0.5", "2", "7", "1e3", "1e6", "1e9", "1e15", "1e300", "-1e300"),
    *("1e-300", "5e-324", ".nan", ".inf", "1e999", "9" * 25, "-0.0", "1/3", "rigid", "true"),
]
_UNITS = [
    *("N", "N*m", "mm", "m", "km", "s", "ms", "us", "h", "deg", "rad", "kg", "g", "%", "Hz", "kHz"),
    *("N/m", "kN/m", "N*s/m", "mm/s", "m/s", "m/s^2", "deg/s", "N/s", "N*m/rad", ""),
]
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_PLAIN = re.compile(r"[\w.+-](?:[\w.+/^*%-]| (?=[\w.(]))*")
_STRUCTURE = 0.55


@dataclass(frozen=True)
class Case:
    """A text to be held to the promises.

    Attributes:
        text: of the file. base: the folder where its relative paths begin.
        origin: the file that it was made of.
    """

    text: str
    base: Path
    origin: str


@dataclass(frozen=True)
class _Seeds:
    good: tuple[Path, ...]
    all: tuple[Path, ...]
    words: tuple[str, ...]
    values: dict[str, list[Any]]


@cache
def _seeds() -> _Seeds:
    good = (*sorted(CORPUS.glob("ok/*.yaml")), *sorted(TASKS.glob("*.yaml")))
    paths = (*good, *sorted(CORPUS.glob("err/*.yaml")))
    texts = [path.read_text(encoding="utf-8") for path in paths]
    values: dict[str, list[Any]] = {}
    for path in good:
        _gather(_tree(path), values)
    words = sorted({word for text in texts for word in text.split()})
    return _Seeds(good, paths, tuple(words), values)


@cache
def _tree(path: Path) -> Any:
    return yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)


def _gather(node: Any, values: dict[str, list[Any]]) -> None:
    """Keeps every value that stands under a key anywhere, by that key."""
    for key, value in node.items() if isinstance(node, dict) else ():
        values.setdefault(key, []).append(value)
    for child in _children(node):
        _gather(child, values)


def _children(node: Any) -> list[Any]:
    if isinstance(node, dict):
        return list(node.values())
    return node if isinstance(node, list) else []


def case(seed: int) -> Case:
    """The case of a seed, the same on every machine."""
    rng = random.Random(seed)
    if rng.random() < _STRUCTURE:
        path = rng.choice(_seeds().good)
        tree = copy.deepcopy(_tree(path))
        for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5))):
            rng.choice(_EDITS)(tree, rng)
        text = "".join(f"{_plain(key)}: {written(value)}\n" for key, value in tree.items())
    else:
        path = rng.choice(_seeds().good if rng.random() < 0.7 else _seeds().all)
        text = path.read_text(encoding="utf-8")
        for _ in range(rng.choice((1, 1, 2, 3, 6))):
            text = injured(text, rng)
    # By numbers of its own, so that all other files stay those of their seeds.
    other = random.Random(f"kind of {seed}")
    kind = other.random()
    if kind < _CHAINED:
        return chained(text, other)
    if kind < _CHAINED + _LARGE:
        path = other.choice(_seeds().good)
        return Case(many_stages(path, other), path.parent, path.name)
    return Case(text, path.parent, path.name)


#: Depths of chains of includes that are tried, and stages of large files; their shares.
_DEEPEST, _MOST_STAGES = 40, 400
_CHAINED, _LARGE = 0.03, 0.005


@cache
def _chains() -> Path:
    """A folder of this process for files that are included."""
    return Path(tempfile.mkdtemp(prefix="taskspec-fuzz-"))


def chained(text: str, rng: random.Random) -> Case:
    """A sound task that a chain of includes leads from to a spoiled text."""
    depth, folder = rng.randrange(1, _DEEPEST), _chains()
    for number in range(depth):
        (folder / f"c{number}.yaml").write_text(f"include: c{number + 1}.yaml\n")
    (folder / f"c{depth}.yaml").write_text(text, "utf-8", "surrogatepass")
    task = "taskspec: 1\ninclude: c0.yaml\nstages: {wait: {time: 1 s}}\n"
    return Case(task, folder, f"{depth} files")


def many_stages(path: Path, rng: random.Random) -> str:
    """A sound file whose stages are there many times, under names of their own."""
    tree = copy.deepcopy(_tree(path))
    stages = tree.get("stages") if isinstance(tree, dict) else None
    if isinstance(stages, dict) and stages:
        names, count = list(stages), rng.randrange(60, _MOST_STAGES)
        tree["stages"] = {f"s{i}": stages[names[i % len(names)]] for i in range(count)}
    return "".join(f"{_plain(key)}: {written(value)}\n" for key, value in tree.items())


def written(node: Any) -> str:
    """A tree of strings as YAML on one line."""
    if isinstance(node, dict):
        return "{" + ", ".join(f"{_plain(k)}: {written(v)}" for k, v in node.items()) + "}"
    if isinstance(node, list):
        return "[" + ", ".join(map(written, node)) + "]"
    return _plain(node)


def _plain(text: str) -> str:
    # What needs no quotes gets none, since a number in quotes is a text.
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)


def injured(text: str, rng: random.Random) -> str:
    """A text with one small injury."""
    at = rng.randint(0, len(text))
    match rng.randint(0, 9):
        case 0:
            return text[:at] + rng.choice(_SIGNS) + text[at:]
        case 1:
            return text[:at] + text[at + rng.randint(1, 4) :]
        case 2:
            return text[:at] + rng.choice(_seeds().words) + text[at:]
        case 3:
            return text[:at] + rng.choice(_SIGNS) + text[at + 1 :]
        case 4:
            return text[:at] + text[at : at + rng.randint(1, 80)] + text[at:]
        case 5:
            lines = text.split("\n")
            del lines[rng.randrange(len(lines))]
            return "\n".join(lines)
        case 6:
            lines = text.split("\n")
            rng.shuffle(lines)
            return "\n".join(lines)
        case _:
            return _other_number(text, rng)


def _other_number(text: str, rng: random.Random) -> str:
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    one = rng.choice(found)
    return text[: one.start()] + rng.choice(_NUMBERS) + text[one.end() :]


def _slots(tree: Any) -> list[tuple[Any, Any]]:
    """Every place of a tree that holds a value: the container, and its key or index."""
    found: list[tuple[Any, Any]] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node))
        found += [(node, key) for key in keys]
        waiting += [child for child in _children(node) if isinstance(child, dict | list)]
    return found


def _swap(tree: Any, rng: random.Random) -> None:
    """Puts in what stands under the same key somewhere else."""
    node, key = rng.choice(_slots(tree))
    if isinstance(key, str):
        node[key] = copy.deepcopy(rng.choice(_seeds().values.get(key, [""])))


def _add(tree: Any, rng: random.Random) -> None:
    """Adds a key that some mapping in some file has beside one of those that are there."""
    node, key = rng.choice(_slots(tree))
    if isinstance(node, dict):
        siblings = [t for p in _seeds().good for t in _mappings(_tree(p)) if key in t]
        if siblings:
            other = rng.choice(siblings)
            new = rng.choice(list(other))
            node[new] = copy.deepcopy(other[new])


def _mappings(node: Any) -> list[dict[str, Any]]:
    own = [node] if isinstance(node, dict) else []
    return own + [found for child in _children(node) for found in _mappings(child)]


def _drop(tree: Any, rng: random.Random) -> None:
    node, key = rng.choice(_slots(tree))
    if len(node) > 1:
        del node[key]


def _renumber(tree: Any, rng: random.Random) -> None:
    places = [(n, k) for n, k in _slots(tree) if isinstance(n[k], str) and _NUMBER.search(n[k])]
    if places:
        node, key = rng.choice(places)
        node[key] = _scaled(node[key], rng) if rng.random() < 0.7 else _other_number(node[key], rng)


def _scaled(text: str, rng: random.Random) -> str:
    one = rng.choice(list(_NUMBER.finditer(text)))
    factor = rng.choice((-1.0, 0.0, 0.1, 0.5, 0.9, 1.1, 2.0, 10.0, 1e3, 1e-3))
    return text[: one.start()] + f"{float(one.group()) * factor:.9g}" + text[one.end() :]


def _other_unit(tree: Any, rng: random.Random) -> None:
    places = [(n, k) for n, k in _slots(tree) if isinstance(n[k], str) and _NUMBER.search(n[k])]
    if places:
        node, key = rng.choice(places)
        number = _NUMBER.search(node[key])
        assert number
        node[key] = f"{number.group()} {rng.choice(_UNITS)}"


def _copy_under(tree: Any, rng: random.Random) -> None:
    """Copies a value to another place of the same tree."""
    (node, key), (other, place) = rng.choice(_slots(tree)), rng.choice(_slots(tree))
    other[place] = copy.deepcopy(node[key])


def _rename(tree: Any, rng: random.Random) -> None:
    node, key = rng.choice(_slots(tree))
    if isinstance(node, dict):
        node[rng.choice(_seeds().words).strip("{}[],:")] = node.pop(key)


_EDITS: list[Callable[[Any, random.Random], None]] = [
    *(_swap, _swap, _add, _add, _drop, _renumber, _renumber, _renumber),
    *(_other_unit, _copy_under, _rename),
]
