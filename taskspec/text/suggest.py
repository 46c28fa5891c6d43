"""Did you mean: the nearest of the names that would have been right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import lru_cache
from itertools import islice

_MOST_CHOICES = 12
"""Longer lists of choices are not read by anyone."""
_MOST_COMPARISONS = 300
"""Comparing with more names than this would take longer than reading the file."""

#: Letters of a part by which a word is known.
_SHORTEST_PART = 3


def closest(word: str, options: Iterable[str]) -> str | None:
    """The option that `word` is a slip of, or None.

    A slip is a few letters that are wrong, missing, too many or exchanged, a word that is cut
    short, or one with words before it, as `max_force`. A likeness that is less, such as that of
    `axis` and `radius`, is one of other words.
    """
    return _closest(word, tuple(islice(options, _MOST_COMPARISONS)))


@lru_cache(maxsize=1024)
def _closest(word: str, options: tuple[str, ...]) -> str | None:
    """The same; a slip that stands in a template is one of each stage that uses it."""
    folded = {_fold(option): option for option in options}
    wanted = _fold(word)
    if wanted in folded:
        return folded[wanted]
    near = difflib.get_close_matches(wanted[:80], folded, n=3, cutoff=0.6)
    return next((folded[each] for each in near if _is_slip(wanted[:80], each)), None)


def _is_slip(word: str, option: str) -> bool:
    """Whether a word is an option with few mistakes, a part of it, or ends in it."""
    short, long = sorted((word, option), key=len)
    if len(short) >= _SHORTEST_PART and (long.startswith(short) or long.endswith(f"_{short}")):
        return True
    # The first letter of a word is seldom missed.
    most = round(len(long) / 3) if word[:1] == option[:1] else len(long) // 4
    return distance(word, option) <= max(1, most)


def distance(a: str, b: str) -> int:
    """Letters to insert, leave out, replace, or exchange with their neighbour, to make b of a."""
    before: list[int] = []
    row = list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        above, row = row, [i]
        for j, other in enumerate(b, 1):
            cost = min(above[j] + 1, row[j - 1] + 1, above[j - 1] + (letter != other))
            if i > 1 and j > 1 and letter == b[j - 2] and a[i - 2] == other:
                cost = min(cost, before[j - 2] + 1)
            row.append(cost)
        before = above
    return row[-1]


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
