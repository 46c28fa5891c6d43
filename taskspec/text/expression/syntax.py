"""Why an expression cannot be read, in the user's words."""

from __future__ import annotations

import re

from lark.exceptions import UnexpectedEOF, UnexpectedInput, UnexpectedToken

from taskspec.text.expression.problem import Problem
from taskspec.text.suggest import closest
from taskspec.text.units import UNITS, usual_units

_CHARACTERS = {
    "°": "write 'deg' for degrees",
    "µ": "write 'um' for micrometres",
    "μ": "write 'um' for micrometres",
    "·": "write '*'",
    "×": "write '*'",
    "÷": "write '/'",
    "−": "write '-' (this is another character that looks like it)",
    "–": "write '-' (this is another character that looks like it)",
    "²": "write '^2'",
    "³": "write '^3'",
    "≤": "write '<='",
    "≥": "write '>='",
    "π": "write 'pi'",
    "&": "write 'and'",
    "|": "write 'or', or abs(x) for an absolute value",
    "!": "write 'not'",
    ":": "a time is written with its unit, such as 90 s",
    ".": "write a digit before the point, such as 0.5",
    "[": "an expression is one number; there are no lists in it",
    "{": "there are no braces in expressions; use ( )",
    "'": "there are no quotes in expressions",
    '"': "there are no quotes in expressions",
    "#": "a comment needs a space before '#'",
    "_": "a name begins with a letter",
}

UNIT_WORDS = {
    "newton": "N", "newtons": "N", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms",
    "degree": "deg", "degrees": "deg", "radian": "rad",
    "radians": "rad", "rads": "rad", "gram": "g", "grams": "g", "kilogram": "kg", "hertz": "Hz",
    "rev": "turn", "revs": "turn", "turns": "turn", "percent": "%", "watt": "W", "joule": "J",
}  # fmt: skip
"""What people write for a unit, and the unit."""

_UNFINISHED = re.compile(r"(?:\b(?:and|or|not|for|within|in)|[-+*/<>=(,])$")
_RELATIONS = {"LT", "LE", "GT", "GE", "WITHIN"}


def unknown_unit(word: str) -> str:
    """Return the hint for a word that stands where a unit would."""
    if word.lower().startswith("min"):
        return "there is no unit for minutes; write seconds: 180 s"
    near = UNIT_WORDS.get(word.lower()) or closest(word, [*UNITS, *usual_units()])
    if near:
        return f"did you mean '{near}'?"
    return f"units: {' '.join(UNITS)}"


def explain_character(text: str, position: int) -> Problem:
    """Say what to write instead of a character that no expression contains."""
    character = text[position]
    hint = _CHARACTERS.get(character, "")
    if text[position : position + 2] == "!=":
        hint = "compare with < or >, or write 'not (x within a +- b)'"
    return Problem(
        "TS101", f"'{character}' has no meaning in an expression", position, position + 1, hint
    )


def explain_token(text: str, error: UnexpectedInput, start: str) -> Problem:
    """Say what is wrong at the first word that does not fit the grammar."""
    if isinstance(error, UnexpectedEOF) or not isinstance(error, UnexpectedToken):
        return _unfinished(text)
    token = error.token
    if token.type == "$END":
        return _unfinished(text)
    begin, end = token.start_pos or 0, token.end_pos or len(text)
    expected = set(error.accepts or error.expected)
    return _explain(text, str(token.type), str(token), begin, end, expected, start)


