"""Templates of pages and pictures, with everything escaped that comes from outside."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

_HERE = Path(__file__).parent


def template(name: str, beside: Path = _HERE) -> Template:
    """A template by file name.

    Args:
        name: of the file. beside: the folder that it is in; those of the report are known to it.
    """
    environment = Environment(
        loader=FileSystemLoader([beside, _HERE]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def part(name: str, beside: Path = _HERE) -> Markup:
    """One of our own files, to be put into a page as it is."""
    return Markup((beside / name).read_text(encoding="utf-8"))


def script() -> Markup:
    """What draws the charts of a page."""
    parts = [part(f"script/{name}.js") for name in ("numbers", "plot", "legend", "page")]
    return Markup('(() => {{\n"use strict";\n{}\n}})();').format(Markup("\n").join(parts))
