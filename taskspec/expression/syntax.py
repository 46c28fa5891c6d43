"""Why an expression cannot be read, in the user's words."""

from __future__ import annotations

import re

from lark.exceptions import UnexpectedInput, UnexpectedToken

from taskspec.deferred_methods import dataclass
from taskspec.expression.problem import Problem
from taskspec.expression.spelling import CHARACTERS, ELSEWHERE, UNIT_WORDS
from taskspec.text.codes import register
from taskspec.text.suggest import closest
from taskspec.text.units import UNITS, usual_units

register(
    {
        "TS101": "an expression that cannot be read",
        "TS103": "`==` in an expression",
        "TS104": "chained comparisons",
        "TS105": "`and` and `or` mixed without parentheses",
        "TS111": "an unknown unit",
    }
)

_WRITTEN = "it is written with =, <= or >=, such as x^2 + y^2 = (300 mm)^2"
_UNFINISHED = re.compile(r"(?:\b(?:and|or|not|for|within|in)|[-+*/<>=(,])$")
_BARE_NUMBER = re.compile(r"(?<![A-Za-z0-9_.])[0-9.]+(?:[eE][+-]?[0-9]+)?$")
_WORDS = re.compile(r"[A-Za-z_ ]+")
_COUNT = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*\.visits *$")
_RELATIONS = {"LT", "LE", "GT", "GE", "WITHIN"}


def unknown_unit(word: str) -> str:
    """The hint for a word that stands where a unit would."""
    if word.lower() in ELSEWHERE:
        return ELSEWHERE[word.lower()]
    near = UNIT_WORDS.get(word.lower()) or closest(word, [*UNITS, *usual_units()])
    if near:
        return f"did you mean '{near}'?"
    return f"units: {' '.join(UNITS)}"


def explain_character(text: str, position: int, start: str) -> Problem:
    """Says what to write instead of a character that no expression contains."""
    character = text[position]
    hint = CHARACTERS.get(character, "")
    if text[position : position + 2] == "!=":
        hint = "compare with < or >, or write 'not (x within a +- b)'"
        hint = _WRITTEN if start == "equation" else hint
    return Problem(
        "TS101", f"'{character}' has no meaning in an expression", position, position + 1, hint
    )


@dataclass(frozen=True, slots=True)
class _Token:
    """The first word that does not fit.

    Attributes:
        text: the whole expression.
        before: what stands before the word, without trailing spaces.
        kind: its terminal in the grammar.
        word: the word itself.
        begin: where it begins.
        end: where it ends, exclusive.
        expected: the terminals that would have fitted.
        start: what the expression has to be.
    """

    text: str
    before: str
    kind: str
    word: str
    begin: int
    end: int
    expected: frozenset[str]
    start: str

    def problem(self, message: str, hint: str = "", code: str = "TS101") -> Problem:
        return Problem(code, message, self.begin, self.end, hint)


def explain_token(text: str, error: UnexpectedInput, start: str) -> Problem:
    """Says what is wrong at the first word that does not fit the grammar."""
    if not isinstance(error, UnexpectedToken) or error.token.type == "$END":
        return _unfinished(text, start)
    found = error.token
    begin, end = found.start_pos or 0, found.end_pos or len(text)
    expected = frozenset(error.accepts or error.expected)
    before = text[:begin].rstrip()
    token = _Token(text, before, str(found.type), str(found), begin, end, expected, start)
    for slip in _SLIPS:
        if (problem := slip(token)) is not None:
            return problem
    return token.problem(f"'{token.word}' has no place here")


def _operand(t: _Token) -> Problem | None:
    if t.before.endswith("^"):
        return t.problem("an exponent is a plain number")
    if t.kind in ("AND", "OR") and _UNFINISHED.search(t.before):
        return t.problem(f"something is missing before '{t.word}'")
    if t.kind == "TIMES" and t.before.endswith("*"):
        return Problem("TS101", "'**' is written '^'", t.begin - 1, t.end)
    return None


def _equation(t: _Token) -> Problem | None:
    if t.start != "equation":
        return None
    if t.kind == "EQUAL" and t.before.endswith("=") and t.text[t.begin - 1] == "=":
        return Problem("TS103", "an equation has one '='", t.begin - 1, t.end, _WRITTEN)
    if t.kind in ("EQUAL", "LE", "GE") and t.before.count("(") > t.before.count(")"):
        return t.problem(f"'{t.word}' stands inside parentheses", "a ')' is missing before it")
    if t.kind in _RELATIONS | {"EQUAL"} and re.search("[=<>]", t.before):
        hint = "state each relation as an object of its own"
        return t.problem("an equation has two sides", hint, "TS104")
    if t.kind in _RELATIONS:
        return t.problem(f"'{t.word}' makes no equation", _WRITTEN)
    if t.kind in ("AND", "OR", "NOT", "FOR"):
        hint = "state each relation as an object of its own"
        return t.problem(f"'{t.word}' has no place in an equation", hint)
    return None


