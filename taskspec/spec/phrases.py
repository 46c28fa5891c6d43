"""Expectations in everyday words, such as `peak force < 60 N`, as expressions."""

from __future__ import annotations

import re

from taskspec.expression import ExpressionError, check, parse
from taskspec.expression.scope import ScopeKind
from taskspec.spec.parse_context import ParseContext

_REDUCERS = {
    "peak": "max", "max": "max", "maximum": "max", "maximal": "max", "greatest": "max",
    "largest": "max", "highest": "max", "min": "min", "minimum": "min", "minimal": "min",
    "smallest": "min", "lowest": "min", "mean": "mean", "average": "mean", "avg": "mean",
    "rms": "rms", "std": "std", "final": "last", "last": "last", "end": "last",
}  # fmt: skip
"""What people call a value over time, and the function."""
_SIGNALS = {
    "force": "norm({}force)", "contact force": "norm({}force)", "normal force": "{}force.z",
    "torque": "norm({}torque)", "moment": "norm({}torque)", "speed": "norm({}velocity)",
    "velocity": "norm({}velocity)",
}  # fmt: skip
"""What people call a signal, and its expression, with `{}` for the stage."""
_REDUCED = re.compile(
    rf"(?P<reducer>{'|'.join(_REDUCERS)})[ _](?:of[ _])?(?:the )?(?P<of>.+)", re.I
)
_AT_END = re.compile(r"(?P<of>.+?) (?:at|in) (?:the )?end(?: of (?P<stage>\w+))?", re.I)
_RELATION = re.compile(r"(?P<left>[^<>]+?)\s*(?P<rest>(?:[<>]=?|\bwithin\b).*)")
_END_LAST = re.compile(r"(?P<rest>.+?)(?P<end> (?:at|in) (?:the )?end(?: of \w+)?)", re.I)


def meant_by(text: str, context: ParseContext) -> str:
    """The condition that stands for one in everyday words; empty where it is none of them.

    Args:
        text: of an expectation, on one line.
        context: the pass, which knows the stages.
    """
    if (found := _END_LAST.fullmatch(text)) and (split := _RELATION.fullmatch(found["rest"])):
        text = f"{split['left']}{found['end']} {split['rest']}"
    split = _RELATION.fullmatch(text)
    if split is None:
        return ""
    written = _value(split["left"], context)
    if re.match(r">=? *-", split["rest"]):
        # The peak of a force that is negative is its least value.
        written = re.sub(r"^max\(", "min(", written)
    condition = f"{written} {split['rest']}"
    return condition if written and is_condition(condition, context) else ""


def _value(text: str, context: ParseContext) -> str:
    """The reduced signal of a phrase such as `peak force in press`; empty for none."""
    stage, text = _stage(text, context)
    if (found := _AT_END.fullmatch(text)) is not None:
        reducer, text, named = "last", found["of"], found["stage"]
    elif (found := _REDUCED.fullmatch(text)) is not None:
        reducer, text, named = _REDUCERS[found["reducer"].lower()], found["of"], None
    else:
        return ""
    inner, text = _stage(text, context)
    stage = named or stage or inner
    head = f"{stage}." if stage else ""
    signal = _SIGNALS.get(text.lower().replace("_", " "), "")
    return f"{reducer}({signal.format(head) if signal else head + text})"


def _stage(text: str, context: ParseContext) -> tuple[str, str]:
    """The stage that a phrase names before or behind a signal, and the rest of it."""
    for name in context.stages:
        word = re.escape(name)
        for form in (rf"{word}[. ](?P<rest>.+)", rf"(?P<rest>.+?) (?:in|during|of|while) {word}"):
            if (found := re.fullmatch(form, text)) is not None:
                return name, found["rest"]
    return "", text


def is_condition(text: str, context: ParseContext) -> bool:
    """Whether a text is a condition that nothing is wrong with."""
    try:
        return not check(parse(text, "logic"), context.scope(ScopeKind.EXPECT), None).problems
    except ExpressionError:
        return False
