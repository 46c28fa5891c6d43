"""Errors of the compiler, at their place in the task file."""

from __future__ import annotations

from taskspec.spec import KeyPath, LoadedTask
from taskspec.text.diagnostic import Diagnostics, SpecError


def spec_error(
    loaded: LoadedTask, place: KeyPath, code: str, message: str, hint: str = ""
) -> SpecError:
    """One finding about one place of a loaded task, ready to be raised."""
    found = Diagnostics(loaded.source.name)
    found.error(code, message, loaded.span(place), hint)
    return SpecError(found.sorted(), loaded.sources)
