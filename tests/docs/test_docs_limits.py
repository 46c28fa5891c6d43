"""Keeping limits: the numbers of the page are those of the code, and its task does what it says."""

from pathlib import Path

from documents import first_words, table, words

from taskspec.program import consistency, limited, resolver

PAGE = Path(__file__).resolve().parents[2] / "docs" / "laws" / "limits.md"
