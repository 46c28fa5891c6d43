"""Tables that a campaign writes into a page of docs."""

from __future__ import annotations

import re
from pathlib import Path


def write_table(page: Path, kind: str, rows: str) -> None:
    """Puts a table in the place of the one below its mark, `<!-- table: KIND -->`.

    Args:
        page: it.
        kind: of the table, by which the page has it.
        rows: all lines, the head among them.

    Raises:
        ValueError: the page has no such mark.
    """
    text, mark = page.read_text(encoding="utf-8"), f"<!-- table: {kind} -->\n"
    if mark not in text:
        raise ValueError(f"{page} has no {mark.strip()}")
    text = re.sub(rf"(?<={mark})(?:\|.*\n)*", lambda _: rows, text, count=1)
    page.write_text(text, encoding="utf-8")
