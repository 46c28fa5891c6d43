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
class Constant:
    """A named value of the program, with its unit and meaning."""

    name: str
    value: str
    about: str = ""


class Constants:
    """The named values of a program, each name once."""

    def __init__(self) -> None:
        """Without any."""
        self.all: list[Constant] = []

    def add(self, name: str, value: str, about: str = "") -> str:
        """Enters a value; the name under which the program has it."""
        number, free = 1, name
        while any(each.name == free for each in self.all):
            number += 1
            free = f"{name}_{number}"
        self.all.append(Constant(free, value, about))
        return free


class Lines:
    """Lines of a program with blocks that are closed by `end`."""

    def __init__(self) -> None:
        """Without any."""
        self.lines: list[str] = []
        self._depth = 0

    def add(self, *lines: str) -> None:
        """Lines at the depth of the open blocks."""
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
class Section:
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
    constants: Sequence[Constant]
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
    constants: Sequence[Constant]
    stages: Sequence[Section]
    main: Sequence[str] = field(default_factory=tuple)

    @property
    def all_losses(self) -> tuple[Loss, ...]:
        """Those of the task, then those of its stages in order."""
        return (*self.losses, *(loss for stage in self.stages for loss in stage.losses))

    @property
    def text(self) -> str:
        """The program as a file."""
        out = Lines()
        out.add(*(f"# {line}".rstrip() for line in self.header))
        with out.block(f"def {self.name}():"):
            _losses(out, self.losses)
            _constants(out, self.constants)
            out.add("")
            used = "\n".join([*self.main, *(line for s in self.stages for line in s.function)])
            for about, lines in library(used):
                out.add(*about, *lines, "")
            for stage in self.stages:
                out.add(f"# Stage {stage.title}", "#", *(f"#   {line}" for line in stage.quoted))
                _losses(out, stage.losses)
                _constants(out, stage.constants)
                out.add(*stage.function, "")
            out.add(*self.main)
        return "\n".join(out.lines) + "\n"


def _losses(out: Lines, losses: Iterable[Loss]) -> None:
    for loss in losses:
        out.note(f"LOST ({Path(loss.source).name}:{loss.line}): {loss.text}")


def _constants(out: Lines, constants: Iterable[Constant]) -> None:
    for each in constants:
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


def library(text: str) -> list[tuple[list[str], list[str]]]:
    """Comments and lines of the library's functions that a text calls, and of those they call."""
    every, needed, waiting = _functions(), set[str](), set(_WORD.findall(text))
    while calls := (waiting & every.keys()) - needed:
        needed |= calls
        waiting = {word for name in calls for word in _WORD.findall("\n".join(every[name][1]))}
    return [parts for name, parts in every.items() if name in needed]


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
