"""The place of a cursor in a text that is being typed, which need not be whole.

A YAML reader gives up at the first thing that is wrong. Here a text is scanned once, by indentation
in block style and by brackets in flow style; what follows from a half-written line is its place.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import field, replace

from taskspec.deferred_methods import dataclass

_KEY = re.compile(
    r"""("[^"\n]*"|'[^'\n]*'|[^\s:{}\[\],#"'&*!|>%@`-][^:{}\[\],#\n]*?)\s*:(?=\s|$)"""
)
_WORD_OF_KEY = re.compile(r"""["']?[\w-]+["']?:[ ]+([A-Za-z][\w-]*)[ ]*(?=[,}#\n]|$)""")
_DASH = re.compile(r"-(\s+|$)")
_COMMENT = re.compile(r"(?:^|(?<=\s))#")


@dataclass(slots=True)
class Container:
    """A mapping or a list that is being written.

    Attributes:
        path: keys and indices that lead to it.
        flow: whether it stands in braces or brackets.
        lists: whether it is a list.
        indent: column of its entries, 0-based; of a flow one unused.
        keys: it has, in order, with the offset of each.
        key: whose value is being read; None between entries.
        index: of the entry that is being read, of a list.
    """

    path: tuple[str | int, ...]
    flow: bool
    lists: bool
    indent: int
    keys: dict[str, int] = field(default_factory=dict)
    key: str | None = None
    index: int = -1

    @property
    def inner(self) -> tuple[str | int, ...]:
        """The path of the entry that is being read."""
        if self.lists:
            return (*self.path, max(self.index, 0))
        return self.path if self.key is None else (*self.path, self.key)


@dataclass(frozen=True, slots=True)
class Cursor:
    """Where a cursor is.

    Attributes:
        path: of the mapping whose key is being written, or of the value.
        at_key: whether a key is being written, else a value.
        start: offset at which what is being written begins.
        prefix: what is written of it before the cursor.
        others: keys that the mapping has, beside the one that is being written, each with the word
            behind it; empty where that is no word.
        flow: whether it is in braces or brackets.
    """

    path: tuple[str | int, ...]
    at_key: bool
    start: int
    prefix: str
    others: Mapping[str, str]
    flow: bool


def cursor_at(text: str, offset: int) -> Cursor:
    """The place of a cursor before the character at `offset`."""
    scan = _Scan(text, offset)
    scan.run()
    assert scan.found is not None
    return scan.found


