"""Rich on both streams: tables on standard output, a progress line on standard error."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

#: Columns of what is not a terminal: enough for a table never to be folded there.
_ENDLESS = 10_000


def console(*, err: bool = False) -> Console:
    """A console on one of the streams; plain where that is not a terminal."""
    from rich.console import Console

    stream = sys.stderr if err else sys.stdout
    return Console(
        file=stream,
        highlight=False,
        emoji=False,
        soft_wrap=False,
        width=None if stream.isatty() else _ENDLESS,
    )


def show(*things: RenderableType) -> None:
    """Prints things on standard output, one below the other."""
    out = console()
    if out.is_terminal:
        out.print(*things, sep="\n")
        return
    with out.capture() as captured:
        out.print(*things, sep="\n")
    # Tables pad their last column, which is of no use to a program that reads them.
    out.file.write("\n".join(line.rstrip() for line in captured.get().split("\n")))


def table(*headings: str, indent: int = 2, right: tuple[str, ...] = ()) -> Table:
    """An empty table without lines; the headings in `right` stand above numbers."""
    from rich.table import Table

    made = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold dim")
    for number, heading in enumerate(headings):
        made.add_column(
            " " * (indent if number == 0 else 0) + heading,
            justify="right" if heading in right else "left",
            overflow="fold",
        )
    return made
