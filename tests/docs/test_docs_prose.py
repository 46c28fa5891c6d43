"""How the pages of the language are written: an example first, sentences that end."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from documents import LANGUAGE, text_of

#: The most words of a sentence.
LONGEST = 40
PAGES = sorted(LANGUAGE.glob("*.md"))


def sentences(text: str) -> list[str]:
    """The sentences of a page, of its tables too; blocks of code and targets of links left out."""
    text = re.sub(r"^```.*?^```$|<!--.*?-->", "", text, flags=re.M | re.S)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    parts = re.split(r"\n\s*\n|\n(?=\s*(?:[-*#]|\d+\.) )|\n(?=\|)| \| ", text)
    return [s for part in parts for s in re.split(r"(?<=[.!?])[*)]*\s+", part) if s.strip()]


def test_there_are_pages():
    assert len(PAGES) > 20


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_sentences_are_short(path: Path):
    counted = {s: len(re.findall(r"\S*\w\S*", s)) for s in sentences(text_of(path))}
    assert counted
    assert {s: words for s, words in counted.items() if words > LONGEST} == {}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_an_example_comes_first(path: Path):
    """A block of YAML stands before any table, and below ten lines of text at most."""
    before, fence, _ = text_of(path).partition("```yaml\n")
    assert fence
    assert not re.search(r"^\|", before, re.M)
    assert before.count("\n") <= 10
