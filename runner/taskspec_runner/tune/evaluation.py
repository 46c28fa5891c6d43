"""How good some gains are: stable with a margin, and expectations met in worlds that vary."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec.examination import examine
from taskspec.program.context import Context
from taskspec.program.program import Program, compiled
from taskspec.program.worlds import World, corner_count, corner_world, draws_of, random_world
from taskspec.program.worlds import true_world as file_world
from taskspec.spec import LoadedTask, Task, load_text
from taskspec.text.diagnostic import Severity, SpecError
from taskspec_runner.loop.fixed_step import DONE
from taskspec_runner.sweep.world_run import BROKEN, Row, expectation_keys, run_world
from taskspec_runner.tune.intervals import Ends, narrowed, with_margin
from taskspec_runner.tune.loops import loop_faults

#: More corners than this are not all tried: so many of them, evenly apart.
_MOST_CORNERS = 16
#: Margins that differ by less are alike: a hundredth of what an expectation allows.
ALIKE = 0.01
#: Of a world whose run oscillates or saturates, with all expectations met.
_FOUND = -0.25


@dataclass(frozen=True, slots=True)
class Trials:
    """The worlds that gains are tried in.

    Attributes:
        corners: whether the corners of what varies are among them.
        randoms: the number of random ones.
        seed: of those.
        more: numbers of further random worlds, each with its seed.
    """

    corners: bool
    randoms: int
    seed: int
    more: tuple[tuple[int, int], ...] = ()

    def worlds(self, context: Context) -> list[World]:
        """The worlds of a task; that of its file where nothing varies."""
        if not draws_of(context):
            return [file_world(context, self.seed)]
        count = corner_count(context) if self.corners else 0
        kept = min(count, _MOST_CORNERS)
        picked = [round(i * (count - 1) / max(kept - 1, 1)) for i in range(kept)]
        numbered = [(self.seed, number) for number in range(self.randoms)]
        return [
            *(corner_world(context, index, self.seed) for index in picked),
            *(random_world(context, *each) for each in (*numbered, *self.more)),
        ]


@dataclass(frozen=True, slots=True)
class Key:
    """How good some gains are; of two the first entry that differs decides, the larger is better.

    Attributes:
        sound: 0, or -1 where the task is refused or a loop is unstable in a world.
        missing: sum of how far worlds are from success, 0 or below.
        ringing: minus the number of findings on loops that ring, or lack their margin.
        worst: least margin of all expectations and worlds.
        mean: mean of the least margin of each expectation.
    """

    sound: float
    missing: float
    ringing: float
    worst: float
    mean: float

    @property
    def entries(self) -> tuple[float, ...]:
        """In their order."""
        return (self.sound, self.missing, self.ringing, self.worst, self.mean)

    def better(self, other: Key) -> bool:
        """Whether it is clearly better than another one."""
        for mine, its in zip(self.entries, other.entries, strict=True):
            if mine == its or abs(mine - its) <= ALIKE:
                continue
            return mine > its
        return False


@dataclass(frozen=True, slots=True)
class Question:
    """Gains to be tried: all that a worker needs.

    Attributes:
        text, name, base: of the task file.
        overrides: with the gains.
        ends: of random numbers, where they are not those of the file.
        trials: the worlds.
        order: of these worlds; all of them in their own order where it is empty.
        rival: what is to be better than; it is broken off where it cannot be.
    """

    text: str
    name: str
    base: Path | None
    overrides: Mapping[str, str]
    ends: Mapping[str, Ends]
    trials: Trials
    order: tuple[int, ...] = ()
    rival: Key | None = None

    def loaded(self) -> LoadedTask:
        """The task with these gains, and with these ends.

        Raises:
            SpecError: it does not read.
        """
        task = load_text(self.text, self.name, dict(self.overrides), self.base)
        return narrowed(task, self.ends)


@dataclass(frozen=True, slots=True)
class TriedGains:
    """What became of some gains.

    Attributes:
        key: how good they are.
        rows: of the worlds that were run, by their index.
        against: what refuses them: findings, and loops that are unstable in a world.
        weak: loops that ring, or that lack their margin.
        whole: whether all worlds were run.
    """

    key: Key
    rows: Mapping[int, Row]
    against: tuple[str, ...]
    weak: tuple[str, ...]
    whole: bool

    @property
    def good(self) -> bool:
        """Whether it is stable in all worlds, and all of them succeed."""
        return self.whole and not self.against and all(r["success"] for r in self.rows.values())


def evaluate(question: Question) -> TriedGains:
    """Tries some gains: their sampled loops first, then world after world."""
    try:
        loaded = question.loaded()
        examined = examine(loaded, stability=False)
        errors = [each.message for each in examined.findings if each.severity is Severity.ERROR]
        if errors or examined.plan is None:
            return _refused(errors)
        program = Program(examined.plan, compiled(examined.plan), examined.findings)
    except SpecError as error:
        return _refused([each.message for each in error.diagnostics])
    context = program.context
    weak = [*loop_faults(program.plan, with_margin(loaded, context))]
    if any(each.unstable for each in weak):
        unstable = [each for each in loop_faults(program.plan, loaded) if each.unstable]
        if unstable:
            return _refused([each.text for each in unstable])
    worlds = question.trials.worlds(context)
    rows: dict[int, Row] = {}
    for index in question.order or range(len(worlds)):
        rows[index] = run_world(program, index, worlds[index])
        key = _key(loaded.task, rows, len(weak))
        if question.rival is not None and _beaten(key, question.rival):
            break
    texts = tuple(each.text for each in weak)
    return TriedGains(key, rows, (), texts, len(rows) == len(worlds))


def _refused(errors: Sequence[str]) -> TriedGains:
    key = Key(-1.0, -math.inf, -float(len(errors)), -math.inf, -math.inf)
    return TriedGains(key, {}, tuple(errors), (), whole=False)


def _beaten(key: Key, rival: Key) -> bool:
    """Whether more worlds cannot make it better than a rival: they only lower what it has."""
    if key.missing < rival.missing - ALIKE or rival.sound > key.sound:
        return key.sound <= rival.sound
    same = rival.missing == 0 and key.ringing <= rival.ringing
    return same and (key.ringing < rival.ringing or key.worst < rival.worst - ALIKE)


def _key(task: Task, rows: Mapping[int, Row], ringing: int) -> Key:
    scores = [score(task, row) for row in rows.values()]
    least = [
        min(found)
        for key in expectation_keys(task)
        if (found := [margin_in(row, key) for row in rows.values()])
    ]
    mean = sum(least) / len(least) if least else 0.0
    missing = sum(min(each, 0.0) for each in scores)
    return Key(0.0, missing, -float(ringing), min(scores), mean)


def margin_in(row: Row, key: str) -> float:
    """The margin of an expectation in a world, within one to either side.

    What has no margin counts as one way or the other.
    """
    margin, met = row.get(f"margin {key}"), row.get(f"expect {key}")
    if margin is None:
        margin = 1.0 if met is not False else -1.0
    return max(min(float(margin), 1.0), -1.0)


def score(task: Task, row: Row) -> float:
    """How far a world is from success where it is negative, else its least margin."""
    if row["status"] == BROKEN:
        return -3.0
    if row["status"] != DONE:
        stages = [*task.stages]
        passed = stages.index(row["stage"]) if row["stage"] in stages else 0
        return -2.0 + passed / len(stages)
    margins = [margin_in(row, key) for key in expectation_keys(task)]
    least = min(margins, default=1.0)
    if row["success"]:
        return max(least, 0.0)
    return min(least, _FOUND) if least >= 0 else least
