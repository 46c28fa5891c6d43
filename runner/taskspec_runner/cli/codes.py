"""The diagnostic codes: those that `--select TS2,TS301 --ignore TS203` chooses, and their pages.

The pages are those of the repository, which the wheel carries too.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from importlib import resources
from pathlib import Path

from taskspec.text.codes import CODES
from taskspec.text.diagnostic import Severity
from taskspec_runner.errors import InputError

_SHOWN = 12
_SEVERITY = "**Severity:** "


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

    # Without MuJoCo there is no trial, and no code of it.
    with contextlib.suppress(ImportError):
        import taskspec_runner.trial.reported  # noqa: F401


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


def page(code: str) -> str | None:
    """The page of a code as Markdown, or None if it has none."""
    for folder in _folders():
        path = folder / f"{code}.md"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    return None


def codes_with_pages() -> list[str]:
    """All codes that have a page."""
    return sorted({path.stem for folder in _folders() for path in folder.glob("TS*.md")})


def _folders() -> tuple[Path, ...]:
    package = Path(str(resources.files("taskspec")))
    return package / "data" / "diagnostics", package.parent / "docs" / "diagnostics"


def severities_of(text: str) -> list[Severity]:
    """The severities with which a page says that its code is reported, the usual one first."""
    (line,) = (line for line in text.splitlines() if line.startswith(_SEVERITY))
    return [Severity(word) for word in line.removeprefix(_SEVERITY).rstrip(".").split(", or ")]
