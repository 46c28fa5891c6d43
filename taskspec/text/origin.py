"""Where the characters of a scalar stand in the file."""

from __future__ import annotations

from dataclasses import field

from taskspec.deferred_methods import dataclass
from taskspec.text.source import Source, Span


@dataclass(frozen=True, slots=True)
class Origin:
    """The place of a scalar, exact to the character where its text is written plainly.

    Attributes:
        span: the whole scalar.
        value: what the scalar says.
        raw: the source text from the scalar's first character on.
        column: column of the first character of `raw`.
        skip: characters before the value begins, such as a quote.
    """

    span: Span
    value: str
    raw: str
    skip: int = 0
    _offsets: list[int] = field(default_factory=list, compare=False, repr=False)

    def at(self, start: int, end: int) -> Span:
        """The place of the characters `start` to `end` (exclusive) of the value.

        Where escapes or folding hide the position, that is the whole scalar.
        """
        if not self._offsets:
            self._offsets.extend(_align(self.value, self.raw, self.skip))
        offsets = self._offsets
        if not 0 <= start < len(self.value) or len(offsets) != len(self.value):
            return self.span
        last = min(max(end, start + 1), len(self.value)) - 1
        line, column = self._position(offsets[start])
        end_line, end_column = self._position(offsets[last])
        return self.span.covering(line, column, end_line, end_column + 1)

    def _position(self, offset: int) -> tuple[int, int]:
        before = self.raw[:offset]
        newlines = before.count("\n")
        if not newlines:
            return self.span.line, self.span.column + offset
        return self.span.line + newlines, offset - before.rfind("\n")


def _align(value: str, raw: str, skip: int) -> list[int]:
    """For each character of the value its offset in the raw text; [-1] if it is hidden.

    Folding makes one space or line end of a stretch of them, so stretches match stretches.
    """
    offsets: list[int] = []
    position = skip
    if value[:1] not in _SPACES:
        position = _behind_spaces(raw, position)
    for index, character in enumerate(value):
        if character in _SPACES and index and value[index - 1] in _SPACES:
            offsets.append(offsets[-1])
        elif character in _SPACES and (position == len(raw) or raw[position] in _SPACES):
            offsets.append(min(position, len(raw) - 1))
            position = _behind_spaces(raw, position)
        elif position < len(raw) and raw[position] == character:
            offsets.append(position)
            position += 1
        else:
            return [-1]
    return offsets


_SPACES = (" ", "\n")


def _behind_spaces(raw: str, position: int) -> int:
    while position < len(raw) and raw[position] in _SPACES:
        position += 1
    return position


def origin_of(source: Source, span: Span, value: str, start: int, end: int, skip: int) -> Origin:
    """The origin of a scalar that is `source.text[start:end]`."""
    return Origin(span, value, source.text[start:end], skip)
