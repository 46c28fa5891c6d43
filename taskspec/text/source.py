"""A text and places in it."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field, replace
from itertools import accumulate

OVERRIDES = "--set"
"""The name of the source that has the values given beside a file."""


@dataclass(frozen=True, slots=True, order=True)
class Span:
    """A stretch of text: 1-based, the end exclusive, columns counted in characters.

    `source` is empty for the file that is being read, and the name of another text (such as the
    overrides of the command line) otherwise. `via` says what led here, the nearest first, as words
    and places: the stage that uses a template, the line that includes a file.
    """

    line: int
    column: int
    end_line: int
    end_column: int
    source: str = ""
    via: tuple[tuple[str, Span], ...] = ()

    def reached(self, words: str, place: Span) -> Span:
        """The same stretch, with a place that led to it, and what led there."""
        # Each place once: with its own `via` in each, one more step would double all before it.
        return replace(self, via=(*self.via, (words, replace(place, via=())), *place.via))

    def covering(self, line: int, column: int, end_line: int, end_column: int) -> Span:
        """Another stretch of the same text that the same places led to."""
        return Span(line, column, end_line, end_column, self.source, self.via)


@dataclass(frozen=True, slots=True)
class Source:
    """A text and the name under which it is shown to the user."""

    name: str
    text: str
    _lines: list[str] = field(init=False, repr=False, compare=False)
    _starts: list[int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        lines = self.text.split("\n")
        starts = accumulate((len(line) + 1 for line in lines), initial=0)
        object.__setattr__(self, "_lines", lines)
        object.__setattr__(self, "_starts", list(starts))

    def offset(self, line: int, column: int) -> int:
        """The index in `text` of a place (1-based line and column)."""
        return self._starts[line - 1] + column - 1

    def place(self, offset: int) -> tuple[int, int]:
        """Line and column (1-based) of an index in `text`."""
        line = bisect_right(self._starts, offset)
        return line, offset - self._starts[line - 1] + 1

    def span(self, start: int, end: int) -> Span:
        """The stretch between two indices in `text`, the second exclusive."""
        return Span(*self.place(start), *self.place(end))

    def line(self, number: int) -> str:
        """Line `number` (1-based) without its end; empty beyond the last line."""
        return self._lines[number - 1] if 0 < number <= len(self._lines) else ""

    @property
    def line_count(self) -> int:
        """The number of lines."""
        return len(self._lines)
