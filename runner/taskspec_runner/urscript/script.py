"""A URScript program as data, and its text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from functools import cache
from pathlib import Path

from taskspec.deferred_methods import dataclass

_LIBRARY = Path(__file__).parent / "library.script"
#: Decimals of a number: picometres and picoradians.
_DECIMALS = 12
_WORD = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True, slots=True)
class Loss:
    """What the program does otherwise than the task, and the place in the file that it is about.

    Attributes:
        source: name of the text.
        line, column: of the place in it, counted from 1.
        text: a sentence without a full stop.
    """

    source: str
    line: int
    column: int
    text: str

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}: {self.text}"


@dataclass(frozen=True, slots=True)
class NamedValue:
    """A named value of the program, with its unit and meaning, and what it stands among."""

    name: str
    value: str
    about: str = ""
    group: str = ""


class NamedValues:
    """The named values of a program, each name once.

    Attributes:
        all: in their order.
        group: what those that are entered next stand among.
    """

    def __init__(self, outer: NamedValues | None = None) -> None:
        """Without any.

        Args:
            outer: values whose names are taken; None for none.
        """
        self.all: list[NamedValue] = []
        self.group = ""
        self._taken: set[str] = set() if outer is None else outer._taken

    def add(self, name: str, value: str, about: str = "") -> str:
        """Enters a value; the name under which the program has it."""
        free, count = name, 1
        while free in self._taken:
            count += 1
            free = f"{name}_{count}"
        self._taken.add(free)
        self.all.append(NamedValue(free, value, about, self.group))
        return free


class ScriptLines:
    """ScriptLines of a program with blocks that are closed by `end`."""

    def __init__(self) -> None:
        """Without any."""
        self.lines: list[str] = []
        self._depth = 0

    def add(self, *lines: str) -> None:
        """ScriptLines at the depth of the open blocks."""
        self.lines += ["  " * self._depth + line if line else "" for line in lines]

    def note(self, text: str) -> None:
        """A comment."""
        self.add(f"# {text}")

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """A block below its head, such as `while True:`."""
        self.add(head)
        self._depth += 1
        yield
        self._depth -= 1
        self.add("end")


@dataclass(frozen=True, slots=True)
class ScriptSection:
    """A part of the program with its constants above its function.

    Attributes:
        title: in a comment.
        quoted: lines of the file that it is made of.
        losses: in it.
        constants: above the function.
        function: its lines.
    """

    title: str
    quoted: Sequence[str]
    losses: Sequence[Loss]
    constants: Sequence[NamedValue]
    function: Sequence[str]


@dataclass(frozen=True, slots=True)
class Script:
    """A URScript program.

    Attributes:
        name: of its function.
        header: what it is, as comments.
        losses: of the task as a whole; those of stages are in their sections.
        constants: of the program.
        stages: one section each.
        main: what it does, after all definitions.
    """

    name: str
    header: Sequence[str]
    losses: Sequence[Loss]
    constants: Sequence[NamedValue]
    stages: Sequence[ScriptSection]
    main: Sequence[str] = field(default_factory=tuple)

    @property
    def all_losses(self) -> tuple[Loss, ...]:
        """Those of the task, then those of its stages in order."""
        return (*self.losses, *(loss for stage in self.stages for loss in stage.losses))

    @property
    def text(self) -> str:
        """The program as a file."""
        return self._written(whole=True)

    @property
    def own_text(self) -> str:
        """The program with the names of the library's functions in the place of these."""
        return self._written(whole=False)

    def _written(self, *, whole: bool) -> str:
        out = ScriptLines()
        out.add(*(f"# {line}".rstrip() for line in self.header))
        own = "\n".join([*self.main, *(line for s in self.stages for line in s.function)])
        functions = library(own)
        values = [each.value for stage in self.stages for each in stage.constants]
        lines = [line for _, code in functions.values() for line in code]
        called = "\n".join([own, *values, *lines])
        with out.block(f"def {self.name}():"):
            _losses(out, self.losses)
            _constants(out, _used(self.constants, called))
            out.add("")
            if whole:
                for about, code in functions.values():
                    out.add(*about, *code, "")
            else:
                out.add(f"# Here stand {', '.join(functions)}.", "")
            for stage in self.stages:
                out.add(f"# Stage {stage.title}", *(f"#   {line}" for line in stage.quoted))
                _losses(out, stage.losses)
                _constants(out, stage.constants)
                out.add(*stage.function, "")
            out.add(*self.main)
        return "\n".join(out.lines) + "\n"


def _used(constants: Sequence[NamedValue], text: str) -> list[NamedValue]:
    """The constants that a text uses, and those that these are made of, in their order."""
    words, found = set(_WORD.findall(text)), list[NamedValue]()
    for each in reversed(constants):
        if each.name in words:
            words |= set(_WORD.findall(each.value))
            found.append(each)
    return found[::-1]


def _losses(out: ScriptLines, losses: Iterable[Loss]) -> None:
    for loss in losses:
        out.note(f"LOST ({Path(loss.source).name}:{loss.line}): {loss.text}")


def _constants(out: ScriptLines, constants: Iterable[NamedValue]) -> None:
    group = ""
    for each in constants:
        if each.group != group:
            group = each.group
            out.add("", f"# {group}")
        comment = f"  # {each.about}" if each.about else ""
        out.add(f"global {each.name} = {each.value}{comment}")


@cache
def _functions() -> dict[str, tuple[list[str], list[str]]]:
    """The functions of the library by name: their comments and their lines, in order."""
    found: dict[str, tuple[list[str], list[str]]] = {}
    for part in _LIBRARY.read_text(encoding="utf-8").split("\n\n"):
        lines = part.strip().splitlines()
        about = [line for line in lines if line.startswith("#")]
        if code := lines[len(about) :]:
            found[code[0].removeprefix("def ").partition("(")[0]] = about, code
    return found


def library(text: str) -> dict[str, tuple[list[str], list[str]]]:
    """Comments and lines of the library's functions that a text calls, and of those they call."""
    every, needed, waiting = _functions(), set[str](), set(_WORD.findall(text))
    while calls := (waiting & every.keys()) - needed:
        needed |= calls
        waiting = {word for name in calls for word in _WORD.findall("\n".join(every[name][1]))}
    return {name: parts for name, parts in every.items() if name in needed}


def number(value: float) -> str:
    """A number with a decimal point, as no division of it is one of integers."""
    text = f"{round(float(value), _DECIMALS) + 0.0:.{_DECIMALS}f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text


def listed(values: Iterable[float]) -> str:
    """A list of numbers."""
    return f"[{', '.join(map(number, values))}]"


def pose(position: Iterable[float], turn: Iterable[float]) -> str:
    """A pose: position [m] and rotation vector [rad]."""
    return f"p{listed((*position, *turn))}"


def identifier(name: str) -> str:
    """A name as URScript has them."""
    return re.sub(r"\W", "_", name)
