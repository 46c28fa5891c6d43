"""What `sweep.json` says of a sweep that is over."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.program.worlds import component_dimension
from taskspec.spec import Task
from taskspec.spec.sweep import SUCCESS, RateExpectation
from taskspec.text.units import scaled
from taskspec_runner import exit_codes
from taskspec_runner.sweep.statistics import Influence, Rate, Region, influences, regions
from taskspec_runner.sweep.world_run import BROKEN, Row, expectation_keys
from taskspec_runner.sweep.worlds import RANDOM

MET, MISSED, UNDECIDED = "met", "missed", "undecided"
#: More worlds than this are told as more than it.
_MOST = 10_000_000


@dataclass(frozen=True, slots=True)
class JudgedRate:
    """An expectation of a sweep and what became of it.

    Attributes:
        text: as written.
        what: `success`, or the name of an expectation.
        least: probability that it is to have.
        rate: what was found.
        verdict: met, missed or undecided.
        needed: worlds more that decide it if the share stays as it is; None where it is decided, or
            where the share is the bound itself.
    """

    text: str
    what: str
    least: float
    rate: Rate
    verdict: str
    needed: int | None

    @staticmethod
    def of(expected: RateExpectation, rate: Rate) -> JudgedRate:
        """Met if the lower limit is above the bound, missed if the upper one is below it.

        Of worlds that were chosen the share itself is held against the bound.
        """
        if not rate.sampled:
            verdict = MET if rate.share >= expected.least else MISSED
            return JudgedRate(expected.text, expected.what, expected.least, rate, verdict, None)
        low, high = rate.interval()
        verdict = MET if low > expected.least else MISSED if high < expected.least else UNDECIDED
        needed = _needed(rate, expected.least) if verdict == UNDECIDED else None
        return JudgedRate(expected.text, expected.what, expected.least, rate, verdict, needed)

    def as_data(self) -> dict[str, Any]:
        """For `sweep.json`."""
        return {
            "text": self.text,
            "what": self.what,
            "least": self.least,
            "verdict": self.verdict,
            "needed": self.needed,
            **self.rate.as_data(),
        }


def _needed(rate: Rate, least: float) -> int | None:
    """Worlds more at the same share until Wilson's interval leaves a bound out."""
    share = rate.share
    if not rate.of or share == least:
        return None

    def decided(n: int) -> bool:
        low, high = Rate(round(share * n), n).interval() if 0 < share < 1 else (
            Rate(n if share else 0, n).interval()
        )  # fmt: skip
        return low > least or high < least

    n = rate.of
    while not decided(n):
        n *= 2
        if n > _MOST:
            return None
    low, high = n // 2, n
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if decided(middle) else (middle, high)
    return high - rate.of


def rate_text(rate: Mapping[str, Any]) -> str:
    """Such as `987 of 1000 worlds, 98.7 % (97.8 to 99.2 %)`."""
    share = 100 * rate["share"] if rate["of"] else 0.0
    ends = interval_text(rate)
    text = f"{rate['good']} of {rate['of']} worlds, {share:.4g} %{f' ({ends})' if ends else ''}"
    return f"{text}; {so_far_text(rate)}" if rate["so_far"] else text


def so_far_text(rate: Mapping[str, Any]) -> str:
    """Such as `39 of them as far as they got`; empty where every run came to its end."""
    return f"{rate['so_far']} of them as far as they got" if rate["so_far"] else ""


def drawn_text(task: Task, row: Row) -> str:
    """What a world is, such as `world.table.stiffness = 12 kN/m, robot.tool.mass = 1 kg`."""
    return ", ".join(
        f"{name} = {scaled(value, component_dimension(task, name), 3)}"
        for name, value in row.items()
        if name.startswith(("world.", "robot.")) and value is not None
    )


def interval_text(rate: Mapping[str, Any]) -> str:
    """Such as `97.8 to 99.2 %`; empty of worlds that were chosen."""
    if rate["interval"] is None:
        return ""
    low, high = (100 * each for each in rate["interval"])
    return f"{low:.4g} to {high:.4g} %"


def expectation_rates(
    task: Task, rows: Sequence[Row], *, sampled: bool = True
) -> dict[str, tuple[str, Rate]]:
    """Of each expectation its text and how often it was met, by what the table calls it.

    A run that did not come to its end is judged as far as it got.
    """
    ran = [row for row in rows if row["status"] != BROKEN]
    found = {}
    for key, text in expectation_texts(task).items():
        met = [row.get(f"expect {key}") for row in ran]
        so_far = met.count(None)
        found[key] = (text, Rate(met.count(True) + so_far, len(rows), sampled, so_far))
    return found


