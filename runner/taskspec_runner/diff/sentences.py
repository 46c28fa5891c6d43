"""The sentences about where two logs part."""

from __future__ import annotations

from taskspec_runner.diff.difference import NAMES
from taskspec_runner.diff.logs import Apart, LogDifference
from taskspec_runner.pages.numbers import quantity

#: Columns that a sentence names; it counts the others.
_NAMED = 3


def parting(logs: LogDifference) -> str:
    """Where two logs part, in one sentence."""
    if not all(logs.ticks):
        without = " and ".join(n for n, t in zip(NAMES, logs.ticks, strict=True) if not t)
        return f"There is no tick to compare in {without}."
    if not logs.apart:
        return _longer(logs)
    first, *others = logs.first
    where = f"in stage {logs.stages[0]}"
    if logs.stages[0] != logs.stages[1]:
        where = f"in stage {logs.stages[0]} of A, {logs.stages[1]} of B"
    named = [_values(each) for each in (first, *others)[:_NAMED]]
    left = len(others) + 1 - len(named)
    more = f", and {left} more column{'s' if left > 1 else ''}" if left else ""
    when = f"The logs part at tick {first.tick}, {first.clock:.3f} s, {where}"
    return f"{when}: {', '.join(named)}{more}."


def _values(each: Apart) -> str:
    return f"{each.name} {' against '.join(value_text(v, each.unit) for v in each.values)}"


def value_text(value: float | str | None, unit: str) -> str:
    """A value of a log with its unit and all digits that may matter."""
    if value is None:
        return "no value"
    return value if isinstance(value, str) else f"{value:.9g} {unit}".rstrip()


def largest_text(each: Apart) -> str:
    """The largest difference of a column, as a figure with its unit."""
    if each.largest != each.largest:
        return "–"
    value, unit = quantity(each.largest, each.unit)
    if value == "0":
        # A difference in the last digit is none that one would call zero here.
        value, unit = f"{each.largest:.1e}", each.unit
    return f"{value} {unit}".rstrip()


def _longer(logs: LogDifference) -> str:
    a, b = logs.ticks
    only = [f"{name} alone has {', '.join(columns)}"
            for name, columns in zip(NAMES, logs.only, strict=True) if columns]  # fmt: skip
    apart = f" {'; '.join(only)}." if only else ""
    if a == b:
        same = "in the columns that both have" if only else "in all columns"
        return f"The logs are the same for all {a} ticks, {same}.{apart}"
    rest = f"then {NAMES[b > a]} goes on for {abs(a - b)}"
    return f"The logs are the same for {min(a, b)} ticks; {rest}.{apart}"
