"""Templates of pages and pictures, with everything escaped that comes from outside."""

from __future__ import annotations

import re
from functools import cache
from itertools import zip_longest
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup, escape

#: A sign before a number, and not a hyphen in a word or a minus between two numbers.
_MINUS = re.compile(r"(?<![\w)])-(?=[\d.])")
#: A sign with what it is the sign of: a browser would break the line after a hyphen.
_SIGNED = re.compile(r"((?<!\S)[+-]+\w\S*)")
#: A number and its unit.
_UNIT = re.compile(r"\d [A-Za-zµ][A-Za-zµ*/^0-9]*")
_HERE = Path(__file__).parent


def template(name: str, beside: Path = _HERE) -> Template:
    """A template by file name.

    Args:
        name: of the file.
        beside: the folder that it is in; those of the report are known to it.
    """
    return _environment(beside).get_template(name)


@cache
def _environment(beside: Path) -> Environment:
    """What reads templates beside one another; it compiles each of them once."""
    environment = Environment(
        loader=FileSystemLoader([beside, _HERE]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["prose"] = prose
    environment.filters["expression"] = expression
    return environment


def prose(text: str) -> Markup:
    """Text as a page has it: code between backticks, real minus signs, units as on its charts."""
    parts = str(text).split("`")
    if len(parts) % 2 == 0:
        return escape(text)
    words = (_UNIT.sub(_as_on_charts, _MINUS.sub("−", part)) for part in parts[::2])
    shown = [escape(word) for word in words]
    codes = [Markup("<code>{}</code>").format(code) for code in parts[1::2]]
    return Markup("").join(x for pair in zip_longest(shown, codes, fillvalue="") for x in pair)


def _as_on_charts(match: re.Match[str]) -> str:
    """A unit after a number, with real dots and micros: `N·m` and `µm`."""
    return re.sub(r"\bu(?=m\b|rad\b)", "µ", match[0].replace("*", "·"))


def expression(text: str) -> Markup:
    """An expression as code whose lines are broken between words, not after a sign."""
    parts = enumerate(_SIGNED.split(text))
    whole = Markup('<span class="whole">{}</span>')
    return Markup("<code>{}</code>").format(
        Markup("").join(whole.format(part) if i % 2 else escape(part) for i, part in parts)
    )


def part(name: str, beside: Path = _HERE) -> Markup:
    """One of our own files, to be put into a page as it is."""
    return Markup((beside / name).read_text(encoding="utf-8"))


#: What draws signals over time.
_OVER_TIME = ("samples", "plot", "legend", "save", "page")


def script(*own: Markup) -> Markup:
    """What draws the charts of a page.

    Args:
        own: scripts of a page that has no signals over time, instead of those that draw these.
    """
    shared = [part(f"script/{name}.js") for name in ("numbers", "svg")]
    others = [part("script/save.js"), *own] if own else [
        part(f"script/{name}.js") for name in _OVER_TIME
    ]  # fmt: skip
    text = Markup("\n").join([*shared, *others])
    return Markup('(() => {{\n"use strict";\n{}\n}})();').format(text)
