"""Words that people search for, from the page that has them."""

from __future__ import annotations

import re

_ROW = re.compile(r"^\| (?P<words>[^|]+) \|[^|]*?\]\((?P<page>[^)#\s]+)", re.M)


def tags_of(text: str) -> dict[str, tuple[str, ...]]:
    """Pages to the words that lead to them: words of a row lead to the first page that it links."""
    found: dict[str, tuple[str, ...]] = {}
    for row in _ROW.finditer(text):
        words = tuple(word.strip() for word in row["words"].split(","))
        found[row["page"]] = (*found.get(row["page"], ()), *words)
    return found
