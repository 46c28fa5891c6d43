"""Task files as JSON has them, and places that lie inside a text."""

from __future__ import annotations

from taskspec.text.data import Items, Map, Real, TruthValue, Whole, to_data
from taskspec.text.diagnostic import Diagnostic, Diagnostics
from taskspec.text.nodes import Mapping
from taskspec.text.source import Source
from taskspec.text.yaml import read


def plain(value: object) -> object:
    """Return a datum as JSON has it."""
    if isinstance(value, Map):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, Items):
        return [plain(entry) for entry in value]
    if isinstance(value, TruthValue):
        return value.value
    if isinstance(value, Whole):
        return int(value)
    return float(value) if isinstance(value, Real) else str(value)


def data_of(text: str) -> object:
    """Return a task file as JSON has it."""
    found = Diagnostics("t")
    root = read(Source("t", text), found)
    assert isinstance(root, Mapping)
    return json_of(root)


def json_of(root: Mapping) -> object:
    """Return what was read of a task file as JSON has it."""
    return plain(to_data(root, Diagnostics("t")))


def assert_place(diagnostic: Diagnostic, source: Source) -> None:
    """Hold a diagnostic's place to lie inside its text and to cover something."""
    span = diagnostic.span
    if span is not None:
        assert 1 <= span.line <= source.line_count
        assert 1 <= span.column <= len(source.line(span.line)) + 1
        assert (span.line, span.column) < (span.end_line, span.end_column)