class _Scan:
    def __init__(self, text: str, offset: int) -> None:
        self.text, self.at = text, min(offset, len(text))
        self.found: Cursor | None = None
        #: What `found` is in, whose later keys count as well.
        self._within: Container | None = None
        self._stack = [Container((), flow=False, lists=False, indent=0)]
        self._token = 0

    def run(self) -> None:
        """Scans the text line by line."""
        start = 0
        for line in self.text.split("\n"):
            self._line(line, start)
            start += len(line) + 1
        if self.found is not None and self._within is not None and self.found.at_key:
            found, keys = self.found, self._within.keys
            others = {key: self._word(at) for key, at in keys.items() if at != found.start}
            self.found = replace(found, others=others)

    def _word(self, at: int) -> str:
        """The word behind the key that begins at an offset."""
        match = _WORD_OF_KEY.match(self.text, at)
        return match[1] if match else ""

    def _line(self, line: str, start: int) -> None:
        here = start <= self.at <= start + len(line)
        column = 0
        if not self._stack[-1].flow:
            column = len(line) - len(line.lstrip(" "))
            rest = line[column:]
            empty = not rest or rest.startswith("#")
            if empty and not here:
                return
            if empty:
                # Where nothing is written yet, the column of the cursor says what it belongs to.
                column = min(column, self.at - start) if rest else self.at - start
                self._open_block(column, list_item=False)
                self._place(start + column, block=True)
                return
            column = self._entries(line, column, start)
        self._scan(line, column, start, here=here)

    def _entries(self, line: str, column: int, start: int) -> int:
        """Dashes and the key at the beginning of a block line; returns where its value begins."""
        while match := _DASH.match(line, column):
            self._open_block(column, list_item=True)
            self._stack[-1].index += 1
            if start + column < self.at <= start + match.end() and match.end() >= len(line):
                self._place(self.at, block=True)
            column = match.end()
        match = _KEY.match(line, column)
        if match is None:
            if not self._stack[-1].lists or column > self._stack[-1].indent:
                self._open_block(column, list_item=False, scalar=True)
            self._token = start + column
            return column
        self._open_block(column, list_item=False)
        key = match[1].strip("\"'")
        block = self._stack[-1]
        if start <= self.at <= start + match.end(1):
            block.key = None
            self._place(start + column, block=True)
        block.keys.setdefault(key, start + column)
        block.key = key
        self._token = start + match.end()
        return match.end()

    def _open_block(self, column: int, *, list_item: bool, scalar: bool = False) -> None:
        """Makes the block that has entries at a column the innermost one."""
        while len(self._stack) > 1 and (self._stack[-1].flow or self._stack[-1].indent > column):
            self._stack.pop()
        top = self._stack[-1]
        if top.indent == column and top.lists == list_item:
            if not list_item:
                top.key = None
            return
        if top.indent == column and top.lists and not list_item:
            # A key at the column of dashes goes on with the mapping around the list.
            self._stack.pop()
            self._open_block(column, list_item=False, scalar=scalar)
            return
        if scalar and not top.lists and top.key is None and len(self._stack) == 1:
            return
        self._stack.append(Container(top.inner, flow=False, lists=list_item, indent=column))

    def _scan(self, line: str, column: int, start: int, *, here: bool) -> None:
        """The rest of a line: values, brackets and what is between them."""
        position = column
        while position <= len(line):
            ends = position == len(line)
            comment = not ends and line[position] == "#" and _COMMENT.match(line, position)
            if here and (comment or start + position >= self.at):
                self._place(self._token)
            if ends or comment:
                break
            position = self._sign(line, position, start)
        if not self._stack[-1].flow:
            self._token = start + len(line)

    def _sign(self, line: str, position: int, start: int) -> int:
        """Takes the character at a position; returns where to go on."""
        sign, flow = line[position], self._stack[-1].flow
        if sign in "\"'":
            end = line.find(sign, position + 1)
            return len(line) if end < 0 else end + 1
        if sign in "{[":
            inner = Container(self._stack[-1].inner, flow=True, lists=sign == "[", indent=-1)
            inner.index = 0
            self._stack.append(inner)
        elif sign in "}]" and flow:
            self._entry_ends(start + position)
            self._stack.pop()
        elif sign == "," and flow:
            self._entry_ends(start + position)
        elif not (sign == ":" and flow and self._colon(line, position, start)):
            return position + 1
        self._token = start + position + 1
        return position + 1

    def _colon(self, line: str, position: int, start: int) -> bool:
        """Takes what stands before a colon as a key, where it is one."""
        top = self._stack[-1]
        if line[position + 1 : position + 2] not in ("", " ") or top.lists or top.key is not None:
            return False
        raw = self.text[self._token : start + position]
        key = raw.strip().strip("\"'")
        top.keys.setdefault(key, self._token + len(raw) - len(raw.lstrip()))
        top.key = key
        return True

    def _entry_ends(self, at: int) -> None:
        top = self._stack[-1]
        if not top.lists and top.key is None and (word := self.text[self._token : at].strip()):
            # A key without a value yet.
            raw = self.text[self._token : at]
            top.keys.setdefault(word, self._token + len(raw) - len(raw.lstrip()))
        top.key = None
        top.index += 1

    def _place(self, token: int, *, block: bool = False) -> None:
        """The cursor is here; what is being written begins at `token`."""
        if self.found is not None:
            return
        token = min(token, self.at)
        raw = self.text[token : self.at]
        start = token + len(raw) - len(raw.lstrip())
        top = self._stack[-1]
        at_key = not top.lists and top.key is None
        if block and top.lists:
            at_key = False
        path = top.path if at_key else top.inner
        self._within = top
        self.found = Cursor(path, at_key, start, self.text[start : self.at], {}, top.flow)
