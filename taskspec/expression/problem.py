"""What is wrong with an expression, and where inside its text."""

from __future__ import annotations

from collections.abc import Iterable

from taskspec.deferred_methods import dataclass


@dataclass(frozen=True, slots=True)
class Problem:
    """A finding at the characters `start` to `end` (exclusive) of an expression.

    A `warning` says what is doubtful in an expression that can be computed.
    """

    code: str
    message: str
    start: int
    end: int
    hint: str = ""
    warning: bool = False


class ExpressionError(Exception):
    """An expression is wrong; `problems` says how, and there is at least one."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(p.message for p in self.problems))
