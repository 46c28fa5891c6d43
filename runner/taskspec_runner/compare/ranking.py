"""Which law did best: by outcome, then by expectations met, then by the error that is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from taskspec.laws.design import SPRING_DAMPING_RATIO, SPRING_FREQUENCY

Json = Mapping[str, Any]

#: Outcomes, from the one that is most worth.
ORDER = ("passed", "done", "missed", "failed", "stopped")


#: Errors up to this share above the least of a rank share it: designed gains are round numbers, and
#: another one that is as good a choice moves the error by more.
TIE = 0.05
#: How ranks come about, for readers of the numbers.
RANKED = (
    "Ranked by outcome, then by expectations met, then by the largest RMS error of {kind}; errors "
    f"within {TIE:.0%} share a rank."
)
#: With which gains the laws were run.
DESIGNED = (
    "Every law but the one as written runs with its designed gains, so this compares designs, not "
    "equations alone."
)
#: The same where they are equal.
EQUAL_BANDWIDTH = (
    f"Every law but the one as written moves with a bandwidth of {SPRING_FREQUENCY:g} Hz and a "
    f"damping ratio of {SPRING_DAMPING_RATIO:g}; force loops are designed by one rule under all "
    "laws. So this compares equations."
)


def compared_by(force_axes: Mapping[str, Sequence[str]]) -> str:
    """The kind of error that decides: force where a force is to be reached, else motion."""
    return "force" if any(force_axes.values()) else "motion"


def ranks(laws: Sequence[Json], force_axes: Mapping[str, Sequence[str]]) -> list[int | None]:
    """The rank of each law from 1; None of those that made no run to be ranked.

    Equal outcomes and numbers of expectations met are told apart by the largest RMS error of force
    over the stages in which a force is to be reached, without any by that of motion over all.
    Laws whose errors are within `TIE` of the least of their rank share it.
    """
    kind = compared_by(force_axes)
    found = {i: worth for i, law in enumerate(laws) if (worth := _worth(law, kind, force_axes))}
    places: list[int | None] = [None] * len(laws)
    leading, rank = None, 0
    for number, i in enumerate(sorted(found, key=lambda i: found[i]), 1):
        if leading is None or not _ties(found[i], leading):
            leading, rank = found[i], number
        places[i] = rank
    return places


def _ties(one: tuple[int, int, float], leading: tuple[int, int, float]) -> bool:
    return one == leading or (one[:2] == leading[:2] and one[2] <= leading[2] * (1 + TIE))


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
