from __future__ import annotations

import time

import pytest

from taskspec.text.characters import normal
from taskspec.text.data import Items, Map, Real, Text, TruthValue, Whole, to_data
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping, Node, Scalar, Sequence
from taskspec.text.source import Source
from taskspec.text.yaml import MAX_BYTES, MAX_DEPTH, MAX_EVENTS, MAX_SCALAR, read


def reading(text: str) -> tuple[Node | None, Diagnostics]:
    found = Diagnostics("t.yaml")
    return read(Source("t.yaml", normal(text)), found), found


def codes(text: str) -> list[str]:
    return [d.code for d in reading(text)[1].sorted()]


def datum(text: str) -> object:
    root, found = reading(f"key: {text}\n")
    assert isinstance(root, Mapping)
    data = to_data(root, found)
    assert isinstance(data, Map)
    assert len(found) == 0
    return data["key"]


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("1e3", Real, 1000.0),
        ("1E-2", Real, 0.01),
        ("1.5", Real, 1.5),
        (".5", Real, 0.5),
        ("5.", Real, 5.0),
        ("-0.0", Real, 0.0),
        ("010", Whole, 10),
        ("+3", Whole, 3),
        ("no", Text, "no"),
        ("on", Text, "on"),
        ("Yes", Text, "Yes"),
        ("y", Text, "y"),
        ("1:30", Text, "1:30"),
        ("2024-01-01", Text, "2024-01-01"),
        ("2024-99-99", Text, "2024-99-99"),
        ("0x1F", Text, "0x1F"),
        ("0o17", Text, "0o17"),
        ("1_000", Text, "1_000"),
        ("=", Text, "="),
        ("15 N", Text, "15 N"),
        ("'3'", Text, "3"),
        ('"null"', Text, "null"),
        ("'true'", Text, "true"),
        ("e3", Text, "e3"),
        ("nan", Text, "nan"),
        ("inf", Text, "inf"),
    ],
)
def test_scalars_follow_yaml_1_2(text: str, kind: type, value: object) -> None:
    found = datum(text)
    assert type(found) is kind
    assert found == value


@pytest.mark.parametrize(("text", "value"), [("true", True), ("False", False), ("TRUE", True)])
def test_truth(text: str, value: bool) -> None:
    found = datum(text)
    assert isinstance(found, TruthValue)
    assert found.value is value


def test_collections() -> None:
    found = datum("[1, {a: b}]")
    assert isinstance(found, Items)
    assert found == [1, {"a": "b"}]


