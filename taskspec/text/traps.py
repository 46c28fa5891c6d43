"""What people write that YAML takes for something else, repaired so that reading can go on."""

from __future__ import annotations

import re

from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping, Node, Scalar, Sequence
from taskspec.text.origin import origin_of
from taskspec.text.source import Source, Span

register(
    {
        "TS012": "a comma that ends a value too early",
        "TS013": "no space after a colon",
    }
)

GLUED = re.compile(r"([A-Za-z_][A-Za-z0-9_.]*):(\S.*)\Z", re.DOTALL)
"""A key and its value without the space between them."""
_ENDS_WHOLE = re.compile(r"(?<![\w.])[0-9]+\Z")


def comment_after(source: Source, end: int) -> str:
    """What follows in the line if it is ` #word`: often meant as text, not as a comment."""
    match = re.compile(r"[ ]+(#[^ #\n][^\n]*)").match(source.text, end)
    return match[1] if match else ""


def repair_pairs(
    pairs: list[tuple[Scalar, Node]], mapping: Mapping, source: Source, diagnostics: Diagnostics
) -> list[tuple[Scalar, Node]]:
    """The entries of a mapping as they were meant, each repair reported."""
    repaired: list[tuple[Scalar, Node]] = []
    waiting = list(reversed(pairs))
    while waiting:
        key, value = waiting.pop()
        if mapping.flow:
            value = _join_value(key, value, waiting, source, diagnostics)
        if isinstance(value, Scalar) and value.empty:
            split = _split(key, source)
            if split is not None:
                _report_glued(key.span, split[0].value, split[1].value, diagnostics)
                key, value = split
        elif isinstance(value, Scalar) and value.plain and value.span.line > key.span.line:
            value = _as_mapping(value, source, diagnostics)
        repaired.append((key, value))
    return repaired


def join_items(sequence: Sequence, source: Source, diagnostics: Diagnostics) -> None:
    """Joins list entries that a comma inside parentheses has torn apart."""
    joined: list[Node] = []
    waiting = list(reversed(sequence.items))
    while waiting:
        item = waiting.pop()
        if isinstance(item, Scalar) and item.plain and _open(item.value):
            parts = [item]
            while waiting and _open(" ".join(p.value for p in parts)):
                following = waiting[-1]
                if not (isinstance(following, Scalar) and following.plain):
                    break
                parts.append(following)
                waiting.pop()
            if len(parts) > 1:
                item = _joined(parts, source)
                _report_comma(item, "", diagnostics)
        joined.append(item)
    sequence.items[:] = joined


def _join_value(
    key: Scalar,
    value: Node,
    waiting: list[tuple[Scalar, Node]],
    source: Source,
    diagnostics: Diagnostics,
) -> Node:
    if not (isinstance(value, Scalar) and value.plain):
        return value
    if waiting and adjoin(value, waiting[-1][0]) and is_empty(waiting[-1][1]):
        return _with_point(value, waiting.pop()[0], source, diagnostics)
    if not _open(value.value):
        return value
    parts = [value]
    while waiting and _open(" ".join(p.value for p in parts)):
        following, nothing = waiting[-1]
        if not (isinstance(nothing, Scalar) and nothing.empty):
            break
        parts.append(following)
        waiting.pop()
    if len(parts) == 1:
        return value
    whole = _joined(parts, source)
    _report_comma(whole, f"{key.value}: ", diagnostics)
    return whole


def adjoin(first: Node, second: Node) -> bool:
    """Whether two entries look like one number with a decimal comma: `0,5 m`."""
    if not all(isinstance(node, Scalar) and node.plain for node in (first, second)):
        return False
    assert isinstance(first, Scalar)
    assert isinstance(second, Scalar)
    return (
        _ENDS_WHOLE.search(first.value) is not None
        and second.value[:1].isdigit()
        and (first.span.end_line, first.span.end_column + 1)
        == (second.span.line, second.span.column)
    )


def is_empty(node: Node) -> bool:
    """Whether nothing is written where a value is."""
    return isinstance(node, Scalar) and node.empty


def _with_point(
    whole: Scalar, decimals: Scalar, source: Source, diagnostics: Diagnostics
) -> Scalar:
    """The number that was meant by one with a comma."""
    joined = _joined([whole, decimals], source)
    comma = len(whole.value)
    meant = f"{joined.value[:comma]}.{joined.value[comma + 1 :]}"
    diagnostics.error(
        "TS012",
        "a comma ends the value, also within a number",
        joined.origin.at(comma, comma + 1),
        f"decimals follow a point: {meant}",
    )
    return Scalar(meant, True, joined.origin)


def _open(text: str) -> bool:
    return text.count("(") > text.count(")")


def _joined(parts: list[Scalar], source: Source) -> Scalar:
    first, last = parts[0].span, parts[-1].span
    span = first.covering(first.line, first.column, last.end_line, last.end_column)
    start = source.offset(span.line, span.column)
    end = source.offset(span.end_line, span.end_column)
    value = " ".join(source.text[start:end].split())
    return Scalar(value, True, origin_of(source, span, value, start, end, 0))


def _report_comma(whole: Scalar, before: str, diagnostics: Diagnostics) -> None:
    comma = whole.value.index(",")
    diagnostics.error(
        "TS012",
        "a comma inside { } or [ ] ends the value, even between parentheses",
        whole.origin.at(comma, comma + 1),
        f'put the expression in quotes: {before}"{whole.value}"',
    )


def _split(key: Scalar, source: Source) -> tuple[Scalar, Scalar] | None:
    match = GLUED.match(key.value) if key.plain else None
    if match is None:
        return None
    start = source.offset(key.span.line, key.span.column)
    return (
        _part(key, source, match.start(1), match.end(1), start),
        _part(key, source, match.start(2), match.end(2), start),
    )


def _part(whole: Scalar, source: Source, begin: int, end: int, start: int) -> Scalar:
    value = whole.value[begin:end]
    span = whole.origin.at(begin, end)
    return Scalar(value, True, origin_of(source, span, value, start + begin, start + end, 0))


def _as_mapping(value: Scalar, source: Source, diagnostics: Diagnostics) -> Node:
    """Reads `key:value` on a line of its own, below a key, as the mapping that was meant."""
    split = _split(value, source) if "\n" not in value.origin.raw else None
    if split is None:
        return value
    _report_glued(value.span, split[0].value, split[1].value, diagnostics)
    mapping = Mapping(value.span, flow=False)
    mapping.entries[split[0].value] = split
    return mapping


def _report_glued(span: Span, key: str, value: str, diagnostics: Diagnostics) -> None:
    at = span.column + len(key)
    diagnostics.error(
        "TS013",
        "a colon without a space after it is part of a word",
        span.covering(span.line, at, span.line, at + 1),
        f"write '{key}: {value}'",
    )
