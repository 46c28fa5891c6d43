"""A task file's text with its keys and comments marked up."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

_KEY = re.compile(r"(\s*(?:- +)*)([\w.-]+)(:)(?=\s|$)")
_COMMENT = re.compile(r"(?:^|(?<=\s))#")


def highlighted(text: str) -> Markup:
    """Escaped text in which keys are `<b>` and comments `<i>`."""
    return Markup("\n").join(_line(line) for line in text.splitlines())


def _line(line: str) -> Markup:
    comment = _COMMENT.search(_blanked(line))
    at = comment.start() if comment else len(line)
    code, rest = line[:at], line[at:]
    key = _KEY.match(code)
    shown = Markup("")
    if key:
        shown += Markup("{}<b>{}</b>{}").format(*key.groups())
        code = code[key.end() :]
    shown += escape(code)
    return shown + Markup("<i>{}</i>").format(rest) if rest else shown


def _blanked(line: str) -> str:
    """The line with its quoted parts blanked, so that a `#` in them is no comment."""
    return re.sub(r"\"[^\"]*\"|'[^']*'", lambda m: "_" * len(m.group()), line)
