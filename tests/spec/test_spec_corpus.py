"""Golden diagnostics, and what has to hold for all of them."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import yaml

from taskspec.text.codes import CODES
from taskspec.text.diagnostic import Diagnostic
from taskspec.text.source import Source

sys.path.insert(0, str(Path(__file__).parent.parent / "corpus"))

from golden import ERRORS, FOLDER, GOOD, diagnostics_of, expected, of_files, reading_of, rendered

#: A tool's sizes are checked when a file is read, so no file comes as far as TS407; worlds of
#: `vary` are run where `validate --worlds` wants it (TS622).
FROM_CODE_ALONE = {"TS407", "TS622", "TS623"}
#: Files that do not show the code that they are named after, and why.
ACCEPTED: dict[str, str] = yaml.safe_load((FOLDER / "accepted.yaml").read_text(encoding="utf-8"))
#: Codes whose messages may say all there is to do: which form, kind, number or name is needed.
WITHOUT_A_HINT = {
    "TS001", "TS002", "TS009", "TS015", "TS021", "TS022", "TS023", "TS027", "TS090", "TS101",
    "TS112", "TS113", "TS114", "TS115", "TS117", "TS118", "TS119", "TS208", "TS224", "TS314",
    "TS404",
}  # fmt: skip


@of_files(GOOD)
def test_good_file_loads_without_a_word(path: Path) -> None:
    assert reading_of(path) == ()


@of_files(ERRORS)
def test_diagnostics_are_the_golden_ones(path: Path) -> None:
    assert rendered(path) == path.with_suffix(".out").read_text(encoding="utf-8")


@of_files(ERRORS)
def test_diagnostics_are_sorted_and_told_once(path: Path) -> None:
    diagnostics, _ = diagnostics_of(path)
    places = [(d.span.line, d.span.column) if d.span else (0, 0) for d in diagnostics]
    assert places == sorted(places)
    assert len(set(diagnostics)) == len(diagnostics)


@of_files(ERRORS)
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
    shown = {code for path in ERRORS for _, code in expected(path)}
    assert sorted(set(CODES) - shown - FROM_CODE_ALONE) == []


def test_every_code_is_in_the_table() -> None:
    """What is raised anywhere in the two packages has a title, for `taskspec explain CODE`."""
    root = Path(__file__).parents[2]
    sources = [p for folder in ("taskspec", "runner") for p in (root / folder).rglob("*.py")]
    used = {c for p in sources for c in re.findall(r'"(TS\d{3})"', p.read_text("utf-8"))}
    assert sorted(used - set(CODES)) == []
    assert sorted(set(CODES) - used) == []


@of_files(ERRORS)
def test_file_shows_the_code_that_it_is_named_after(path: Path) -> None:
    """But for those that are accepted in writing, which do not show it."""
    if named := re.match(r"TS\d{3}", path.stem):
        shown = named[0] in {d.code for d in diagnostics_of(path)[0]}
        assert shown is (path.stem not in ACCEPTED)


def test_what_is_accepted_is_few_files_each_with_a_reason() -> None:
    assert ACCEPTED.keys() <= {path.stem for path in ERRORS}
    assert 0 < len(ACCEPTED) < 10
    assert all(len(reason) > 40 for reason in ACCEPTED.values())


def test_no_golden_file_is_left_over() -> None:
    folder = ERRORS[0].parent
    assert {p.stem for p in folder.glob("*.out")} == {p.stem for p in ERRORS}


def test_one_file_with_many_mistakes_tells_them_all() -> None:
    (path,) = (p for p in ERRORS if p.stem == "many_mistakes")
    diagnostics, _ = diagnostics_of(path)
    assert len({d.span.line for d in diagnostics if d.span}) == 13


#: Files in which there is nothing to point at.
WITHOUT_A_PLACE = {"TS010_empty", "TS010_comment_only"}
HEADLINE = re.compile(
    r"^(?P<file>[^:\s]+):(?P<line>\d+):(?P<column>\d+): "
    r"(?P<severity>error|warning|info)\[(?P<code>TS\d{3})\]: ",
    re.MULTILINE,
)


def positions(path: Path) -> list[tuple[str, int, int, str, str]]:
    """What the golden file says of one: file, line, column, severity and code of each finding."""
    text = path.with_suffix(".out").read_text(encoding="utf-8")
    found = [
        (Path(m["file"]).name, int(m["line"]), int(m["column"]), m["severity"], m["code"])
        for m in HEADLINE.finditer(text)
    ]
    # No finding is left out for want of a place, but of a file that is empty.
    assert len(found) == len(re.findall(r"\[TS\d{3}\]: ", text)) or path.stem in WITHOUT_A_PLACE
    return found


@of_files(ERRORS)
def test_every_finding_has_its_code_at_its_position(path: Path) -> None:
    diagnostics, _ = diagnostics_of(path)
    found = [
        (Path(d.source).name, d.span.line, d.span.column, str(d.severity), d.code)
        for d in diagnostics
        if d.span is not None
    ]
    assert found == positions(path)


def test_there_are_bad_files_enough_and_each_is_told_something() -> None:
    assert len(ERRORS) >= 300
    silent = WITHOUT_A_PLACE | ACCEPTED.keys()
    assert all(positions(path) or path.stem in silent for path in ERRORS)


def test_every_code_has_its_own_bad_file() -> None:
    """A file named after its code, so that it can be found."""
    named = {match[0] for path in ERRORS if (match := re.match(r"TS\d{3}", path.stem))}
    assert sorted(set(CODES) - named - FROM_CODE_ALONE) == []


@of_files(ERRORS)
def test_errors_and_warnings_say_how_to_mend(path: Path) -> None:
    """Findings without a hint are those that name what is wrong and where, and need no more."""
    diagnostics, _ = diagnostics_of(path)
    for diagnostic in diagnostics:
        assert diagnostic.hint or diagnostic.notes or diagnostic.code in WITHOUT_A_HINT, diagnostic