def expectation_texts(task: Task) -> dict[str, str]:
    """The expectations of a task, by what the table calls them."""
    return dict(zip(expectation_keys(task), (each.text for each in task.expect), strict=True))


def summarise(task: Task, rows: Sequence[Row], kind: str = RANDOM) -> dict[str, Any]:
    """What came of all worlds of a sweep.

    Args:
        task: of them.
        rows: in the order of the worlds.
        kind: of the worlds: random, corners or grid. Only random ones tell of a probability.
    """
    sampled = kind == RANDOM
    success = Rate(sum(row["success"] for row in rows), len(rows), sampled)
    by_text = expectation_rates(task, rows, sampled=sampled)
    judged = [JudgedRate.of(each, _rate(each.what, success, by_text)) for each in expected(task)]
    return {
        "success": success.as_data(),
        "expectations": [
            {"name": key, "text": text, **rate.as_data()} for key, (text, rate) in by_text.items()
        ],
        "judged": [each.as_data() for each in judged],
        "ends": _counts(rows),
        "worst": [
            {"end": end, "world": row["world"], "margin": row.get("margin")}
            for end, row in worst_worlds(rows).items()
        ],
        "influences": [_influence(each) for each in influences(rows)],
        "regions": [_region(each, task) for each in regions(rows)],
        "exit_code": exit_code(judged, rows),
    }


def expected(task: Task) -> tuple[RateExpectation, ...]:
    """What the file expects of its sweep."""
    return task.sweep.expect if task.sweep is not None else ()


def exit_code(judged: Sequence[JudgedRate], rows: Sequence[Row]) -> int:
    """MISSED unless all that is expected of the sweep was met and no world broke; else WELL."""
    broke = any(row["status"] == BROKEN for row in rows)
    missed = any(each.verdict != MET for each in judged)
    return exit_codes.MISSED if broke or missed else exit_codes.WELL


def worst_worlds(rows: Sequence[Row]) -> dict[str, Row]:
    """By kind of end, the most frequent first, the world with the least margin.

    Of worlds without a margin, as nothing was touched, it is the one that ended first.
    """
    found: dict[str, Row] = {}
    for end in _counts(rows):
        same = [row for row in rows if end_of(row) == end and row["status"] != BROKEN]
        if same:
            found[end] = min(same, key=_badness)
    return found


def worst_world(rows: Sequence[Row]) -> Row | None:
    """Of the worst worlds of all ends that without success, else that with the least margin."""
    worst = worst_worlds(rows).values()
    return min(worst, key=lambda row: (bool(row["success"]), _badness(row)), default=None)


def _badness(row: Row) -> tuple[float, float, int]:
    margin = row.get("margin")
    return (math.inf if margin is None else margin, row.get("duration", 0.0), row["world"])


def end_of(row: Row) -> str:
    """How a world ended: its verdict, and the reason where it was stopped or failed."""
    how = str(row["verdict"])
    return f"{how}: {row['reason']}" if how in ("stopped", "failed") else how


def _rate(what: str, success: Rate, by_text: Mapping[str, tuple[str, Rate]]) -> Rate:
    return success if what == SUCCESS else by_text[what][1]


def _counts(rows: Sequence[Row]) -> dict[str, int]:
    """How often worlds ended how."""
    found: dict[str, int] = {}
    for row in rows:
        how = end_of(row)
        found[how] = found.get(how, 0) + 1
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))


def _influence(each: Influence) -> dict[str, Any]:
    return {
        "parameter": each.parameter,
        "correlation": each.correlation,
        "explained": each.explained,
        "chance": each.chance,
    }


def _region(each: Region, task: Task) -> dict[str, Any]:
    return {
        "text": region_text(each, task),
        "failed": each.failed,
        "of": each.of,
        "splits": [
            {"parameter": s.parameter, "above": s.above, "value": s.value} for s in each.splits
        ],
    }


def region_text(region: Region, task: Task) -> str:
    """Such as `fails where world.table.friction > 0.34 and world.table.stiffness <= 9 kN/m`."""
    parts = [
        f"{split.parameter} {'>' if split.above else '<='} "
        f"{scaled(split.value, component_dimension(task, split.parameter), 3)}"
        for split in region.splits
    ]
    share = 100 * region.failed / region.of if region.of else math.nan
    return f"fails where {' and '.join(parts)}: {region.failed} of {region.of} ({share:.0f} %)"
