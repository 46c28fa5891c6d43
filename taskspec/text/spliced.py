"""Scalars that are made of others: `-level` where `level` is `12 N`, or texts side by side."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import field, replace

from taskspec.deferred_methods import dataclass
from taskspec.text.nodes import Scalar
from taskspec.text.origin import Origin
from taskspec.text.source import Span

#: A word that is not the end of a path, with the dot that makes it the head of one.
_WORD = re.compile(r"(?<![\w.])([A-Za-z][A-Za-z0-9_]*)(\.(?=\w))?(?!\w)")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_ATOM = re.compile(r"(?:[A-Za-z][A-Za-z0-9_]*|[0-9]+(?:\.[0-9]*)?)\Z")


@dataclass(frozen=True, slots=True)
class _Piece:
    """Characters `start` to `end` of a value, and where they stand.

    Attributes:
        origin: of the text that they come from.
        shift: what leads from an index in the value to one in that text.
        place: of the word that they stand for; None for text of the scalar itself.
        word: that they stand for.
    """

    start: int
    end: int
    origin: Origin
    shift: int
    place: Span | None = None
    word: str = ""

    def own(self, start: int, end: int) -> Span:
        """The place of a stretch in the scalar itself."""
        return self.place or self.origin.at(start + self.shift, end + self.shift)


@dataclass(frozen=True, slots=True)
class SplicedOrigin(Origin):
    """The place of such a scalar: what stands for a word is found where that is written."""

    pieces: Sequence[_Piece] = field(default=(), compare=False, repr=False)

    def at(self, start: int, end: int) -> Span:
        """The place of the characters `start` to `end` (exclusive) of the value.

        Inside of a text that was put in, that is where this text is written; else it is the
        stretch of the scalar itself.
        """
        last = max(end, start + 1) - 1
        first_piece = next((p for p in self.pieces if p.start <= start < p.end), None)
        last_piece = next((p for p in self.pieces if p.start <= last < p.end), None)
        if first_piece is None or last_piece is None:
            return self.span
        if first_piece is last_piece:
            inner = start + first_piece.shift, last + 1 + first_piece.shift
            length = len(first_piece.origin.value)
            # A parenthesis that was put around the text belongs to the word.
            if first_piece.place is None or 0 <= inner[0] < inner[1] <= length:
                return first_piece.origin.at(*inner)
        a, b = first_piece.own(start, start + 1), last_piece.own(last, last + 1)
        found = self.span.covering(a.line, a.column, b.end_line, b.end_column)
        for piece in self.pieces:
            if piece.word and piece.start <= last and start < piece.end:
                found = found.reached(f"'{piece.word}' is given here", piece.origin.span)
        return found


def spliced(scalar: Scalar, texts: Mapping[str, Scalar], used: set[str]) -> Scalar:
    """A scalar with its words replaced.

    A word at the head of a path, such as `table` in `table.gap`, is replaced by a word alone.

    Args:
        scalar: the scalar.
        texts: what stands for a word.
        used: the words that were replaced; they are added here.
    """
    pieces: list[_Piece] = []
    text, end = "", 0

    def keep(up_to: int) -> None:
        nonlocal text
        if up_to > end:
            start = len(text)
            text += scalar.value[end:up_to]
            pieces.append(_Piece(start, len(text), scalar.origin, end - start))

    for found in _WORD.finditer(scalar.value):
        word = found.group(1)
        new = texts.get(word)
        if new is None or (found.group(2) and not _NAME.match(new.value)):
            continue
        used.add(word)
        keep(found.start())
        shown = new.value if _ATOM.match(new.value) else f"({new.value})"
        start = len(text)
        text += shown
        shift = -start - (shown is not new.value)
        place = scalar.origin.at(found.start(), found.start() + len(word))
        pieces.append(_Piece(start, len(text), new.origin, shift, place, word))
        end = found.start() + len(word)
    if not pieces:
        return scalar
    keep(len(scalar.value))
    origin = SplicedOrigin(scalar.span, text, scalar.origin.raw, scalar.origin.skip, [], pieces)
    return Scalar(text, scalar.plain, origin, scalar.comment)


def joined(parts: Sequence[str | Scalar], place: Span) -> Scalar:
    """A scalar that texts and scalars of a file make up.

    Args:
        parts: in their order.
        place: of what is no scalar of the file.
    """
    pieces: list[_Piece] = []
    text = ""
    for part in parts:
        start = len(text)
        text += part if isinstance(part, str) else part.value
        if isinstance(part, Scalar):
            pieces.append(_Piece(start, len(text), part.origin, -start))
    return Scalar(text, True, SplicedOrigin(place, text, "", 0, [], pieces))


def reached(origin: Origin, words: str, place: Span) -> Origin:
    """An origin that a place led to."""
    return replace(origin, span=origin.span.reached(words, place))
