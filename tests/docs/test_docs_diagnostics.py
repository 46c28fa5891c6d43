"""Every code has a page; its bad file gets that code, its good file gets nothing.

What a rule finds may end the trial too: beside the code of a rule there may be that of an end.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from diagnostic_pages import FAMILIES, INDEX, PAGES, Page, diagnostics_of, index, page, shown_of

from taskspec.text.codes import CODES
from taskspec_runner.cli.codes import page as shown
from taskspec_runner.cli.codes import severities_of

ROOT = Path(__file__).resolve().parents[2]

#: No file comes as far as this one: a tool's sizes are asked for when a file is read.
WITHOUT_A_FILE = {"TS407", "TS622", "TS623"}
#: Codes of what a trial may come to beside what a rule has found.
ENDS = {"TS424", "TS427", "TS428", "TS508", "TS521", "TS611", "TS616"}
WITH_A_FILE = [page(path) for path in PAGES if path.stem not in WITHOUT_A_FILE]


def name(of: Page) -> str:
    return of.code


def test_the_pages_are_those_of_the_codes():
    assert {path.stem for path in PAGES} == CODES.keys()
    assert {code[:3] for code in CODES} <= FAMILIES.keys()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_a_page_has_code_title_and_examples(path):
    this = page(path)
    assert (this.code, this.title) == (path.stem, CODES[path.stem])
    wanted = [] if this.code in WITHOUT_A_FILE else ["bad", "good"]
    assert list(this.examples) == wanted
    assert "**Fix:** " in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("of", WITH_A_FILE, ids=name)
def test_the_bad_file_gets_this_code_where_the_page_says(of, tmp_path):
    found, sources = diagnostics_of(of.examples["bad"], "bad.yaml", tmp_path)
    own = [d for d in found if d.code == of.code]
    assert len(own) == 1
    assert str(own[0].severity) in of.severities
    others = {d.code for d in found} - {of.code}
    assert others <= (set() if of.code in ENDS else ENDS)
    assert shown_of(found, sources, tmp_path) == of.examples["bad"].findings


@pytest.mark.parametrize("of", WITH_A_FILE, ids=name)
def test_the_good_file_gets_nothing(of, tmp_path):
    found, _ = diagnostics_of(of.examples["good"], "good.yaml", tmp_path)
    assert found == ()


@pytest.mark.parametrize("of", WITH_A_FILE, ids=name)
def test_the_good_file_is_the_bad_one_mended(of):
    """Most of its lines are the same, so that what matters can be seen."""
    bad = (of.examples["bad"].task + "".join(of.examples["bad"].files.values())).splitlines()
    good = (of.examples["good"].task + "".join(of.examples["good"].files.values())).splitlines()
    assert bad != good
    assert of.code == "TS010" or sum(line in good for line in bad) >= len(good) // 2


def test_pages_name_every_severity_that_the_golden_files_show():
    told_as: dict[str, set[str]] = {}
    for path in (ROOT / "tests" / "corpus" / "err").glob("*.out"):
        text = path.read_text(encoding="utf-8")
        for severity, code in re.findall(r": (error|warning|info)\[(TS\d{3})\]: ", text):
            told_as.setdefault(code, set()).add(severity)
    for path in PAGES:
        assert told_as.get(path.stem, set()) <= set(page(path).severities), path.stem


def test_the_index_lists_all_of_them():
    text = INDEX.read_text(encoding="utf-8")
    assert text.partition("## ")[1] + text.partition("## ")[2] == index()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_the_command_line_finds_the_page(path):
    text = shown(path.stem)
    assert text == path.read_text(encoding="utf-8")
    assert [str(severity) for severity in severities_of(text)] == list(page(path).severities)
