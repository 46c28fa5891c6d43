"""Text to tree, by the grammar beside this file."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import lark
from lark import Lark, Token, Transformer
from lark.exceptions import UnexpectedCharacters, UnexpectedInput
from lark.grammar import Rule
from lark.lexer import TerminalDef

from taskspec.expression import tree
from taskspec.expression.functions import REDUCERS
from taskspec.expression.problem import ExpressionError, Problem
from taskspec.expression.syntax import explain_character, explain_token
from taskspec.store import Store
from taskspec.text.codes import register
from taskspec.text.units import LARGEST, QUANTITY, split_quantity, to_si

register({"TS102": "an expression that is too long or too deeply nested"})

Start = Literal["sum", "logic", "value", "uncertain", "equation"]

_SCHEMA = 1

MAX_LENGTH = 1000
"""Characters in one expression."""
MAX_DEPTH = 100
"""Nodes below each other; keeps every later walk far from the recursion limit."""
MAX_NODES = 400
"""Nodes in one expression."""
MAX_EXPONENT = 8.0
"""Largest exponent; higher powers are always a slip and overflow soon."""


def parse(text: str, start: Start) -> tree.Node:
    """The tree of an expression.

    Args:
        text: the expression.
        start: what it has to be: a `sum` is a number, `logic` true or false, `value` a number or
            an interval, `uncertain` also `+- x`, `equation` two sides.

    Raises:
        ExpressionError: it is not of the grammar, or too long or too deep.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(
            [
                Problem(
                    "TS102",
                    f"an expression may have {MAX_LENGTH} characters, this one has {len(text)}",
                    0,
                    len(text),
                    "give parts of it a name under 'params'",
                )
            ]
        )
    if start != "equation" and (quick := _plain_quantity(text)) is not None:
        return quick
    try:
        node: tree.Node = _parser().parse(text, start=start)  # type: ignore[assignment]
    except UnexpectedCharacters as error:
        raise ExpressionError([explain_character(text, error.pos_in_stream or 0, start)]) from None
    except UnexpectedInput as error:
        raise ExpressionError([explain_token(text, error, start)]) from None
    _limit(node, text)
    return node


def _plain_quantity(text: str) -> tree.Number | None:
    """A lone quantity without waking the parser: most values of a file are one."""
    stripped = text.strip(" \n")
    if not stripped[:1].isdigit():
        return None
    parts = split_quantity(stripped)
    if parts is None:
        return None
    offset = text.index(stripped)
    return _number(*parts, offset, offset + len(stripped))


def _number(value: float, unit: str, start: int, end: int) -> tree.Number:
    quantity = to_si(value, unit)
    if not abs(quantity.value) <= LARGEST:
        message = "this number is too large to be computed with"
        hint = f"numbers go up to {LARGEST:g} in SI units"
        raise ExpressionError([Problem("TS015", message, start, end, hint)])
    return tree.Number(quantity.value, quantity.dimension, unit=unit, start=start, end=end)


def _limit(node: tree.Node, text: str) -> None:
    count, level, depth = 0, [node], 0
    while level:
        count += len(level)
        depth += 1
        level = [child for parent in level for child in tree.children(parent)]
    if depth > MAX_DEPTH or count > MAX_NODES:
        raise ExpressionError(
            [
                Problem(
                    "TS102",
                    "this expression is nested too deeply"
                    if depth > MAX_DEPTH
                    else "this expression has too many parts",
                    0,
                    len(text),
                    "give parts of it a name under 'params'",
                )
            ]
        )


@lru_cache(maxsize=1)
def _parser() -> Lark:
    """The parser. Its tables, which follow from the grammar alone, are kept from run to run."""
    text = Path(__file__).with_name("grammar.lark").read_text(encoding="utf-8")
    text = text.replace("@QUANTITY@", QUANTITY.replace("/", r"\/"))
    key = f"{_SCHEMA} lark {lark.__version__} python {sys.version}\n{text}"
    store = Store.named("grammar")
    kept = store.get(key)
    if kept is not None:
        # A table of the same Lark that it does not read all the same is made anew.
        with suppress(Exception):
            return _loaded(json.loads(kept))
    parser = Lark(
        text,
        parser="lalr",
        lexer="basic",
        start=["sum", "logic", "value", "uncertain", "equation"],
        maybe_placeholders=False,
        transformer=_Build(),
    )
    store.put(key, json.dumps(_tables(parser)).encode())
    return parser


def _tables(parser: Lark) -> Any:
    """What `Lark.save` writes, as data: JSON runs nothing that lies in the cache."""
    data, memo = parser.memo_serialize([TerminalDef, Rule])
    options = {**data["options"], "transformer": None}
    return _paired({"data": {**data, "options": options}, "memo": memo})


def _loaded(tables: Any) -> Lark:
    """The parser of its tables."""
    found = _mapped(tables)
    found["data"]["options"]["transformer"] = _Build()
    parser: Lark = Lark.load(found)
    return parser


