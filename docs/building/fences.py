"""Blocks of the pages: files stand under their names, messages with the ends of their lines."""

from __future__ import annotations

import re

_FILE = re.compile(
    r"^(?P<comment><!-- (?:(?:task|part): .+ as|file:) (?P<name>\S+) -->)\n```(?P<language>\w+)$",
    re.M,
)
_MESSAGES = re.compile(
    r"^(?P<before><!-- told: taskspec validate .+ -->\n|is told:\n\n)```(\w+)$", re.M
)
#: Tables with an explanation behind them: their lines are broken where there is room for the rest.
_TABLES = re.compile(r"^(<!-- told: taskspec (?:run|new) .+ -->\n)```console$", re.M)


def dressed(markdown: str) -> str:
    """The text of a page; blocks of files get titles, and long lines of messages are broken."""
    titled = _FILE.sub(r'\g<comment>\n```\g<language> title="\g<name>"', markdown)
    broken = _MESSAGES.sub(r"\g<before>``` { .\g<2> .broken }", titled)
    return _TABLES.sub(r"\1``` { .console .roomy }", broken)
