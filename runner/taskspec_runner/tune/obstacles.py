"""Which interval is in the way where no gains succeed in all worlds, and how far it would do."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from taskspec.deferred_methods import dataclass
from taskspec.spec import Task
from taskspec.spec.expectation import titled
from taskspec_runner.loop.fixed_step import DONE
from taskspec_runner.sweep.world_run import Row, expectation_keys
from taskspec_runner.tune.evaluation import TriedGains
from taskspec_runner.tune.gains import Setting
from taskspec_runner.tune.intervals import Ends, VariedNumber
from taskspec_runner.tune.search import Found, Searcher

#: Halvings of what an interval is shrunk by.
_HALVINGS = 4
#: Positive ends that differ by more than this factor are halved by their ratio.
_WIDE = 3.0


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A random number that varies, and how far it may so that gains are found.

    Attributes:
        interval: as the file has it.
        works: ends with which gains are found, all others as they are; None where there are none
            even where its value is known.
        setting: gains that do there; None where there are none.
        fails: what goes wrong where it is wider than that, or anyway.
    """

    interval: VariedNumber
    works: Ends | None
    setting: Setting | None
    fails: tuple[str, ...]


class Shrinking:
    """Shrinks one interval after the other until gains are found."""

    def __init__(self, searcher: Searcher, best: Found) -> None:
        """With gains that are best where all vary as they do.

        Args:
            searcher: of the task.
            best: that it found.
        """
        self._searcher, self._best = searcher, best
        self._pool: list[Setting] = [best.setting]

    def obstacle(self, interval: VariedNumber) -> Obstacle:
        """How far one may vary."""
        low, high = interval.draw.low, interval.draw.high
        middle = interval.anchor
        fails = self._why(self._best.evaluation)
        known = self._works(interval, (middle, middle))
        if not known.evaluation.good:
            return Obstacle(interval, None, None, self._why(known.evaluation) or fails)
        setting, ends = known.setting, (middle, middle)
        # One side as far as it goes, where it is not the one that is in the way.
        for side in (0, 1):
            wide = (low, ends[1]) if side == 0 else (ends[0], high)
            if wide == ends:
                continue
            found = self._works(interval, wide)
            if found.evaluation.good:
                setting, ends = found.setting, wide
            else:
                fails = self._why(found.evaluation) or fails
                ends, setting, fails = self._halved(interval, ends, wide, side, setting, fails)
        return Obstacle(interval, ends, setting, fails)

    def _halved(
        self,
        interval: VariedNumber,
        good: Ends,
        bad: Ends,
        side: int,
        setting: Setting,
        fails: tuple[str, ...],
    ) -> tuple[Ends, Setting, tuple[str, ...]]:
        """Ends between good and bad ones, of which one side differs."""
        for _ in range(_HALVINGS):
            between = _between(interval, good[side], bad[side])
            ends = (between, good[1]) if side == 0 else (good[0], between)
            found = self._works(interval, ends)
            if found.evaluation.good:
                good, setting = ends, found.setting
            else:
                bad, fails = ends, self._why(found.evaluation) or fails
        return good, setting, fails

    def _works(self, interval: VariedNumber, ends: Ends) -> Found:
        """Gains with other ends of one number: known ones, or those of a short search."""
        most = len(self._pool) + 4 * len(self._searcher.knobs)
        shown = interval.text(ends)
        found = self._searcher.best(
            self._pool,
            most,
            {interval.draw.name: ends},
            what=f"{interval.name}: {shown}",
            enough=True,
        )
        if found.evaluation.good and found.setting not in self._pool:
            self._pool.append(found.setting)
        return found

    def _why(self, evaluation: TriedGains) -> tuple[str, ...]:
        return failures(self._searcher.program.context.loaded.task, evaluation)


def _between(interval: VariedNumber, one: float, other: float) -> float:
    """The value in the middle of two of a number."""
    values = [interval.offset + interval.unit * each for each in (one, other)]
    if min(values) > 0 and max(values) > _WIDE * min(values):
        return (math.sqrt(values[0] * values[1]) - interval.offset) / interval.unit
    return (one + other) / 2


def failures(task: Task, evaluation: TriedGains) -> tuple[str, ...]:
    """What goes wrong, the most frequent first, such as `max(norm(force)) < 25 N (6 worlds)`."""
    if evaluation.against:
        return tuple(dict.fromkeys(evaluation.against))
    found: Counter[str] = Counter()
    for row in evaluation.rows.values():
        found.update(dict.fromkeys(_of_world(task, row), 1))
    ordered = sorted(found.items(), key=lambda item: (-item[1], item[0]))
    return tuple(f"{text} ({count} world{'s' * (count != 1)})" for text, count in ordered)


def _of_world(task: Task, row: Row) -> Iterator[str]:
    if row["success"]:
        return
    if row["status"] != DONE:
        yield (
            f"stage {row['stage']!r} {row['status']}: {row['reason']}"
            if "stage" in row
            else str(row["text"])
        )
        return
    for key, expected in zip(expectation_keys(task), task.expect, strict=True):
        if row.get(f"expect {key}") is False:
            yield titled(expected.name, expected.text)
    if row.get("findings"):
        yield str(row["findings"])


def obstacles(
    searcher: Searcher, best: Found, found: Sequence[VariedNumber]
) -> tuple[Obstacle, ...]:
    """Each interval with how far it may vary, in the order of the file."""
    shrinking = Shrinking(searcher, best)
    return tuple(shrinking.obstacle(each) for each in found)
