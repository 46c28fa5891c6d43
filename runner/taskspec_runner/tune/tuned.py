"""From a task whose world varies to gains that succeed in all of it, or to what is in the way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from taskspec.compiler import compile_unchecked
from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.spec import load_text
from taskspec.spec.expectation import titled
from taskspec.text.diagnostic import SpecError
from taskspec_runner.errors import InputError
from taskspec_runner.sweep.engine import processes
from taskspec_runner.sweep.statistics import Rate
from taskspec_runner.sweep.world_run import expectation_keys
from taskspec_runner.tune.evaluation import Trials, TriedGains, evaluate, margin_in
from taskspec_runner.tune.gains import Knob, Setting, Values, knobs_of, overrides
from taskspec_runner.tune.intervals import intervals
from taskspec_runner.tune.obstacles import Obstacle, failures, obstacles
from taskspec_runner.tune.search import Searcher, Watch

#: Fresh worlds that a worker is given at once.
_AT_ONCE = 10
#: Times that worlds of a verification which fail are searched with and verified anew.
_ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be tuned, and how long it may take.

    Attributes:
        only: names of gains; empty for all.
        randoms: random worlds of the search, beside the corners.
        fresh: worlds of which none was searched with, that the result is verified in.
        most: settings that are tried.
        seed: of everything random.
        jobs: settings that are tried at once.
    """

    only: tuple[str, ...] = ()
    randoms: int = 8
    fresh: int = 50
    most: int = 100
    seed: int = 0
    jobs: int = 1


@dataclass(frozen=True, slots=True)
class MovedGain:
    """A gain that was moved.

    Attributes:
        knob: the gain and its axes.
        before: as the file has it, or as it was designed.
        after: as it is now.
    """

    knob: Knob
    before: Values
    after: Values


@dataclass(frozen=True, slots=True)
class Tuned:
    """What tuning came to.

    Attributes:
        program: of the file as it is.
        before, after: the file's gains and the best ones, in all worlds of the search.
        moved: the gains that differ.
        overrides: that the file needs, path to text, in order.
        verified: how often fresh worlds succeed, before and after; None where nothing varies, or
            where no gains were found.
        worst_fresh: what goes wrong in fresh worlds.
        obstacles: intervals, where no gains were found.
        tried: settings that were.
        worlds: that the search tried them in.
    """

    program: Program
    before: TriedGains
    after: TriedGains
    moved: tuple[MovedGain, ...]
    overrides: Mapping[str, str]
    verified: tuple[Rate, Rate] | None
    worst_fresh: tuple[str, ...]
    obstacles: tuple[Obstacle, ...]
    tried: int
    worlds: int

    @property
    def good(self) -> bool:
        """Whether the gains succeed in all worlds, fresh ones among them."""
        fresh = self.verified is None or self.verified[1].good == self.verified[1].of
        return self.after.good and fresh

    def margins(self) -> list[tuple[str, float | None, float | None]]:
        """Each expectation with its least margin before and after; None of what never ran."""
        task = self.program.context.loaded.task
        found = []
        for key, expected in zip(expectation_keys(task), task.expect, strict=True):
            least = [
                min((margin_in(row, key) for row in each.rows.values()), default=None)
                for each in (self.before, self.after)
            ]
            found.append((titled(expected.name, expected.text), least[0], least[1]))
        return found

    def as_data(self) -> dict[str, Any]:
        """For scripts."""
        fresh = None
        if self.verified is not None:
            before, after = (rate.as_data() for rate in self.verified)
            fresh = {"before": before, "after": after, "fails": list(self.worst_fresh)}
        task = self.program.context.loaded.task
        return {
            "task": task.name,
            "found": self.good,
            "set": dict(self.overrides),
            "gains": [
                {
                    "stages": list(each.knob.stages),
                    "gain": each.knob.key,
                    "before": dict(each.before),
                    "after": dict(each.after),
                }
                for each in self.moved
            ],
            "worlds": self.worlds,
            "good_before": sum(row["success"] for row in self.before.rows.values()),
            "good_after": sum(row["success"] for row in self.after.rows.values()),
            "refused_before": list(self.before.against),
            "refused_after": list(self.after.against),
            "weak": list(self.after.weak),
            "fails": list(failures(task, self.after)),
            "margins": [
                {"expectation": text, "before": before, "after": after}
                for text, before, after in self.margins()
            ],
            "verified": fresh,
            "intervals": [
                {
                    "name": each.interval.name,
                    "given": each.interval.text((each.interval.draw.low, each.interval.draw.high)),
                    "works": None if each.works is None else each.interval.text(each.works),
                    "fails": list(each.fails),
                }
                for each in self.obstacles
            ],
            "tried": self.tried,
        }


