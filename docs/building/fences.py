"""Blocks of the pages: files stand under their names."""

from __future__ import annotations

import re

_FILE = re.compile(
    r"^(?P<comment><!-- (?:(?:task|part): .+ as|file:) (?P<name>\S+) -->)\n```(?P<language>\w+)$",
    re.M,
)


def dressed(markdown: str) -> str:
    """The text of a page; blocks of files get titles."""
    return _FILE.sub(r'\g<comment>\n```\g<language> title="\g<name>"', markdown)
