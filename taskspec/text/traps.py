"""What people write that YAML takes for something else, and what they meant."""

from __future__ import annotations

import re

import yaml

from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping, Node, Scalar, Sequence, pointer
from taskspec.text.origin import origin_of
from taskspec.text.source import Source, Span

_GLUED = re.compile(r"([A-Za-z_][A-Za-z0-9_.]*):(\S.*)\Z", re.DOTALL)
"""A key and its value without the space between them."""


def comment_after(source: Source, end: int) -> str:
    """Return what follows in the line if it is ` #word`: often meant as text, not as a comment."""
    match = re.compile(r"[ ]+(#[^ #\n][^\n]*)").match(source.text, end)
    return match[1] if match else ""


def repair_pairs(
    pairs: list[tuple[Scalar, Node]], mapping: Mapping, source: Source, diagnostics: Diagnostics
) -> list[tuple[Scalar, Node]]:
    """Return the entries of a mapping as they were meant, each repair reported."""
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
    """Join list entries that a comma inside parentheses has torn apart."""
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
    if not (isinstance(value, Scalar) and value.plain and _open(value.value)):
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


def _open(text: str) -> bool:
    return text.count("(") > text.count(")")


def _joined(parts: list[Scalar], source: Source) -> Scalar:
    first, last = parts[0].span, parts[-1].span
    span = Span(first.line, first.column, last.end_line, last.end_column, first.source)
    start, end = _index(source, span.line, span.column), _index(
        source, span.end_line, span.end_column)  # fmt: skip
    value = " ".join(source.text[start:end].split())
    return Scalar(value, True, origin_of(source, span, value, start, end, 0))


def _index(source: Source, line: int, column: int) -> int:
    return sum(len(source.line(n)) + 1 for n in range(1, line)) + column - 1


def _report_comma(whole: Scalar, before: str, diagnostics: Diagnostics) -> None:
    comma = whole.value.index(",")
    diagnostics.error(
        "TS012",
        "a comma inside { } or [ ] ends the value, even between parentheses",
        whole.origin.at(comma, comma + 1),
        f'put the expression in quotes: {before}"{whole.value}"',
    )


def _split(key: Scalar, source: Source) -> tuple[Scalar, Scalar] | None:
    match = _GLUED.match(key.value) if key.plain else None
    if match is None:
        return None
    start = _index(source, key.span.line, key.span.column)
    return (
        _part(key, source, match.start(1), match.end(1), start),
        _part(key, source, match.start(2), match.end(2), start),
    )


def _part(whole: Scalar, source: Source, begin: int, end: int, start: int) -> Scalar:
    value = whole.value[begin:end]
    span = whole.origin.at(begin, end)
    return Scalar(value, True, origin_of(source, span, value, start + begin, start + end, 0))


def _as_mapping(value: Scalar, source: Source, diagnostics: Diagnostics) -> Node:
    """Read `key:value` on a line of its own, below a key, as the mapping that was meant."""
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
        Span(span.line, at, span.line, at + 1, span.source),
        f"write '{key}: {value}'",
    )


def explain_root(root: Node | None, diagnostics: Diagnostics) -> None:
    """Report a file that is empty or is not a mapping."""
    if root is None or (isinstance(root, Scalar) and root.empty):
        diagnostics.error("TS010", "the file is empty", None, "a task begins with 'taskspec: 1'")
        return
    hint = "a task begins with 'taskspec: 1'"
    if isinstance(root, Scalar) and _GLUED.match(root.value):
        hint = "put a space after each colon: taskspec: 1"
    what = "a list" if isinstance(root, Sequence) else "a text"
    span = pointer(root)
    end = Span(span.line, span.column, span.line, span.column + 1)
    diagnostics.error("TS010", f"a task file holds keys and values, this is {what}", end, hint)


_INDICATORS = {
    "%": "a text that begins with '%' needs quotes; a percentage follows its number: 95 %",
    "@": "a text that begins with '@' needs quotes",
    "`": "a text that begins with '`' needs quotes",
    "|": "a text that begins with '|' needs quotes; an absolute value is abs(x)",
    ">": "a text that begins with '>' needs quotes; a comparison begins with what is compared: "
    "force.z > 3 N",
    "*": "a text that begins with '*' needs quotes",
    "&": "a text that begins with '&' needs quotes; conditions are joined with 'and'",
    "!": "a text that begins with '!' needs quotes; the opposite of a condition is 'not'",
}


def explain_syntax(error: yaml.MarkedYAMLError, source: Source, diagnostics: Diagnostics) -> None:
    """Report what PyYAML cannot read, in the user's words."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        diagnostics.error("TS001", f"this is not readable as YAML: {error.problem}", None)
        return
    line, column = mark.line + 1, mark.column + 1
    context, problem = error.context or "", error.problem or ""
    message, hint, shift = _syntax(context, problem, source.line(line), column)
    code = "TS013" if "space after" in hint else "TS001"
    if shift == "previous" or line > source.line_count:
        back = error.context_mark or mark
        line, column = back.line + 1, back.column + 1
        glued = re.search(r"[A-Za-z_]:(?=[^ ])", source.line(line)) if code == "TS013" else None
        column = glued.end() if glued else column
    elif isinstance(shift, int):
        column = shift
    diagnostics.error(code, message, Span(line, column, line, column + 1), hint)


def _syntax(context: str, problem: str, text: str, column: int) -> tuple[str, str, int | str]:  # noqa: C901
    """Return message, hint, and a better column (or `previous` for the start of the construct)."""
    character = text[column - 1 : column]
    if "block scalar" in context:
        at = max(text.rfind(">", 0, column), text.rfind("|", 0, column))
        sign = text[at] if at >= 0 else ">"
        return f"'{sign}' begins a block of text here", _INDICATORS[sign], at + 1
    if "cannot start any token" in problem:
        hint = _INDICATORS.get(character, "put the text in quotes")
        return f"a value cannot begin with '{character}'", hint, column
    if "alias" in context or "anchor" in context:
        sign = "*" if "alias" in context else "&"
        at = text.rfind(sign, 0, column) + 1
        return f"a value cannot begin with '{sign}'", _INDICATORS[sign], at or column
    if "tag" in context or "undefined tag" in problem:
        return "a value cannot begin with '!'", _INDICATORS["!"], column
    if "mapping values are not allowed" in problem:
        first, _, rest = text.partition(": ")
        hint = "check the indentation"
        if ": " in rest or rest.endswith(":"):
            hint = f'put the text in quotes: {first.strip()}: "{rest.strip()}"'
        return "a second ': ' in one value", hint, column
    if "could not find expected ':'" in problem:
        return ("this line is not 'key: value'", "put a space after the colon, and check the lines "
                "around it", "previous")  # fmt: skip
    if "unexpected end of stream" in problem or "quoted scalar" in context:
        if "escape" in problem:
            return "an unknown escape in a text", "use single quotes, or double the '\\'", column
        return (
            "a quote that is never closed",
            "close it, or put the text in the other kind of quotes",
            "previous",
        )
    if "flow mapping" in context or "flow sequence" in context:
        brace = "}" if "mapping" in context else "]"
        return f"'{brace}' or ',' is missing", f"an open bracket ends with '{brace}'", column
    if "block mapping" in context or "block collection" in context:
        return ("this line does not fit the lines above", "lines of one level begin in the same "
                "column; put a text with special characters in quotes", column)  # fmt: skip
    if "directive" in context:
        return "a line cannot begin with '%'", _INDICATORS["%"], column
    return f"this is not readable as YAML: {problem}", "", column
