"""Torque steps at changes of stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from taskspec.program.execution.transition import Transition

#: From here on a step is worth a line [N m].
NOTICED = 0.5


def largest_step(transitions: Sequence[Transition]) -> dict[str, Any] | None:
    """The largest step of a joint's torque at a change of stage; None without a change."""
    changes = list(pairwise(transitions))
    if not changes:
        return None
    before, after = max(changes, key=lambda pair: pair[0].torque_step)
    return {
        "value": before.torque_step,
        "from": before.stage,
        "to": after.stage,
        "clock": before.clock,
    }


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """The largest step in words; nothing where there is none to speak of."""
    step = summary.get("torque_step")
    if step and step["value"] >= NOTICED:
        yield (
            f"{step['to']}: its first torque is {step['value']:.3g} N*m off the last of "
            f"{step['from']!r}, at {step['clock']:.3f} s"
        )
