from __future__ import annotations

import pytest

import taskspec.spec  # noqa: F401  (it registers the codes of reading a file)
from taskspec.text.codes import CODES, register
from taskspec.text.diagnostic import Diagnostics, Severity, SpecError
from taskspec.text.render import Style, diagnostic_lines, headline, plain, render, visible
from taskspec.text.source import Source, Span
from taskspec.text.suggest import closest, suggestion


def test_the_form_of_the_design() -> None:
    lines = [""] * 30 + ["      z: {velocity: 0 mm/s, force: -15 N}"]
    source = Source("tasks/wipe.yaml", "\n".join(lines))
    found = Diagnostics(source.name)
    found.error(
        "TS203",
        "axis 'z' has both a velocity and a force under a hybrid law",
        Span(31, 10, 31, 11),
        "one or the other; a parallel law lets force win over position",
    )
    assert render(found.sorted(), {source.name: source}) == (
        "tasks/wipe.yaml:31:10: error[TS203]: "
        "axis 'z' has both a velocity and a force under a hybrid law\n"
        "   |\n"
        "31 |       z: {velocity: 0 mm/s, force: -15 N}\n"
        "   |          ^ one or the other; a parallel law lets force win over position"
    )


def test_sorted_by_place_and_told_once() -> None:
    found = Diagnostics("t")
    for line in (3, 1, 2, 1):
        found.warning("TS016", "x", Span(line, 1, line, 2))
    found.error("TS010", "y", None)
    assert [d.span.line if d.span else 0 for d in found.sorted()] == [0, 1, 2, 3]
    assert found.has_errors


def test_warnings_are_no_errors() -> None:
    found = Diagnostics("t")
    found.warning("TS016", "x", None)
    found.info("TS016", "y", None)
    assert not found.has_errors
    assert {d.severity for d in found.sorted()} == {Severity.WARNING, Severity.INFO}


def test_a_code_must_be_registered() -> None:
    with pytest.raises(AssertionError, match="TS999"):
        Diagnostics("t").error("TS999", "x", None)


def test_a_code_has_one_meaning() -> None:
    title = CODES["TS001"]
    for other in (title, "something else"):
        with pytest.raises(ValueError, match="TS001 is already taken"):
            register({"TS001": other})
    assert CODES["TS001"] == title


def test_places_in_other_texts() -> None:
    found = Diagnostics("t")
    found.error("TS004", "x", Span(1, 1, 1, 2, "--set"), notes=(("first", Span(1, 1, 1, 2)),))
    (diagnostic,) = found.sorted()
    assert diagnostic.source == "--set"
    assert diagnostic.notes[0].source == "t"
    shown = render([diagnostic], {"t": Source("t", "abc"), "--set": Source("--set", "def")})
    assert "1 | def" in shown
    assert "t:1:1: note: first\n  |\n1 | abc" in shown


def test_nothing_moves_the_cursor_of_a_terminal() -> None:
    source = Source("a\x1bb\n", "x: \x1b[2J\u202e\x07")
    found = Diagnostics(source.name)
    found.error("TS001", "bad \x1b[31m", Span(1, 4, 1, 5), "hint \x9b")
    shown = render(found.sorted(), {source.name: source})
    assert all(c == "\n" or c.isprintable() for c in shown)
    assert visible("a\x00") == "a\\x00"
    assert plain([headline(found.sorted()[0])]).startswith("a\\x1bb\\n:1:4: error[TS001]: ")


def test_pieces_have_styles() -> None:
    """Even where a line of the file looks like a part of the layout."""
    source = Source("t", "^^ | t: error[TS001]: x")
    found = Diagnostics("t")
    found.error("TS001", "bad", Span(1, 1, 1, 3), "one\ntwo", notes=(("other", Span(1, 4, 1, 5)),))
    assert list(diagnostic_lines(found.sorted(), {"t": source}))[:6] == [
        (("t:1:1: ", Style.PLACE), ("error[TS001]", Style.ERROR), (": bad", Style.MESSAGE)),
        (("  |", Style.MARGIN),),
        (("1 |", Style.MARGIN), (" ^^ | t: error[TS001]: x", Style.PLAIN)),
        (("  |", Style.MARGIN), (" ^^ one", Style.CARET)),
        (("  |", Style.MARGIN), ("    two", Style.PLAIN)),
        (("t:1:4: ", Style.PLACE), ("note", Style.NOTE), (": other", Style.MESSAGE)),
    ]


def test_caret_stands_under_wide_characters() -> None:
    source = Source("t", "a: 漢字 b")
    found = Diagnostics("t")
    found.error("TS001", "x", Span(1, 7, 1, 8))
    assert render(found.sorted(), {"t": source}).endswith("  | " + " " * 8 + "^")


def test_long_lines_are_cut_around_the_caret() -> None:
    source = Source("t", "x" * 5000 + "HERE" + "y" * 5000)
    found = Diagnostics("t")
    found.error("TS001", "m", Span(1, 5001, 1, 5005))
    _, _, line, caret = render(found.sorted(), {"t": source}).split("\n")
    assert len(line) < 140
    assert line[caret.index("^") : caret.rindex("^") + 1] == "HERE"


def test_a_text_that_is_not_at_hand() -> None:
    found = Diagnostics("t")
    found.error("TS001", "m", Span(1, 1, 1, 2), "do this")
    assert render(found.sorted(), {}) == "t:1:1: error[TS001]: m\n   = do this"


def test_error_carries_everything() -> None:
    found = Diagnostics("t")
    found.error("TS001", "m", None)
    error = SpecError(found.sorted(), {"t": Source("t", "x")})
    assert str(error) == "TS001: m"
    assert error.sources["t"].text == "x"


@pytest.mark.parametrize(
    ("word", "expected"),
    [("pres", "press"), ("PRESS", "press"), ("pre-ss", None), ("tabel", "table"), ("zzz", None)],
)
def test_did_you_mean(word: str, expected: str | None) -> None:
    found = closest(word, ["press", "table", "depth"])
    assert found == (expected or ("press" if word == "pre-ss" else None))


def test_short_lists_are_shown_when_nothing_is_near() -> None:
    assert suggestion("zzz", ["b", "a"], "frames") == "frames: b, a"
    assert suggestion("zzz", {"b", "a"}, "frames") == "frames: a, b"
    assert suggestion("zzz", ["a"]) == ""
    assert suggestion("zzz", [f"n{i}" for i in range(20)], "names").endswith("n11, …")
