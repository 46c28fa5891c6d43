"""Which stage follows an event, how often a stage repeats itself, and how often it may be entered.

A kernel: Python's machine, machine code and exported C decide by this source.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taskspec.native.kernel import Record, Words
from taskspec.program.execution.transition import exits
from taskspec.program.stages.stage import CompiledStage

#: No stage follows: the task is over; or the stage has had its attempts.
OVER, TRIED = -1, -2
#: For how long at most a limit that has led to a stage does not count again [s].
RESTS = 0.5
#: The attempts of a stage that may be entered any number of times.
_ANY = -1


class ExitTable(Record):
    """The events of all stages, stage by stage.

    Attributes:
        first: (stages,) place of each stage's first event.
        to: (events,) number of the stage that follows, OVER for none.
        repeat: (events,) how often the stage is to end by it in a row before it leads there.
        attempts: (stages,) how often it may be entered from another one; -1 for any number.
        tries: (stages,) how often it has been.
        rounds: (1,) how often the current stage has been done in a row.
    """

    first: Words
    to: Words
    repeat: Words
    attempts: Words
    tries: Words
    rounds: Words


def exit_table(stages: Sequence[CompiledStage]) -> ExitTable:
    """The table of a task before its first stage."""
    table = exits(stages)
    flat = [out for outs in table for out in outs]
    ends = np.cumsum([0, *(len(outs) for outs in table)])
    attempts = [stage.plan.spec.attempts or _ANY for stage in stages]
    words = {
        "first": ends[:-1],
        "to": [OVER if out.index is None else out.index for out in flat],
        "repeat": [out.repeat for out in flat],
        "attempts": attempts,
        "tries": [0] * len(stages),
        "rounds": [0],
    }
    return ExitTable(**{name: np.array(values, np.int64) for name, values in words.items()})


def repeats(c: ExitTable, stage: int, event: int) -> bool:
    """Whether a stage that ends by an event, from 1 on, is to be done again."""
    return c.rounds[0] < c.repeat[c.first[stage] + event - 1]


def follows(c: ExitTable, stage: int, event: int) -> int:
    """The number of the stage that follows an event, from 1 on; OVER or TRIED."""
    if repeats(c, stage, event):
        return stage
    to = c.to[c.first[stage] + event - 1]
    if to >= 0 and c.attempts[to] >= 0 and c.tries[to] >= c.attempts[to]:
        return TRIED
    return to


def enter(c: ExitTable, stage: int, again: bool) -> None:
    """Counts a stage that begins, `again` where it repeats itself."""
    if again:
        c.rounds[0] += 1
    else:
        c.rounds[0] = 1
        c.tries[stage] += 1
