"""Formulas of the pages as MathML, which browsers draw by themselves."""

from __future__ import annotations

import re

from latex2mathml.converter import convert

_FENCE = re.compile(r"(^```.*?^```$)", re.M | re.S)
_FORMULA = re.compile(r"^\$\$(?P<tex>.+)\$\$$", re.M)
#: The number that ends a formula, in brackets: (4.21), \text{(4.3.3)}, (4.36)\text{–}(4.39).
_NUMBER = re.compile(r"\s*\\qquad\s*(?P<number>(?:\\text\{)?\(4\..*)$")


def as_mathml(markdown: str) -> str:
    """The text of a page with its formulas, lines between two `$$`, drawn by the browser."""
    parts = _FENCE.split(markdown)
    parts[::2] = (_FORMULA.sub(lambda m: _formula(m["tex"]), part) for part in parts[::2])
    return "".join(parts)


def _formula(tex: str) -> str:
    found = _NUMBER.search(tex)
    number = "" if found is None else re.sub(r"\\text\{([^}]*)\}", r"\1", found["number"])
    drawn = convert(tex if found is None else tex[: found.start()], display="block")
    label = f'<span class="formula-number">{number}</span>' if number else ""
    return f'<div class="formula">{drawn}{label}</div>'
