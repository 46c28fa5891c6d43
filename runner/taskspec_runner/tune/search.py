"""A pattern search over factors on gains: the same on every machine, however many work at it.

Around the best setting each knob is moved up and down by a factor. The best of these is taken, or
what all that are better come to together; where none is, the factor becomes smaller. Hooke, Jeeves:
"Direct search" solution of numerical and statistical problems, Journal of the ACM 8 (1961).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec_runner.tune.evaluation import Question, Trials, TriedGains, evaluate, score
from taskspec_runner.tune.gains import Knob, Setting, overrides
from taskspec_runner.tune.intervals import Ends

#: Factors by which knobs are moved, from the first to the last.
_FACTORS = (2.0, 1.4, 1.2)


@dataclass(frozen=True, slots=True)
class SearchGlimpse:
    """A search as it goes on.

    Attributes:
        what: that it looks for.
        tried: gains so far.
        most: that are tried.
        best: of them; None before the first.
    """

    what: str
    tried: int
    most: int
    best: TriedGains | None


Watch = Callable[[SearchGlimpse], None]


@dataclass(frozen=True, slots=True)
class Found:
    """A setting and what became of it."""

    setting: Setting
    evaluation: TriedGains


class Searcher:
    """Tries settings of a task's gains.

    Attributes:
        knobs: that are moved.
        tried: how many settings were.
    """

    def __init__(
        self,
        program: Program,
        knobs: Sequence[Knob],
        trials: Trials,
        executor: Executor | None = None,
        watch: Watch | None = None,
    ) -> None:
        """Of a task.

        Args:
            program: of the file as it is.
            knobs: of it.
            trials: the worlds that decide.
            executor: whose workers try settings; None for this process.
            watch: called after each.
        """
        self.program, self.knobs, self.trials = program, knobs, trials
        self._executor, self._watch = executor, watch
        self.tried = 0
        self._most, self._what = 0, ""
        self._moving = [*range(len(knobs))]

    def overrides(self, setting: Setting) -> dict[str, str]:
        """All overrides of the file with a setting."""
        given = dict(self.program.context.loaded.overrides)
        return given | overrides(self.program, self.knobs, setting)

    def question(self, setting: Setting, ends: Mapping[str, Ends]) -> Question:
        """What a setting is to be tried in."""
        loaded = self.program.context.loaded
        given = self.overrides(setting)
        return Question(
            loaded.source.text, loaded.source.name, loaded.base, given, dict(ends), self.trials
        )

    def evaluated(
        self,
        settings: Sequence[Setting],
        ends: Mapping[str, Ends],
        than: TriedGains | None = None,
    ) -> list[Found]:
        """Settings with what became of them.

        Args:
            settings: to be tried.
            ends: of random numbers where they are not those of the file.
            than: where they cannot be better than this, they are broken off.
        """
        questions = [self.question(each, ends) for each in settings]
        if than is not None:
            task = self.program.context.loaded.task
            order = sorted(than.rows, key=lambda index: (score(task, than.rows[index]), index))
            questions = [replace(q, order=tuple(order), rival=than.key) for q in questions]
        done: Iterable[TriedGains] = (
            map(evaluate, questions)
            if self._executor is None
            else self._executor.map(evaluate, questions)
        )
        found = []
        for setting, evaluation in zip(settings, done, strict=True):
            found.append(Found(setting, evaluation))
            self.tried += 1
            if self._watch is not None:
                self._watch(
                    SearchGlimpse(self._what, self.tried, max(self._most, self.tried), than)
                )
        return found

    def best(
        self,
        starts: Sequence[Setting],
        most: int,
        ends: Mapping[str, Ends] | None = None,
        *,
        what: str = "gains",
        enough: bool = False,
    ) -> Found:
        """The best setting that is found.

        Args:
            starts: settings to begin with.
            most: settings that are tried, beyond which none is begun.
            ends: of random numbers where they are not those of the file.
            what: is looked for, in words.
            enough: whether the first that succeeds in all worlds will do.
        """
        ends = {} if ends is None else ends
        last, self._what = self.tried + most, what
        self._moving = [*range(len(self.knobs))]
        self._most = last
        best: Found | None = None
        unlike = [each for i, each in enumerate(starts) if each not in starts[:i]]
        for found in self.evaluated(unlike, ends):
            best = found if best is None or _beats(found, best) else best
            if enough and best.evaluation.good:
                return best
        assert best is not None
        for factor in _FACTORS:
            while self.tried < last and not (enough and best.evaluation.good):
                better = self._around(best, factor, ends)
                if better is None:
                    break
                best = better
        return best

    def _around(self, best: Found, factor: float, ends: Mapping[str, Ends]) -> Found | None:
        """A better setting about one; None where all moves by a factor are worse."""
        moves = [
            (i, by)
            for i in self._moving
            for by in (factor, 1 / factor)
            if self.knobs[i].reaches(best.setting[i], by)
        ]
        settings = [self._moved(best.setting, [move]) for move in moves]
        tried = self.evaluated(settings, ends, best.evaluation)
        better = [
            (move, found) for move, found in zip(moves, tried, strict=True) if _beats(found, best)
        ]
        # What changes nothing either way is left alone: it costs all worlds to find that again.
        idle = [knob for (knob, _), found in zip(moves, tried, strict=True) if _same(found, best)]
        self._moving = [i for i in self._moving if idle.count(i) < len((factor, 1 / factor))]
        if not better:
            return None
        first: dict[int, tuple[float, Found]] = {}
        for (knob, by), found in better:
            if knob not in first or _beats(found, first[knob][1]):
                first[knob] = (by, found)
        single = better[0][1]
        for _, found in better[1:]:
            single = found if _beats(found, single) else single
        if len(first) == 1:
            return single
        together = self._moved(best.setting, [(knob, by) for knob, (by, _) in first.items()])
        [found] = self.evaluated([together], ends, single.evaluation)
        return found if _beats(found, single) else single

    def _moved(self, setting: Setting, moves: Sequence[tuple[int, float]]) -> Setting:
        values = list(setting)
        for knob, factor in moves:
            values[knob] = self.knobs[knob].times(setting[knob], factor)
        return tuple(values)

    def fewest(self, best: Found, most: int) -> Found:
        """The same with every gain left out that makes nothing better.

        Args:
            best: a setting.
            most: settings that are tried.
        """
        last = self.tried + most
        self._most, self._what = last, "gains that may be left out"
        for i, values in enumerate(best.setting):
            if values is None or self.tried >= last:
                continue
            without = (*best.setting[:i], None, *best.setting[i + 1 :])
            [found] = self.evaluated([without], {})
            if not best.evaluation.key.better(found.evaluation.key):
                best = found
        return best


def _beats(one: Found, other: Found) -> bool:
    return one.evaluation.whole >= other.evaluation.whole and one.evaluation.key.better(
        other.evaluation.key
    )


def _same(one: Found, other: Found) -> bool:
    mine, its = one.evaluation, other.evaluation
    return mine.whole and not (mine.key.better(its.key) or its.key.better(mine.key))
