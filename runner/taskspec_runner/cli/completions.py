"""What a shell completes beside options and paths; imported when it is wanted."""

from __future__ import annotations


def laws(incomplete: str) -> list[str]:
    """The laws whose names begin so."""
    from taskspec.laws import LAWS

    return [name for name in LAWS if name.startswith(incomplete)]


def codes(incomplete: str) -> list[str]:
    """The diagnostic codes that begin so, once a letter shows that no path is meant."""
    from taskspec_runner.cli.codes import codes_with_pages

    return [code for code in codes_with_pages() if incomplete and code.startswith(incomplete)]


def templates(incomplete: str) -> list[str]:
    """The templates whose names begin so."""
    from taskspec_runner.cli.new import templates
    from taskspec_runner.errors import InputError

    try:
        return [name for name in templates() if name.startswith(incomplete)]
    except InputError:
        return []
