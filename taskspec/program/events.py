"""What can end a stage or stop a run, in the order in which one tick decides."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.program.operators import choice

#: Kinds in falling precedence: a limit that stops the run, one that leads to a stage, `fail_if`,
#: `until`, `within`.
LIMIT, REACTION = "limit", "reaction"
FAIL_IF, UNTIL, WITHIN, DONE = "fail_if", "until", "within", "done"
#: Name of an event that leads to a stage which has been entered as often as it may be.
ATTEMPTS = "attempts"
_ORDER = (LIMIT, REACTION, FAIL_IF, UNTIL, WITHIN, DONE)


@dataclass(frozen=True, slots=True)
class Event:
    """One reason for a stage to end.

    Attributes:
        kind: limit, reaction, fail_if, until, within or done.
        name: what a user calls it: force, speed, joint_position, `until`, time, travel, ...
        text: the condition as a sentence, with its bound.
        then: the stage that a limit leads to.
        way: the number of the branch of the stage that it takes, where that ends well.
    """

    kind: str
    name: str
    text: str
    way: int = -1
    then: str = ""

    @property
    def is_limit(self) -> bool:
        """Whether it is a limit, which holds on a stage's first tick, too."""
        return self.kind in (LIMIT, REACTION)


@dataclass(frozen=True, slots=True)
class Condition:
    """An event with the expression that raises it; `value` is the quantity held against a bound."""

    event: Event
    holds: ca.SX
    value: ca.SX


def code(conditions: Sequence[Condition]) -> tuple[ca.SX, ca.SX, tuple[Event, ...]]:
    """The event of a tick as a number.

    Returns:
        The 1-based index of the first condition that holds (0 for none), the value of its
        quantity, and the events in that order.
    """
    ordered = sorted(conditions, key=lambda c: _ORDER.index(c.event.kind))
    index, value = ca.SX(0), ca.SX(0)
    for number in range(len(ordered), 0, -1):
        condition = ordered[number - 1]
        index = choice(condition.holds, ca.SX(number), index)
        value = choice(condition.holds, condition.value, value)
    return index, value, tuple(c.event for c in ordered)
