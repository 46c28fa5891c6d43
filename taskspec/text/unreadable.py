"""Texts that YAML cannot read, explained in the user's words."""

from __future__ import annotations

import re

import yaml

from taskspec.deferred_methods import dataclass
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Node, Scalar, Sequence, pointer
from taskspec.text.source import Source, Span
from taskspec.text.traps import GLUED

register(
    {
        "TS001": "the file is not readable as YAML",
        "TS010": "the file holds no task",
    }
)

_BEGIN = "a task begins with 'taskspec: 1'"

_SIGNS = {
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
"""What to do about a sign that has a meaning of its own where a value begins."""

_GLUED_LINE = re.compile(r"[ -]*[A-Za-z_][A-Za-z0-9_.]*:(?=[^ ])")
_QUOTED = re.compile(r"""(?:"[^"]*"|'[^']*')[ ]*\Z""")
_BRACKETED = re.compile(r".*:[ ]+([{\[]).*[}\]][^}\],]*$")


@dataclass(frozen=True, slots=True)
class _Place:
    """Where PyYAML stumbled (1-based), and the line."""

    line: int
    column: int
    text: str


@dataclass(frozen=True, slots=True)
class _Finding:
    message: str
    hint: str = ""
    code: str = "TS001"
    line: int = 0
    column: int = 0


def explain_root(root: Node | None, diagnostics: Diagnostics) -> None:
    """Reports a file that is empty or is not a mapping."""
    if root is None or (isinstance(root, Scalar) and root.empty):
        diagnostics.error("TS010", "the file is empty", None, _BEGIN)
        return
    hint = _BEGIN
    if isinstance(root, Scalar) and GLUED.match(root.value):
        hint = "put a space after each colon: taskspec: 1"
    what = "a list" if isinstance(root, Sequence) else "a text"
    span = pointer(root)
    first = Span(span.line, span.column, span.line, span.column + 1)
    diagnostics.error("TS010", f"a task file holds keys and values, this is {what}", first, hint)


def explain_syntax(error: yaml.MarkedYAMLError, source: Source, diagnostics: Diagnostics) -> None:
    """Reports what PyYAML cannot read."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        diagnostics.error("TS001", f"this is not readable as YAML: {error.problem}", None)
        return
    start = error.context_mark or mark
    here = _Place(mark.line + 1, mark.column + 1, source.line(mark.line + 1))
    began = _Place(start.line + 1, start.column + 1, source.line(start.line + 1))
    context, problem = error.context or "", error.problem or ""
    found = (
        _sign(context, problem, here)
        or _quoted(context, problem, began)
        or _colon(problem, here, began, source)
        or _structure(context, problem, here, source)
    )
    line, column = found.line or here.line, found.column or here.column
    if line > source.line_count or not source.line(line):
        line, column = began.line, began.column
    diagnostics.error(found.code, found.message, Span(line, column, line, column + 1), found.hint)


def explain_crash(error: Exception, source: Source, diagnostics: Diagnostics) -> None:
    """Reports what makes PyYAML fail in its own code: an escape that names no character."""
    escape = re.search(r"\\U(?!000|0010)[0-9A-Fa-f]{8}", source.text)
    if escape is None:
        diagnostics.error("TS001", f"this is not readable as YAML: {error}", None)
        return
    diagnostics.error(
        "TS001", f"'{escape[0]}' names no character", source.span(escape.start(), escape.end())
    )


def _sign(context: str, problem: str, here: _Place) -> _Finding | None:
    """Explains a value that begins with a sign."""
    text, column = here.text, here.column
    if "block scalar" in context:
        at = max(text.rfind(">", 0, column), text.rfind("|", 0, column))
        sign = text[at] if at >= 0 else ">"
        return _Finding(f"'{sign}' begins a block of text here", _SIGNS[sign], column=at + 1)
    if "cannot start any token" in problem:
        sign = text[column - 1 : column]
        return _Finding(
            f"a value cannot begin with '{sign}'", _SIGNS.get(sign, "put the text in quotes")
        )
    for word, sign in (("alias", "*"), ("anchor", "&"), ("tag", "!")):
        if word in context or (word == "tag" and "tag handle" in problem):
            at = text.rfind(sign, 0, column) + 1
            return _Finding(f"a value cannot begin with '{sign}'", _SIGNS[sign], column=at)
    return None


def _quoted(context: str, problem: str, began: _Place) -> _Finding | None:
    """Explains a text in quotes that goes wrong."""
    if "double-quoted" in context and "end of" not in problem and "quoted scalar" not in problem:
        return _Finding("an unknown escape in a text", "use single quotes, or double the '\\'")
    if "quoted scalar" in context:
        hint = "close it, or put the text in the other kind of quotes"
        return _Finding("a quote that is never closed", hint, line=began.line, column=began.column)
    return None


def _colon(problem: str, here: _Place, began: _Place, source: Source) -> _Finding | None:
    """Explains a colon too many, too few, or without its space."""
    if "mapping values are not allowed" in problem:
        above = source.line(here.line - 1)
        if glued := _GLUED_LINE.match(above):
            return _without_space(above, here.line - 1, glued.end())
        key, _, rest = here.text.partition(": ")
        if ": " in rest or rest.endswith(":"):
            return _Finding(
                "a second ': ' in one value",
                f'put the text in quotes: {key.strip()}: "{rest.strip()}"',
            )
        return _Finding("this line does not fit the lines above", "check the indentation")
    if "could not find expected ':'" in problem:
        if glued := _GLUED_LINE.match(began.text):
            return _without_space(began.text, began.line, glued.end())
        dashed = re.match(r"[ ]*-(?=[^ -])", began.text)
        return _Finding(
            "this line is not 'key: value'",
            "a list entry begins with '- '" if dashed else "a key ends with ': '",
            line=began.line,
            column=began.column,
        )
    return None


def _without_space(text: str, line: int, column: int) -> _Finding:
    key, _, value = text.strip().removeprefix("- ").partition(":")
    return _Finding(
        "a colon without a space after it is part of a word",
        f"write '{key}: {value.strip()}'",
        "TS013",
        line,
        column,
    )


def _structure(context: str, problem: str, here: _Place, source: Source) -> _Finding:
    """Explains brackets and indentation."""
    if "flow mapping" in context or "flow sequence" in context:
        brace = "}" if "mapping" in context else "]"
        if _QUOTED.search(here.text[: here.column - 1]):
            return _Finding("a text goes on after its closing quote", "quote all of it, or nothing")
        return _Finding(f"'{brace}' or ',' is missing", "what is open has to be closed")
    if "block mapping" in context or "block collection" in context:
        if bracket := _BRACKETED.match(here.text[: here.column - 1]):
            return _Finding(
                "a text goes on after a closing bracket",
                f"a text that begins with '{bracket[1]}' needs quotes",
            )
        return _Finding(
            "this line does not fit the lines above", "lines of one level begin in one column"
        )
    if "<document start>" in problem:
        for number in range(1, here.line):
            if source.line(number).startswith("%"):
                return _Finding("a line cannot begin with '%'", _SIGNS["%"], line=number, column=1)
        return _Finding(
            "this line does not fit the lines above", "lines of one level begin in one column"
        )
    if "directive" in context:
        return _Finding("a line cannot begin with '%'", _SIGNS["%"], column=1)
    if "expected the node content" in problem:
        sign = here.text[here.column - 1 : here.column]
        what = f"something is missing before '{sign}'" if sign else "the text ends too early"
        return _Finding(what)
    return _Finding(f"this is not readable as YAML: {problem}")