def _paired(value: Any) -> Any:
    """A value with mappings as lists of pairs, since keys of JSON are texts and these numbers."""
    if isinstance(value, dict):
        return {"pairs": [[key, _paired(each)] for key, each in value.items()]}
    return [_paired(each) for each in value] if isinstance(value, list | tuple) else value


def _mapped(value: Any) -> Any:
    """The value that was made pairs of."""
    if isinstance(value, dict):
        return {key: _mapped(each) for key, each in value["pairs"]}
    return [_mapped(each) for each in value] if isinstance(value, list) else value


def _adopt_unit(first: tree.Node, second: tree.Node) -> tree.Node:
    """Gives a bare first number the unit of the second: `5..80 kN/m`."""
    number = first.x if isinstance(first, tree.Negate) else first
    donor = second.x if isinstance(second, tree.Negate) else second
    if not (isinstance(number, tree.Number) and isinstance(donor, tree.Number)):
        return first
    if number.unit or not donor.unit:
        return first
    taken = _number(number.value_si, donor.unit, number.start, number.end)
    return replace(first, x=taken) if isinstance(first, tree.Negate) else taken


class _Build(Transformer[Token, tree.Node]):
    """Makes tree nodes while the parser reduces, so that no parse tree is ever held."""

    def equation(self, c: list[Any]) -> tree.Node:
        return tree.Equation(c[1].value, c[0], c[2], start=c[0].start, end=c[2].end)

    def spread(self, c: list[Any]) -> tree.Node:
        return tree.SpreadNode(c[1], start=c[0].start_pos, end=c[1].end)

    def between(self, c: list[Any]) -> tree.Node:
        low = _adopt_unit(c[0], c[2])
        return tree.IntervalNode(low, c[2], start=low.start, end=c[2].end)

    def about(self, c: list[Any]) -> tree.Node:
        half = c[2]
        # A percentage may be a share of what stands before it, and is no unit for it.
        middle = c[0] if tree.is_share(half) else _adopt_unit(c[0], half)
        place = {"start": middle.start, "end": half.end}
        return tree.IntervalNode(
            tree.Binary("-", middle, half, **place),
            tree.Binary("+", middle, half, **place),
            **place,
        )

    def all_of(self, c: list[Any]) -> tree.Node:
        return tree.Logic("and", tuple(c[::2]), start=c[0].start, end=c[-1].end)

    def any_of(self, c: list[Any]) -> tree.Node:
        return tree.Logic("or", tuple(c[::2]), start=c[0].start, end=c[-1].end)

    def held(self, c: list[Any]) -> tree.Node:
        amount = self.quantity(c[2:])
        return tree.Held(c[0], amount, start=c[0].start, end=amount.end)

    def negation(self, c: list[Any]) -> tree.Node:
        return tree.Not(c[1], start=c[0].start_pos, end=c[1].end)

    def compare(self, c: list[Any]) -> tree.Node:
        return tree.Compare(c[1].value, c[0], c[2], start=c[0].start, end=c[2].end)

    def within(self, c: list[Any]) -> tree.Node:
        x, interval = c[0], c[2]
        return tree.WithinNode(x, interval.low, interval.high, start=x.start, end=interval.end)

    def binary(self, c: list[Any]) -> tree.Node:
        return tree.Binary(c[1].value, c[0], c[2], start=c[0].start, end=c[2].end)

    def minus(self, c: list[Any]) -> tree.Node:
        return tree.Negate(c[1], start=c[0].start_pos, end=c[1].end)

    def power(self, c: list[Any]) -> tree.Node:
        exponent = self.quantity(c[-1:])
        message = ""
        if exponent.unit:
            message = f"an exponent is a plain number, not '{c[-1].value}'"
        elif exponent.value_si > MAX_EXPONENT:
            message = f"an exponent may be at most {MAX_EXPONENT:g}"
        if message:
            raise ExpressionError([Problem("TS101", message, exponent.start, exponent.end)])
        sign = -1.0 if len(c) == 4 else 1.0
        return tree.Power(c[0], sign * exponent.value_si, start=c[0].start, end=exponent.end)

    def quantity(self, c: list[Any]) -> tree.Number:
        token = c[0]
        parts = split_quantity(token.value)
        assert parts is not None
        return _number(*parts, token.start_pos, token.end_pos)

    def name(self, c: list[Any]) -> tree.Node:
        frame = c[2].value if len(c) == 3 else None
        path = tuple(c[0].value.split("."))
        return tree.Name(path, frame, start=c[0].start_pos, end=c[-1].end_pos)

    def call(self, c: list[Any]) -> tree.Node:
        place = {"start": c[0].start_pos, "end": c[-1].end_pos}
        args = tuple(c[2:-1:2])
        if c[0].value in REDUCERS and len(args) == 1:
            return tree.Reduce(c[0].value, args[0], **place)
        return tree.Call(c[0].value, args, **place)

    def group(self, c: list[Any]) -> tree.Node:
        grown: tree.Node = replace(c[1], start=c[0].start_pos, end=c[2].end_pos)
        return grown
