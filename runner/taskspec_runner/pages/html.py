"""Elements of HTML and SVG, with everything escaped that comes from outside."""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import Any

from markupsafe import Markup, escape

#: Elements that have no end.
_VOID = {"br", "img", "input", "meta"}
#: A sign before a number, and not a hyphen in a word or a minus between two numbers.
_MINUS = re.compile(r"(?<![\w)])-(?=[\d.])")
#: A sign with what it is the sign of: a browser would break the line after a hyphen.
_SIGNED = re.compile(r"((?<!\S)[+-]+\w\S*)")
#: A number and its unit.
_UNIT = re.compile(r"\d [A-Za-zµ][A-Za-zµ*/^0-9]*")
_KEY = re.compile(r"(\s*(?:- +)*)([\w.-]+)(:)(?=\s|$)")
_COMMENT = re.compile(r"(?:^|(?<=\s))#")


def element(name: str, /, *content: object, **attributes: Any) -> Markup:
    """An element such as `<p class="note">text</p>`.

    Args:
        name: of the element.
        content: markup, or text, which is escaped; None is left out.
        attributes: with `_` for `-`, and after a word of Python; None, False and an empty class
            are left out, True stands without a value.
    """
    start = f"<{name}"
    for key, value in attributes.items():
        word = key.rstrip("_").replace("_", "-")
        if value is None or value is False or (word == "class" and not value):
            continue
        start += f" {word}" if value is True else f' {word}="{escape(value)}"'
    if name in _VOID:
        return Markup(f"{start}>")
    return Markup(f"{start}>{joined(*content)}</{name}>")


def joined(*content: object) -> Markup:
    """Markup and text one after the other; None is left out."""
    return Markup("").join(escape(each) for each in content if each is not None)


def code(text: object) -> Markup:
    """Text as it was written in a file."""
    return element("code", text)


def small(text: object) -> Markup:
    """Text beside what it says something of, such as a unit; nothing of an empty one."""
    return Markup(" ") + element("small", text) if text else Markup("")


def prose(text: object) -> Markup:
    """Text as a page has it: code between backticks, real minus signs, units as on its charts."""
    parts = str(text).split("`")
    if len(parts) % 2 == 0:
        return escape(text)
    words = (_UNIT.sub(_as_on_charts, _MINUS.sub("−", part)) for part in parts[::2])
    codes = map(code, parts[1::2])
    return joined(*(x for pair in zip_longest(words, codes, fillvalue="") for x in pair))


def _as_on_charts(match: re.Match[str]) -> str:
    """A unit after a number, with real dots and micros: `N·m` and `µm`."""
    return re.sub(r"\bu(?=m\b|rad\b)", "µ", match[0].replace("*", "·"))


def expression(text: str) -> Markup:
    """An expression as code whose lines are broken between words, not after a sign."""
    parts = _SIGNED.split(text)
    return code(
        joined(*(element("span", p, class_="whole") if i % 2 else p for i, p in enumerate(parts)))
    )


def highlighted(text: str) -> Markup:
    """The text of a task file, in which keys are `<b>` and comments `<i>`."""
    return Markup("\n").join(_highlighted(line) for line in text.splitlines())


def _highlighted(line: str) -> Markup:
    # With its quoted parts blanked, so that a `#` in them is no comment.
    comment = _COMMENT.search(re.sub(r"\"[^\"]*\"|'[^']*'", lambda m: "_" * len(m.group()), line))
    at = comment.start() if comment else len(line)
    key = _KEY.match(line[:at])
    before = joined(key[1], element("b", key[2]), key[3]) if key else Markup("")
    rest = element("i", line[at:]) if line[at:] else Markup("")
    return before + line[key.end() if key else 0 : at] + rest
