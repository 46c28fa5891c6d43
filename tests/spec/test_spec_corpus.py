"""Golden diagnostics, and what has to hold for all of them."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from taskspec.text.codes import CODES
from taskspec.text.diagnostic import Diagnostic
from taskspec.text.source import Source

sys.path.insert(0, str(Path(__file__).parent.parent / "corpus"))

from golden import ERRORS, GOOD, diagnostics_of, reading_of, rendered

#: A tool's sizes are asked for when a file is read, so no file comes as far as this one.
FROM_CODE_ALONE = {"TS407"}


def name(path: Path) -> str:
    return path.stem


@pytest.mark.parametrize("path", GOOD, ids=name)
def test_good_file_loads_without_a_word(path: Path) -> None:
    assert reading_of(path) == ()


@pytest.mark.parametrize("path", ERRORS, ids=name)
def test_diagnostics_are_the_golden_ones(path: Path) -> None:
    assert rendered(path) == path.with_suffix(".out").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", ERRORS, ids=name)
def test_diagnostics_are_sorted_and_told_once(path: Path) -> None:
    diagnostics, _ = diagnostics_of(path)
    places = [(d.span.line, d.span.column) if d.span else (0, 0) for d in diagnostics]
    assert places == sorted(places)
    assert len(set(diagnostics)) == len(diagnostics)


@pytest.mark.parametrize("path", ERRORS, ids=name)
def test_every_place_lies_in_the_text(path: Path) -> None:
    diagnostics, sources = diagnostics_of(path)
    for diagnostic in diagnostics:
        if diagnostic.span is not None:
            assert_inside(diagnostic, sources[diagnostic.source])


def assert_inside(diagnostic: Diagnostic, source: Source) -> None:
    span = diagnostic.span
    assert span is not None
    assert 1 <= span.line <= source.line_count
    # One past the end is where something is missing.
    assert 1 <= span.column <= len(source.line(span.line)) + 1
    assert (span.line, span.column) < (span.end_line, span.end_column)


def test_every_code_has_a_file_that_shows_it() -> None:
    shown = {d.code for path in ERRORS for d in diagnostics_of(path)[0]}
    assert sorted(set(CODES) - shown - FROM_CODE_ALONE) == []


def test_every_code_is_in_the_table() -> None:
    """What is raised anywhere in the two packages has a title, for `taskspec explain CODE`."""
    root = Path(__file__).parents[2]
    sources = [p for folder in ("taskspec", "runner") for p in (root / folder).rglob("*.py")]
    used = {c for p in sources for c in re.findall(r'"(TS\d{3})"', p.read_text("utf-8"))}
    assert sorted(used - set(CODES)) == []
    assert sorted(set(CODES) - used) == []


@pytest.mark.parametrize("path", ERRORS, ids=name)
def test_file_shows_the_code_that_it_is_named_after(path: Path) -> None:
    if named := re.match(r"TS\d{3}", path.stem):
        assert named[0] in {d.code for d in diagnostics_of(path)[0]}


def test_no_golden_file_is_left_over() -> None:
    folder = ERRORS[0].parent
    assert {p.stem for p in folder.glob("*.out")} == {p.stem for p in ERRORS}


def test_one_file_with_many_mistakes_tells_them_all() -> None:
    (path,) = (p for p in ERRORS if p.stem == "many_mistakes")
    diagnostics, _ = diagnostics_of(path)
    assert len({d.span.line for d in diagnostics if d.span}) == 13