def _equality(t: _Token) -> Problem | None:
    if t.kind != "EQUAL":
        return None
    following = t.text[t.end : t.end + 1]
    if following in ("<", ">"):
        message = f"'={following}' is written '{following}='"
        return Problem("TS101", message, t.begin, t.end + 1)
    written = "==" if following == "=" else "="
    hint = "compare with <, <=, > or >=, or write 'x within 5 N +- 0.1 N'"
    if counted := _COUNT.search(t.before):
        count = counted[0].strip()
        hint = f"a count lies between bounds: {count} >= 5 and {count} <= 5"
    return Problem(
        "TS103",
        f"'{written}' cannot be decided for measured numbers",
        t.begin,
        t.begin + len(written),
        hint,
    )


def _logic(t: _Token) -> Problem | None:
    if t.kind in _RELATIONS and not t.expected & _RELATIONS and "AND" in t.expected:
        hint = "write 'x within a..b', or join two comparisons with 'and'"
        return t.problem("comparisons cannot be chained", hint, "TS104")
    if t.kind in ("AND", "OR") and _inside_logic(t.before, "OR" if t.kind == "AND" else "AND"):
        hint = "write (a and b) or c, or a and (b or c)"
        return t.problem("'and' and 'or' are mixed without parentheses", hint, "TS105")
    if t.kind in ("AND", "OR", "FOR") and " for " in f" {t.before} ":
        hint = "put the part with 'for' in parentheses: (a for 10 ms) and b"
        return t.problem(f"'{t.word}' cannot follow 'for' here", hint)
    if t.kind == "FOR" and re.search(r"\b(and|or)\b", t.before):
        hint = "put the conditions in parentheses: (a and b) for 10 ms"
        return t.problem("'for' belongs to one condition; it is unclear to which", hint)
    return None


def _unit(t: _Token) -> Problem | None:
    if t.kind in ("PATH", "IN") and _BARE_NUMBER.search(t.before):
        return t.problem(f"'{t.word}' is not a unit", unknown_unit(t.word), "TS111")
    return None


def _interval(t: _Token) -> Problem | None:
    if t.kind == "PLUSMINUS":
        hint = "it follows 'within' or stands under 'vary'; to subtract write a - b"
        return t.problem(f"'{t.word}' has no place here", hint)
    if t.kind == "DOTS":
        return t.problem("an interval has no place here", "write 'x within a..b'", "TS119")
    return None


def _condition(t: _Token) -> Problem | None:
    if t.start != "logic" and t.kind in _RELATIONS | {"AND", "OR", "NOT", "FOR"}:
        message = f"a number is needed here, and '{t.word}' makes a condition"
        return t.problem(message, code="TS114")
    return None


def _order(t: _Token) -> Problem | None:
    if t.kind == "IN":
        return t.problem("'in' names a frame after a signal", "a range of values follows 'within'")
    if t.before.endswith(" in"):
        return t.problem("a frame follows 'in'", "a range of values follows 'within'")
    if t.kind in ("QUANTITY", "PATH", "LPAR") and t.before:
        hint = "write * for a product"
        if t.word == "of" and (width := re.search(r"\bwithin +(.+)$", t.before)):
            return t.problem("a range has its middle first",
                             f"write within {t.text[t.end:].strip()} +- {width[1]}")  # fmt: skip
        if t.kind == "PATH" and _WORDS.fullmatch(t.before):
            hint = "a condition compares, as in gap < 1 mm; a product has a *"
        return t.problem(f"'{t.word}' follows without an operator", hint)
    if t.kind == "RPAR" and t.before.count("(") <= t.before.count(")"):
        return t.problem("')' has no place here", "it was never opened")
    if t.kind == "COMMA":
        if _BARE_NUMBER.search(t.before) and t.text[t.end : t.end + 1].isdigit():
            return t.problem("',' has no place in a number", "decimals follow a point, as in 0.5")
        return t.problem("',' has no place here", "it separates the arguments of a function")
    return None


_SLIPS = (_operand, _equation, _equality, _logic, _unit, _interval, _condition, _order)
"""What people get wrong, the surest first."""


def _unfinished(text: str, start: str) -> Problem:
    end = len(text.rstrip())
    missing = text.count("(") - text.count(")")
    if not text.strip():
        return Problem("TS101", "an expression is needed here", 0, max(end, 1))
    if start == "equation" and not re.search("[=<>]", text):
        return Problem("TS101", "an equation has two sides", 0, end, _WRITTEN)
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
