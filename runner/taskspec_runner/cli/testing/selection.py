"""Choosing task files by words of their paths: `-k "press and not (qp or pd)"`."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from taskspec_runner.errors import InputError

Choice = Callable[[str], bool]

_TOKEN = re.compile(r"\s*(\(|\)|[^\s()]+)")


def chosen_by(text: str) -> Callable[[Path], bool]:
    """Whether a path is chosen: by parts of it, small or large, with `and`, `or`, `not`, `( )`.

    Raises:
        InputError: that is no expression.
    """
    reader = _Reader(text)
    choice = reader.alternative()
    if reader.next is not None:
        raise reader.wrong(f"'{reader.next}' is one too many")
    return lambda path: choice(path.as_posix().lower())


class _Reader:
    """Reads an expression from left to right."""

    def __init__(self, text: str) -> None:
        self._text, self._tokens = text, _TOKEN.findall(text)
        self._at = 0

    @property
    def next(self) -> str | None:
        return self._tokens[self._at] if self._at < len(self._tokens) else None

    def wrong(self, why: str) -> InputError:
        return InputError(f"-k {self._text!r}: {why}; such as -k 'press and not (qp or pd)'")

    def _take(self, word: str) -> bool:
        if self.next != word:
            return False
        self._at += 1
        return True

    def alternative(self) -> Choice:
        found = [self._every()]
        while self._take("or"):
            found.append(self._every())
        return lambda path: any(choice(path) for choice in found)

    def _every(self) -> Choice:
        found = [self._one()]
        while self._take("and"):
            found.append(self._one())
        return lambda path: all(choice(path) for choice in found)

    def _one(self) -> Choice:
        if self._take("not"):
            inner = self._one()
            return lambda path: not inner(path)
        if self._take("("):
            choice = self.alternative()
            if not self._take(")"):
                raise self.wrong("a ')' is missing")
            return choice
        word = self.next
        if word is None or word in (")", "and", "or"):
            where = f"before '{word}'" if word else "at the end"
            raise self.wrong(f"a part of a path is needed {where}")
        self._at += 1
        return lambda path: word.lower() in path