ATTACKS = {
    "billion laughs": "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n",
    "merge bomb": "a: &a {x: 1}\nb: {<<: [*a, *a]}\n",
    "self-reference": "a: &a [*a]\n",
    "nesting in flow": "[" * 500,
    "nesting in flow, closed": "a: " + "[" * 500 + "]" * 500,
    "nesting in mappings": "{a: " * 500,
    "nesting in blocks": "".join("  " * n + "a:\n" for n in range(200)),
    "a hundred thousand brackets": "[" * 100_000,
    "as large as may be": "[" * (MAX_BYTES - 10),
    "dashes": "- " * 100_000,
    "questions": "? " * 100_000,
    "too large": "a: b\n" * (MAX_BYTES // 5 + 1),
    "too many events": "a: [" + "1," * MAX_EVENTS + "]",
    "long scalar": "a: " + "x" * (MAX_SCALAR + 1),
    "long quoted scalar": "a: '" + "x" * (MAX_BYTES - 100) + "'",
    "huge int": "a: " + "9" * 5000,
    "tagged int": "a: !!int foo",
    "tagged bool": "a: !!bool foo",
    "tagged timestamp": "a: !!timestamp foo",
    "tagged empty int": "a: !!int ''",
    "tagged python": "a: !!python/object/apply:os.system [ls]",
    "tagged set": "a: !!set {b, c}",
    "tagged binary": "a: !!binary aGk=",
    "unknown tag handle": "a: !x!y z",
    "escape beyond Unicode": 'a: "\\U00110000"',
    "lone surrogate": 'a: "\\ud800"',
    "raw surrogate": "a: \ud800",
    "bidi": "a: \u202e",
    "escaped bidi": 'a: "\\u202e"',
    "terminal escape": "a: \x1b[2J",
    "NUL": "a: \x00",
    "escaped NUL": 'a: "\\0"',
    "byte order mark inside": "a: \ufeffb",
    "line separator": "a: b\u2028c: d",
    "next line": "a: b\x85c: d",
    "tab": "\ta: b",
    "merge key": "<<: {a: b}",
    "two documents": "a: b\n---\nc: d\n",
    "three dots": "a: b\n...\nc: d\n",
    "duplicate keys": "a: b\na: c\n",
    "duplicate after quotes": "a: b\n'a': c\n",
    "complex key": "? {a: b}\n: c\n",
    "list as key": "[a]: b\n",
    "empty key": ": a\n",
    "empty": "",
    "a scalar": "hello",
    "a list": "- a\n- b\n",
    "unclosed quote": "a: 'b",
    "unclosed bracket": "a: [b",
    "unknown escape": 'a: "\\q"',
    "directive": "%YAML 3.0\n---\na: b",
    "tag directive": "%TAG ! x\na: b",
    "only a directive": "%YAML 1.2\n",
    "reserved sign": "a: @b",
    "block header": "a: >x\n b",
    "anchor without a name": "a: & b",
    "alias without a name": "a: * b",
}


def processor_time(text: str) -> tuple[float, Diagnostics]:
    """What reading a text takes of a processor [s], and what is found in it."""
    start = time.process_time()
    root, found = reading(text)
    if root is not None:
        to_data(root, found)
    return time.process_time() - start, found


@pytest.fixture(scope="module")
def largest() -> float:
    """What a sound text of as many parts as a file may have takes of this machine [s]."""
    took, found = processor_time("".join(f"k{i}: {i}\n" for i in range(MAX_EVENTS // 2 - 10)))
    assert not found.has_errors
    return took


@pytest.mark.parametrize("text", ATTACKS.values(), ids=ATTACKS)
def test_hostile_text_is_refused_quickly(text: str, largest: float) -> None:
    """None takes much longer than the largest sound one; at the most 1.2 times were measured.

    Twice that is what a core shared with others may differ by from one second to the next.
    """
    took, found = processor_time(text)
    assert took < 2.4 * largest
    assert found.has_errors
    assert all(d.code.startswith("TS0") for d in found.sorted())


def test_limits_themselves_are_allowed() -> None:
    deep = MAX_DEPTH - 1
    assert codes("a: " + "[" * deep + "]" * deep) == []
    assert codes("a: " + "x" * MAX_SCALAR) == []


def test_reading_goes_on_behind_what_is_wrong() -> None:
    text = "a: &x 1\nb: *x\nc: !!int 2\nd: 1\nd: 2\n<<: 3\n? [e]\n: 4\nf: .inf\ng:\n"
    root, found = reading(text)
    assert isinstance(root, Mapping)
    to_data(root, found)
    assert [d.code for d in found.sorted()] == [
        "TS005", "TS005", "TS007", "TS004", "TS006", "TS014", "TS015", "TS011",
    ]  # fmt: skip
    assert [d.span.line for d in found.sorted() if d.span] == [1, 2, 3, 5, 6, 7, 9, 10]


def test_positions_count_characters() -> None:
    root, _ = reading("ä: {b: [1, '€€', 🙂x]}\n")
    assert isinstance(root, Mapping)
    inner = root.get("ä")
    assert isinstance(inner, Mapping)
    items = inner.get("b")
    assert isinstance(items, Sequence)
    spans = [item.span for item in items.items]
    assert [(s.column, s.end_column) for s in spans] == [(9, 10), (12, 16), (18, 20)]


@pytest.mark.parametrize(
    ("text", "word", "line", "column"),
    [
        ("a: one two\n", "two", 1, 8),
        ("a: 'one two'\n", "two", 1, 9),
        ('a: "one two"\n', "two", 1, 9),
        ("a: one\n  two\n", "two", 2, 3),
        ("a: >\n   one\n   two\n", "two", 3, 4),
        ("a: |-\n   one\n   two\n", "two", 3, 4),
        ("a: >+\n\n   one\n\n   two\n", "two", 5, 4),
        ("a: 'one\n\n   two'\n", "two", 3, 4),
        # Where an escape hides the way back, the whole scalar is shown.
        ('a: "one\\u0020two"\n', "two", 1, 4),
        ("a: 'one''s two'\n", "two", 1, 4),
    ],
)
def test_place_of_a_word_inside_a_scalar(text: str, word: str, line: int, column: int) -> None:
    root, _ = reading(text)
    assert isinstance(root, Mapping)
    scalar = root.get("a")
    assert isinstance(scalar, Scalar)
    start = scalar.value.index(word)
    span = scalar.origin.at(start, start + len(word))
    assert (span.line, span.column) == (line, column)


def test_repairs_leave_nothing_else_to_complain_about() -> None:
    text = "a: {v: max(b, c), w:-3 mm, x: 1}\nd: [min(e, f), g]\nh:\n  i:3\n"
    root, found = reading(text)
    assert [d.code for d in found.sorted()] == ["TS012", "TS013", "TS012", "TS013"]
    assert isinstance(root, Mapping)
    assert to_data(root, found) == {
        "a": {"v": "max(b, c)", "w": "-3 mm", "x": 1},
        "d": ["min(e, f)", "g"],
        "h": {"i": 3},
    }
    assert len(found) == 4


@pytest.mark.parametrize(
    "text",
    [
        "a: (b\nc: d)\n",
        "a: {b: (c, d: e}\n",
        "a: [(b, {c: d}]\n",
        "a: {b: '(c', d: e}\n",
        "http://x: y\n",
        "a: b:c\n",
        "a: {b: c:d}\n",
    ],
)
def test_no_repair_where_nothing_tells_what_was_meant(text: str) -> None:
    assert codes(text) == []
