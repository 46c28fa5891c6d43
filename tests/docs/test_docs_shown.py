"""What pages show step by step is what files hold and commands say."""

from __future__ import annotations

import pytest
from documents import DOCUMENTS, ROOT
from shown_pages import DOCS, pages, same, shown, task_file

PAGES = pages()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_blocks_are_those_of_files_and_commands(path, tmp_path):
    for block in shown(path, tmp_path):
        assert same(block.text, block.fresh), f"{block.label}: python tests/docs/shown_pages.py"


def test_every_task_beside_the_pages_is_shown_on_one():
    texts = "".join(path.read_text(encoding="utf-8") for path in PAGES)
    files = sorted(DOCS.rglob("*.yaml"))
    assert files
    for file in files:
        name = file.relative_to(DOCS).as_posix()
        assert f"<!-- task: {name} as " in texts or f"<!-- part: {name} as " in texts, name


def test_the_tutorial_ends_with_a_task_that_passes():
    """Its last run meets what its last file expects."""
    text = (DOCS / "tutorial" / "tune.md").read_text(encoding="utf-8")
    *_, last = text.split("<!-- output: taskspec run wipe.yaml -->")
    file, _ = task_file("tutorial/wipe-5.yaml as wipe.yaml")
    assert "3 of 3 expectations met" in last
    assert file.read_text(encoding="utf-8").count("\n  - ") == 3


def test_numbers_may_round_differently_and_words_may_not():
    assert same("RMS 0.232 N at 10 Hz\n", "RMS 0.233 N at 10 Hz\n")
    assert not same("RMS 0.232 N\n", "RMS 0.332 N\n")
    assert not same("RMS 0.232 N\n", "RMS -0.232 N\n")
    assert not same("pass\n", "FAIL\n")


def test_documents_are_looked_at():
    assert set(PAGES) < set(DOCUMENTS)
    assert ROOT / "docs" / "tutorial" / "press.md" in PAGES
