"""Formulas of the pages as MathML, which browsers draw by themselves."""

from __future__ import annotations

import re

from latex2mathml.converter import convert

_FENCE = re.compile(r"(^```.*?^```$)", re.M | re.S)
_FORMULA = re.compile(r"^\$\$(?P<tex>.+)\$\$$", re.M)
#: What encloses a part of a formula, and what one begins with.
_TOKEN = re.compile(
    r"(?P<opens>\\left(?![a-z]).|[{(])|(?P<closes>\\right(?![a-z]).|[})])"
    r"|(?<= )[=+-](?= )|\\(?:le|approx|quad|qquad)(?![a-z])"
)
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
    whole = tex if found is None else tex[: found.start()]
    first, *others = pieces(whole)
    # After an empty group a sign stands between two terms, and has the room of one that does.
    parts = [first, *(f"{{}} {part}" for part in others)]
    drawn = "".join(convert(part, display="block") for part in parts)
    label = f'<span class="formula-number">{number}</span>' if number else ""
    return f'<div class="formula"><div class="formula-parts">{drawn}</div>{label}</div>'


def pieces(tex: str) -> list[str]:
    """A formula cut where a line may end: before relations and terms that nothing encloses.

    A browser does not break a formula, and one that is wider than a phone's screen is cut off.
    """
    found, depth, begins = [], 0, 0
    for token in _TOKEN.finditer(tex):
        if token["opens"]:
            depth += 1
        elif token["closes"]:
            depth -= 1
        elif depth == 0 and tex[begins : token.start()].strip():
            found.append(tex[begins : token.start()])
            begins = token.start()
    return [*found, tex[begins:]]
