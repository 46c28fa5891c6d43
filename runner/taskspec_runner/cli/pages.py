"""The pages of the diagnostic codes: those of the repository, which the wheel carries too."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from taskspec.text.diagnostic import Severity

_SEVERITY = "**Severity:** "


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