def tune(program: Program, wanted: Wanted, watch: Watch | None = None) -> Tuned:
    """Looks for gains of a task that succeed in all worlds of its `vary`.

    Args:
        program: of the file, compiled without regard to findings.
        wanted: what is moved, and how long it may take.
        watch: called after each setting.

    Raises:
        InputError: the file expects nothing, or none of its gains can be moved.
    """
    task = program.context.loaded.task
    if not task.expect:
        raise InputError(
            "this task expects nothing, so any gains would do: give it an 'expect', such as "
            "expect: [max(norm(force)) < 25 N]"
        )
    knobs = knobs_of(program, wanted.only)
    if not knobs:
        known = sorted({knob.key for knob in knobs_of(program)})
        named = (
            f"named {', '.join(wanted.only)}; it has {', '.join(known)}" if known else "that move"
        )
        raise InputError(f"no stage of this task has a gain {named}")
    trials = Trials(corners=True, randoms=wanted.randoms, seed=wanted.seed)
    with _workers(wanted.jobs) as executor:
        searcher = Searcher(program, knobs, trials, executor, watch)
        return _tuned(searcher, wanted, executor)


@contextmanager
def _workers(jobs: int) -> Iterator[Executor | None]:
    if jobs == 1:
        yield None
        return
    with processes(jobs) as pool:
        yield pool


def _tuned(searcher: Searcher, wanted: Wanted, executor: Executor | None) -> Tuned:
    program, knobs = searcher.program, searcher.knobs
    here: Setting = (None,) * len(knobs)
    best = searcher.best([here, *_designs(program, knobs)], wanted.most)
    if best.evaluation.good:
        best = searcher.fewest(best, 2 * len(knobs))
    verified: tuple[Rate, Rate] | None = None
    wrong: tuple[str, ...] = ()
    fresh = wanted.fresh if program.context.loaded.task.vary else 0
    for attempt in range(_ROUNDS if fresh and best.evaluation.good else 0):
        seed = wanted.seed + 1 + attempt
        rates, failed, wrong = _verified(searcher, (here, best.setting), seed, fresh, executor)
        verified = (rates[0], rates[1])
        if not failed or attempt == _ROUNDS - 1:
            break
        more = (*searcher.trials.more, *((seed, number) for number in failed))
        searcher.trials = replace(searcher.trials, more=more)
        better = searcher.best([best.setting], wanted.most // _ROUNDS)
        if not better.evaluation.good:
            break
        best = better
    [before, after] = searcher.evaluated([here, best.setting], {})
    found: tuple[Obstacle, ...] = ()
    if not after.evaluation.good:
        found = obstacles(searcher, after, intervals(program.context))
    changed = overrides(program, knobs, best.setting)
    return Tuned(
        program,
        before.evaluation,
        after.evaluation,
        tuple(
            MovedGain(knob, knob.values, values)
            for knob, values in zip(knobs, best.setting, strict=True)
            if values is not None
        ),
        changed,
        verified,
        wrong,
        found,
        searcher.tried,
        max(len(before.evaluation.rows), len(after.evaluation.rows)),
    )


def _designs(program: Program, knobs: Sequence[Knob]) -> list[Setting]:
    """Settings to begin with: what the laws design for the file, and for contacts at their ends."""
    loaded = program.context.loaded
    bare = overrides(program, knobs, (None,) * len(knobs), bare=True)
    stiff: list[dict[str, str]] = [{}, {}]
    for each in intervals(program.context):
        if each.name.endswith(".stiffness") and each.dimension is not None:
            for ends, drawn in zip(stiff, (each.draw.low, each.draw.high), strict=True):
                ends[each.name] = f"{each.offset + each.unit * drawn!r} N/m"
    found = []
    for world in ({}, *stiff):
        try:
            given = {**loaded.overrides, **bare, **world}
            designed = compile_unchecked(
                load_text(loaded.source.text, loaded.source.name, given, loaded.base)
            )
        except SpecError:
            continue
        found.append(tuple(_of(designed, knob) for knob in knobs))
    return found


def _of(program: Program, knob: Knob) -> Values | None:
    """The values of a knob in another program; None where it lacks them."""
    gains = next(s.plan.gains for s in program.stages if s.name == knob.stages[0])
    by = gains.get(knob.gain.name, {})
    values = {on: by[on].value for on in knob.values if on in by and by[on].value > 0}
    return values if len(values) == len(knob.values) else None


def _verified(
    searcher: Searcher,
    settings: tuple[Setting, Setting],
    seed: int,
    count: int,
    executor: Executor | None,
) -> tuple[list[Rate], list[int], tuple[str, ...]]:
    """How often settings succeed in worlds of a seed; which of the last's fail, and why."""
    task = searcher.program.context.loaded.task
    parts = [range(i, min(i + _AT_ONCE, count)) for i in range(0, count, _AT_ONCE)]
    rates, failed = [], []
    wrong: tuple[str, ...] = ()
    for setting in settings:
        whole_question = searcher.question(setting, {})
        questions = [
            replace(whole_question, trials=Trials(False, 0, seed, tuple((seed, i) for i in part)))
            for part in parts
        ]
        done = list(executor.map(evaluate, questions) if executor else map(evaluate, questions))
        rows = [row for each in done for row in each.rows.values()]
        rates.append(Rate(sum(row["success"] for row in rows), count))
        failed = [i for i, row in enumerate(rows) if not row["success"]]
        whole = replace(done[0], rows=dict(enumerate(rows)))
        wrong = failures(task, whole)
    return rates, failed, wrong
