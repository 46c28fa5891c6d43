"""Codes chosen by their beginnings, as `--select TS2,TS301 --ignore TS203` does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from taskspec.text.codes import CODES
from taskspec_runner.errors import InputError

_SHOWN = 12


def choice(select: Sequence[str], ignore: Sequence[str]) -> Callable[[str], bool]:
    """A test of codes; where both lists name a code, the longer prefix decides, a tie ignores it.

    Args:
        select: prefixes, commas between them; none stands for every code.
        ignore: prefixes, commas between them.

    Raises:
        InputError: no code begins with one of the prefixes.
    """
    wanted, unwanted = _prefixes(select, "--select"), _prefixes(ignore, "--ignore")

    def chosen(code: str) -> bool:
        selected = _longest(code, wanted) if wanted else 0
        return selected is not None and selected > (_longest(code, unwanted) or -1)

    return chosen


def title_of(code: str) -> str:
    """The title of a code, which may have been found without what registers it."""
    if code not in CODES:
        _register_all()
    return CODES[code]


def _register_all() -> None:
    """The later layers register their codes when they are imported."""
    import taskspec.examination  # noqa: F401


def _longest(code: str, prefixes: Iterable[str]) -> int | None:
    return max((len(p) for p in prefixes if code.startswith(p)), default=None)


def _prefixes(texts: Sequence[str], option: str) -> tuple[str, ...]:
    prefixes = [part.strip().upper() for text in texts for part in text.split(",")]
    if not prefixes:
        return ()
    _register_all()
    for prefix in prefixes:
        if not prefix or not any(code.startswith(prefix) for code in CODES):
            raise InputError(f"{option}: no code begins with {prefix!r}; {_near(prefix)}")
    return tuple(prefixes)


def _near(prefix: str) -> str:
    """Codes that begin as long as possible like a prefix, or the families of codes."""
    for length in range(len(prefix) - 1, len("TS"), -1):
        near = sorted(code for code in CODES if code.startswith(prefix[:length]))
        if near:
            shown = ", ".join(near[:_SHOWN]) + (", …" if len(near) > _SHOWN else "")
            return f"there are {shown}"
    return f"codes begin with {', '.join(sorted({code[:3] for code in CODES}))}"
