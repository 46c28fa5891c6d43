"""The parser's tables are kept below the user's cache folder, and change nothing there."""

from __future__ import annotations

import importlib
import pickle

import pytest

from taskspec.expression.problem import ExpressionError
from taskspec.store import VARIABLE, Store

# The package has a function of that name.
parse = importlib.import_module("taskspec.expression.parse")

TEXTS = {
    "logic": ("gap < 1 mm and not (x for 3 s)", "force.z within 5 N +- 10 %", "a < b < c", "x =="),
    "sum": ("-2 * sin(3 rad)^2 / (4 N - f.x in tool)", "3 kN +", "3 ?", "5 furlong", "a b"),
    "uncertain": ("+- 2 mm", "3..5 N", "3...5"),
    "equation": ("x^2 + y^2 = (300 mm)^2", "x < 3", "x = y = z"),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    yield tmp_path / "grammar"
    parse._parser.cache_clear()


def read():
    """Trees and problems of all texts, by a parser that is made or taken anew."""
    parse._parser.cache_clear()
    found = []
    for start, texts in TEXTS.items():
        for text in texts:
            try:
                found.append(parse.parse(text, start))
            except ExpressionError as error:
                found.append(error.problems)
    return found


def read_without_a_grammar(monkeypatch):
    """The same by tables that are kept: none are made."""
    with monkeypatch.context() as patch:
        patch.setattr(parse.Lark, "__init__", None)
        return read()


def test_a_kept_parser_reads_as_a_new_one(folder, monkeypatch):
    new = read()
    files = list(folder.iterdir())
    assert read_without_a_grammar(monkeypatch) == new
    monkeypatch.setenv(VARIABLE, "")
    assert read() == new
    assert list(folder.iterdir()) == files


@pytest.mark.parametrize("kept", [0, 30, 900, -40])
def test_a_spoiled_file_is_made_anew(folder, monkeypatch, kept):
    new = read()
    (file,) = folder.iterdir()
    data = file.read_bytes()
    file.write_bytes(data[:kept] + b"?" + data[kept:][2:])
    assert read() == new
    assert read_without_a_grammar(monkeypatch) == new


@pytest.mark.parametrize(
    "data", [b"", b"no tables", b'{"pairs": []}', pickle.dumps({"data": {}, "memo": {}})]
)
def test_tables_that_lark_does_not_read_are_made_anew(folder, monkeypatch, data):
    new = read()
    keys = []
    get = Store.get
    monkeypatch.setattr(Store, "get", lambda self, key: keys.append(key) or get(self, key))
    read()
    Store(folder).put(keys[0], data)
    assert read() == new
    assert read_without_a_grammar(monkeypatch) == new
