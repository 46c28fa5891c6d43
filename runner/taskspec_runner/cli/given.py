"""Files and overrides as the command line gives them, before anything is read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from taskspec.text.source import OVERRIDES
from taskspec_runner.errors import InputError

#: The path that stands for standard input; a file of this name is `./-`.
STDIN = Path("-")
#: The source in which the value of `--law` is shown.
LAW = "--law"
#: The sources in which values stand that were given on the command line.
OPTIONS = (OVERRIDES, LAW)


def task_name(path: Path) -> str:
    """A task's name made from that of its file."""
    words = re.sub(r"[^a-z0-9]+", "-", path.stem.lower()).strip("-")
    return words if words[:1].isalpha() else f"task-{words}".strip("-")


def changes(sets: Sequence[str], law: str | None) -> dict[str, str]:
    """The overrides that `--set` gives.

    Raises:
        InputError: an override is not one, or `--law` is empty.
    """
    given = dict(_override(text) for text in sets)
    if law is not None and not law.strip():
        from taskspec.laws import LAWS

        raise InputError(f"--law needs the name of a law: {', '.join(LAWS)}")
    return given


def _override(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"--set needs KEY=VALUE, such as params.press=20N, not {text!r}")
    if key.strip() == "vary":
        raise InputError(
            "--set cannot replace the whole of 'vary'; name one of its entries, such as "
            "--set 'vary.world.table.stiffness=10..20 kN/m'"
        )
    return key.strip(), value


def check_page(page: Path | None) -> None:
    """Finds out whether `--html` names a page.

    Raises:
        InputError: it names another kind of file.
    """
    if page is not None and page.suffix not in (".html", ".htm"):
        raise InputError(f"--html needs a file that ends in .html, not {page}")
