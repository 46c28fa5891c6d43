"""What may be written where the cursor is: keys, words, names, units, signals."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum

from taskspec.deferred_methods import dataclass
from taskspec.expression.functions import FUNCTIONS, REDUCERS
from taskspec.laws import LAWS
from taskspec.robot.library import builtin_names
from taskspec.text.units import fitting
from taskspec_runner.editor.cursor import Cursor, cursor_at
from taskspec_runner.editor.key_schema import KeyFacts, key_at, keys_at
from taskspec_runner.editor.names import TaskNames
from taskspec_runner.editor.opened import OpenedFile

#: A number that waits for its unit, with what is written of that.
_UNITLESS = re.compile(
    r"(?:^|.*[\s,\[(=<>*+-])(\d+(?:\.\d+)?(?:e[-+]?\d+)?)\s*(?P<unit>[A-Za-z*/^%]*)$"
)
_WORD = re.compile(r"[A-Za-z_][\w.]*$")
#: Keys of a stage that hold expressions of what is measured, and those of the whole run.
_MEASURED = {"until", "fail_if", "if", "when", "force", "torque", "velocity", "slow", "speed"}
_JUDGED = {"expect"}


class Sort(StrEnum):
    """What a proposal is, for the picture that editors show beside it."""

    KEY = "key"
    WORD = "word"
    NAME = "name"
    UNIT = "unit"
    SIGNAL = "signal"
    FUNCTION = "function"


@dataclass(frozen=True, slots=True)
class Proposal:
    """A proposal.

    Attributes:
        text: what is written.
        sort: what it is.
        about: a few words beside it.
        start: offset from which it replaces what is written.
    """

    text: str
    sort: Sort
    about: str
    start: int


def proposals(opened: OpenedFile, offset: int) -> list[Proposal]:
    """All that may be written before the character at `offset`."""
    cursor = cursor_at(opened.source.text, offset)
    found: list[Proposal] = []
    if cursor.at_key:
        found += _keys(cursor)
    if not cursor.at_key or (cursor.path and isinstance(cursor.path[-1], int)):
        found += _values(cursor, opened.names, offset)
    return list({each.text: each for each in reversed(found)}.values())[::-1]


def _keys(cursor: Cursor) -> Iterator[Proposal]:
    for name, facts in keys_at(cursor.path, cursor.others).items():
        yield Proposal(f"{name}: ", Sort.KEY, facts.title or facts.about, cursor.start)


def _values(cursor: Cursor, names: TaskNames | None, offset: int) -> Iterator[Proposal]:
    facts = key_at(cursor.path)
    word = _WORD.search(cursor.prefix)
    start = offset - len(word[0]) if word else offset
    number = _UNITLESS.match(cursor.prefix)
    if facts is not None and number:
        yield from _units(facts, cursor, number["unit"], offset)
        return
    if facts is not None and (word is None or word[0] == cursor.prefix.strip()):
        for text in facts.words:
            yield Proposal(text, Sort.WORD, facts.title, start)
    if names is None:
        return
    own = list(_named(cursor.path, names))
    for text, about in own:
        yield Proposal(text, Sort.NAME, about, start)
    if not own and (kind := _expression(cursor.path, facts)):
        yield from _expressions(kind, names, start)


def _units(facts: KeyFacts, cursor: Cursor, written: str, offset: int) -> Iterator[Proposal]:
    gap = "" if cursor.prefix[: len(cursor.prefix) - len(written)].endswith(" ") else " "
    for dimension in facts.dimensions:
        for unit in fitting(dimension):
            yield Proposal(gap + unit, Sort.UNIT, facts.title, offset - len(written))


def _named(path: Sequence[str | int], names: TaskNames) -> Iterator[tuple[str, str]]:
    """The names that a value may be, each with what it is."""
    keys = [step for step in path if isinstance(step, str)]
    last = keys[-1] if keys else ""
    lists: dict[str, Callable[[], Sequence[str]]] = {
        "frame": lambda: names.frames,
        "next": lambda: names.targets,
        "on_fail": lambda: names.targets,
        "on_limit": lambda: names.targets,
        "goto": lambda: names.targets,
        "to": lambda: names.targets if "next" in keys else (),
        "grasp": lambda: names.held,
        "surface": lambda: _of(names, "shape"),
        "on": lambda: [name for name, kind in names.objects.items() if kind != "shape"],
        "use": lambda: names.of_kind("template"),
        "template": lambda: names.of_kind("template"),
        "law": lambda: list(LAWS),
        "model": lambda: builtin_names() if "robot" in keys else (),
        "stage": lambda: names.stages,
    }
    for text in lists.get(last, tuple)():
        declared = names.declared.get(text)
        yield text, declared.kind if declared else last


def _of(names: TaskNames, kind: str) -> list[str]:
    return [name for name, own in names.objects.items() if own == kind]


def _expression(path: Sequence[str | int], facts: KeyFacts | None) -> str:
    """`measured` or `params`, by what an expression at a path may use; empty where none stands."""
    keys = {step for step in path if isinstance(step, str)}
    if keys & (_MEASURED | _JUDGED) and keys & {"stages", "templates", *_JUDGED}:
        return "measured"
    return "params" if facts is not None and facts.dimensions else ""


def _expressions(kind: str, names: TaskNames, start: int) -> Iterator[Proposal]:
    for name in names.of_kind("param"):
        yield Proposal(name, Sort.NAME, "param", start)
    for name in FUNCTIONS:
        yield Proposal(f"{name}(", Sort.FUNCTION, "function", start)
    if kind == "measured":
        for name, about in names.signals():
            yield Proposal(name, Sort.SIGNAL, about, start)
        for name in REDUCERS:
            yield Proposal(f"{name}(", Sort.FUNCTION, "over the stage so far", start)
        for stage in names.stages:
            yield Proposal(stage, Sort.NAME, "stage", start)
