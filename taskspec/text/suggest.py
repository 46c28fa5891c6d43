"""Did you mean: the nearest of the names that would have been right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

_MOST_CHOICES = 12
"""Longer lists of choices are not read by anyone."""
_MOST_COMPARISONS = 300
"""Comparing with more names than this would take longer than reading the file."""


def closest(word: str, options: Iterable[str]) -> str | None:
    """The option most like `word`, or None if none is like it."""
    folded = {_fold(c): c for c in islice(options, _MOST_COMPARISONS)}
    wanted = _fold(word)
    if wanted in folded:
        return folded[wanted]
    near = difflib.get_close_matches(wanted[:80], folded, n=1, cutoff=0.6)
    return folded[near[0]] if near else None


def _fold(word: str) -> str:
    return word.lower().replace("-", "_")


def suggestion(word: str, options: Iterable[str], what: str = "") -> str:
    """A hint: the nearest option, else the list of options, else nothing.

    Args:
        word: what was written.
        options: what would have been right.
        what: the plural that names the options, such as `frames`; without it no list is given.
    """
    choices = sorted(options) if isinstance(options, set | frozenset) else list(options)
    near = closest(word, choices)
    if near is not None:
        return f"did you mean '{near}'?"
    if what and choices:
        shown = ", ".join(choices[:_MOST_CHOICES]) + (", …" if len(choices) > _MOST_CHOICES else "")
        return f"{what}: {shown}"
    return ""