def _explain(  # noqa: C901 - one case for each slip people make
    text: str, kind: str, word: str, begin: int, end: int, expected: set[str], start: str
) -> Problem:
    before = text[:begin].rstrip()
    if before.endswith("^"):
        return Problem("TS101", "an exponent is a plain number", begin, end)
    if kind in ("AND", "OR") and _UNFINISHED.search(before):
        return Problem("TS101", f"something is missing before '{word}'", begin, end)
    if kind == "EQUAL":
        end = begin + 2 if text[begin : begin + 2] == "==" else end
        written = text[begin:end]
        if written == "=" and text[end : end + 1] in ("<", ">"):
            return Problem("TS101", f"'={text[end]}' is written '{text[end]}='", begin, end + 1)
        return Problem(
            "TS103",
            f"'{written}' cannot be decided for measured numbers",
            begin,
            end,
            "compare with <, <=, > or >=, or write 'x within 5 N +- 0.1 N'",
        )
    if kind in _RELATIONS and not expected & _RELATIONS and "AND" in expected:
        return Problem(
            "TS104",
            "comparisons cannot be chained",
            begin,
            end,
            "write 'x within a..b', or join two comparisons with 'and'",
        )
    if kind in ("AND", "OR") and _inside_logic(before, "OR" if kind == "AND" else "AND"):
        return Problem(
            "TS105",
            "'and' and 'or' are mixed without parentheses",
            begin,
            end,
            "write (a and b) or c, or a and (b or c)",
        )
    if kind in ("AND", "OR", "FOR") and " for " in f" {before} ":
        return Problem(
            "TS101",
            f"'{word}' cannot follow 'for' here",
            begin,
            end,
            "put the part with 'for' in parentheses: (a for 10 ms) and b",
        )
    if kind == "FOR" and re.search(r"\b(and|or)\b", before):
        return Problem(
            "TS101",
            "'for' belongs to one condition; it is unclear to which",
            begin,
            end,
            "put the conditions in parentheses: (a and b) for 10 ms",
        )
    if kind == "PATH" and re.search(r"(?<![A-Za-z0-9_.])[0-9.]+(?:[eE][+-]?[0-9]+)?$", before):
        return Problem("TS111", f"'{word}' is not a unit", begin, end, unknown_unit(word))
    if kind == "PLUSMINUS":
        return Problem(
            "TS101",
            f"'{word}' has no place here",
            begin,
            end,
            "it follows 'within' or stands under 'vary'; to subtract write a - b",
        )
    if kind == "TIMES" and before.endswith("*"):
        return Problem("TS101", "'**' is written '^'", begin - 1, end)
    if kind == "DOTS":
        return Problem(
            "TS119", "an interval has no place here", begin, end, "write 'x within a..b'"
        )
    if start == "equation" and kind in _RELATIONS:
        return Problem("TS101", "an equation is written with =, <= or >=", begin, end)
    if kind in ("LT", "LE", "GT", "GE", "WITHIN", "AND", "OR", "NOT", "FOR") and start != "logic":
        return Problem(
            "TS114", f"a number is needed here, and '{word}' makes a condition", begin, end
        )
    if kind in ("QUANTITY", "PATH", "LPAR") and before:
        return Problem(
            "TS101", f"'{word}' follows without an operator", begin, end, "write * for a product"
        )
    if kind == "RPAR":
        hint = "" if before.count("(") >= before.count(")") + 1 else "it was never opened"
        return Problem("TS101", "')' has no place here", begin, end, hint)
    if kind == "COMMA":
        return Problem(
            "TS101", "',' has no place here", begin, end, "it separates the arguments of a function"
        )
    return Problem("TS101", f"'{word}' has no place here", begin, end)


def _unfinished(text: str) -> Problem:
    end = len(text.rstrip())
    missing = text.count("(") - text.count(")")
    if not text.strip():
        return Problem("TS101", "an expression is needed here", 0, max(end, 1))
    message = "the expression ends too early"
    hint = "a ')' is missing" if missing > 0 else ""
    if re.search(r"\bwithin\b(?!.*(\.\.|\+-|±))", text):
        hint = "'within' needs an interval: a..b or a +- b"
    return Problem("TS101", message, max(end - 1, 0), max(end, 1), hint)


def _inside_logic(before: str, operator: str) -> bool:
    """Whether `operator` joins conditions at the depth at which `before` ends."""
    depth = 0
    for match in reversed(list(re.finditer(r"[()]|\b(?:and|or)\b", before))):
        word = match[0]
        if word == ")":
            depth += 1
        elif word == "(":
            if depth == 0:
                return False
            depth -= 1
        elif depth == 0 and word.upper() == operator:
            return True
    return False
