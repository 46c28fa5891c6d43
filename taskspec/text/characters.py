"""Characters that a task file may not contain."""

from __future__ import annotations

import re
import unicodedata

from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Span

register(
    {
        "TS002": "a character that task files may not contain",
        "TS003": "a tab",
    }
)

_FORBIDDEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\xa0\xad\u061c\u1680\u180e\u2000-\u200a\u202f\u205f\u3000"
    "\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff\ufff9-\uffff"
    "\ud800-\udfff\U0001fffe\U0001ffff\U000e0000-\U000e0fff]"
)
"""Control, bidi, invisible and lone surrogate characters, and spaces that are none to YAML."""
_MOST_REPORTS = 20


def normal(text: str) -> str:
    """The text without a byte order mark and with plain line ends."""
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


def escaped(text: str) -> str:
    r"""A text from elsewhere as it may be printed: what is no printable character is written out.

    Line ends, bells, the beginnings of a terminal's commands and halves of surrogate pairs become
    what Python writes for them, such as \n, \x1b and \ud800.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def readable(text: str, diagnostics: Diagnostics) -> str | None:
    """Reports forbidden characters and tabs; returns the text with spaces in their places.

    Returns None if tabs indent it, since its structure cannot be known then.
    """
    matches = list(_FORBIDDEN.finditer(text))
    for match in matches[:_MOST_REPORTS]:
        diagnostics.error(
            "TS002",
            f"{_named(match[0])} may not stand in a task file",
            _span(text, match.start()),
            "delete it" + (_more(matches) if len(matches) > _MOST_REPORTS else ""),
        )
    if matches:
        text = _FORBIDDEN.sub(" ", text)
    if "\t" not in text:
        return text
    lines = [n for n, line in enumerate(text.split("\n"), 1) if "\t" in line]
    others = f" (and in {len(lines) - 1} more lines)" if len(lines) > 1 else ""
    diagnostics.error(
        "TS003", f"a tab{others}", _span(text, text.index("\t")), "indent and separate with spaces"
    )
    if re.search(r"^ *\t[ \t]*[^ \t#\n]", text, re.MULTILINE):
        return None
    return text.replace("\t", " ")


def first_forbidden(text: str) -> str | None:
    """The first forbidden character of a text in words, None if there is none."""
    match = _FORBIDDEN.search(text)
    return _named(match[0]) if match else None


def _named(character: str) -> str:
    unnamed = (
        "half a surrogate pair" if "\ud800" <= character <= "\udfff" else "a control character"
    )
    name = unicodedata.name(character, unnamed).lower()
    return f"the character U+{ord(character):04X} ({name})"


def _more(matches: list[re.Match[str]]) -> str:
    return f"; {len(matches) - _MOST_REPORTS} more follow"


def _span(text: str, index: int) -> Span:
    line = text.count("\n", 0, index) + 1
    column = index - text.rfind("\n", 0, index)
    return Span(line, column, line, column + 1)
