"""Templates beside this file, with everything escaped that comes from outside."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

_HERE = Path(__file__).parent


def template(name: str) -> Template:
    """A template by file name."""
    environment = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def part(name: str) -> Markup:
    """One of our own files, to be put into a page as it is."""
    return Markup((_HERE / name).read_text(encoding="utf-8"))
