"""Which law did best: by outcome, then by expectations met, then by the error that is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

Json = Mapping[str, Any]

#: Outcomes, from the one that is most worth.
ORDER = ("passed", "done", "missed", "failed", "stopped")


def ranks(laws: Sequence[Json], force_axes: Mapping[str, Sequence[str]]) -> list[int | None]:
    """The rank of each law from 1; None of those that made no run to be ranked.

    Equal outcomes and numbers of expectations met are told apart by the largest RMS error of force
    over the stages in which a force is to be reached, without any by that of motion over all.
    Laws that are equal in that, too, share a rank.
    """
    kind = "force" if any(force_axes.values()) else "motion"
    worth = [_worth(law, kind, force_axes) for law in laws]
    order = sorted({each for each in worth if each is not None})
    return [None if each is None else _place(each, worth, order) for each in worth]


def _place(
    each: tuple[int, int, float],
    worth: Sequence[tuple[int, int, float] | None],
    order: Sequence[tuple[int, int, float]],
) -> int:
    before = set(order[: order.index(each)])
    return 1 + sum(other in before for other in worth)


def _worth(
    law: Json, kind: str, force_axes: Mapping[str, Sequence[str]]
) -> tuple[int, int, float] | None:
    """What is least of the best law."""
    if law["outcome"] not in ORDER or "stages" not in law:
        return None
    stages = {n: s for n, s in law["stages"].items() if kind == "motion" or force_axes.get(n)}
    errors = [s[kind]["rms_error"] for s in stages.values() if s.get(kind)]
    error = max((e for e in errors if e is not None), default=math.inf)
    return ORDER.index(law["outcome"]), -law["met"], error
