"""The examination of a task: its plan, and what all rules find before anything moves.

Text, names, units and modes are checked while the file is read; here the robot, its start, its
axes and its contacts come in.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import taskspec.rules.all  # noqa: F401  (it registers the rules)
from taskspec.examined import Examination
from taskspec.planning import plan_task
from taskspec.program.plan import TaskPlan
from taskspec.rules import Phase, apply_rules
from taskspec.rules.finding import warning
from taskspec.spec import FILE, LoadedTask
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostic, Diagnostics, SpecError
from taskspec.text.units import Dimension, show

IN_PART = "TS623"
register({IN_PART: "a task that is checked in part"})

#: Stages of one file that a bounded examination plans. Each takes some 10 ms of a processor, and
#: 50 ms more where its loop is analysed and it is run.
MOST_STAGES = 50
#: Of a file with more, the stages for which a start is searched.
_SEARCHED = 10
#: Processor time after which a bounded examination of one file goes on with no further part [s].
MOST_SECONDS = 60.0


class ExaminationBounds:
    """How much of a file is examined.

    Attributes:
        most: stages that are planned.
    """

    def __init__(self, most: int = MOST_STAGES, seconds: float = MOST_SECONDS) -> None:
        """Bounds that count from now on; `seconds` of processor time."""
        self.most, self._seconds = most, seconds
        self._end = time.process_time() + seconds

    def searched(self, loaded: LoadedTask) -> int | None:
        """Stages of a task for which a start is searched; None for all of them.

        Some fifteen starts are followed through them where the nearest one lacks room.
        """
        return None if len(loaded.task.stages) <= self.most else _SEARCHED

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return time.process_time() > self._end

    def left_out(self, task: TaskPlan, names: Sequence[str], diagnostics: Diagnostics) -> None:
        """Reports the stages that are left out, at the first of them."""
        text = f"of stages from {names[0]!r} on, text, names, units and modes alone were checked"
        why = f"this task has {len(task.stages)} stages, and {self.most} are examined"
        if len(task.stages) - len(names) < self.most:
            why = f"{self._seconds:g} s of processor time were over"
        finding = warning(
            IN_PART,
            f"{text}, and stability and a run of none: {why}",
            FILE.stages[names[0]],
            "`taskspec run` examines all of them; or put stages that belong together into a file",
        )
        finding.report(task.context.loaded, diagnostics)


def examine(
    loaded: LoadedTask, *, stability: bool = True, bounds: ExaminationBounds | None = None
) -> Examination:
    """The examination of a loaded task.

    Where params may be set while a stage runs, the rules are also asked about the task with each of
    them at either end of its interval, the others as declared.

    Args:
        loaded: the task.
        stability: whether to analyse the sampled loops of its stages too, unless there are errors
            already.
        bounds: beyond which the rest of it is left out, with a finding; None for all of it.
    """
    found = _examined(loaded, stability, bounds)
    if not loaded.task.live:
        return found
    diagnostics = Diagnostics(loaded.source.name)
    diagnostics.extend(found.findings)
    for name, value, dimension in _live_ends(loaded):
        if bounds is not None and bounds.over:
            break
        there = f"at {name} = {show(value, dimension)}, which may be set, "
        for each in _examined(loaded.where({name: value}), stability, bounds).findings:
            if each.span is None or not diagnostics.covers((each.code,), each.span):
                diagnostics.extend([replace(each, message=there + each.message)])
    return replace(found, findings=diagnostics.sorted())


def _live_ends(loaded: LoadedTask) -> Iterator[tuple[str, float, Dimension]]:
    """The ends of the intervals of live params other than their declared values: name, value."""
    for name, param in loaded.task.live.items():
        for end in (param.low, param.high):
            if end == param.value:
                continue
            yield name, end, param.dimension


def _examined(loaded: LoadedTask, stability: bool, bounds: ExaminationBounds | None) -> Examination:
    """The examination with all params as they are declared; see `examine`."""
    diagnostics = Diagnostics(loaded.source.name)
    diagnostics.extend(loaded.warnings)
    task = None
    try:
        task = plan_task(loaded, None if bounds is None else bounds.searched(loaded))
    except SpecError as error:
        diagnostics.extend(error.diagnostics)
    else:
        whole = _examine_stages(task, diagnostics, bounds)
        if stability and whole and not diagnostics.has_errors:
            apply_rules(Phase.STABILITY, task, loaded, diagnostics)
    return Examination(loaded, task, diagnostics.sorted())


def check_task(loaded: LoadedTask) -> tuple[Diagnostic, ...]:
    """All findings about a loaded task, the warnings of its reading included."""
    return examine(loaded).findings


def _examine_stages(
    task: TaskPlan, diagnostics: Diagnostics, bounds: ExaminationBounds | None
) -> bool:
    """Asks the rules of all phases but the last about a task whose robot and start are sound.

    Returns:
        Whether all stages are within the bounds.
    """
    loaded = task.context.loaded
    if not apply_rules(Phase.VARIATIONS, task, loaded, diagnostics):
        task = task.unvaried()
    apply_rules(Phase.TASK, task, loaded, diagnostics)
    names = [*task.stages]
    for number, (name, stage) in enumerate(task.stages.items()):
        if bounds is not None and (bounds.over or number >= bounds.most):
            bounds.left_out(task, names[number:], diagnostics)
            return False
        if not apply_rules(Phase.FRAME, stage, loaded, diagnostics):
            continue
        task.framed[name] = stage
        if all(
            apply_rules(phase, stage, loaded, diagnostics) for phase in (Phase.AXES, Phase.PATH)
        ):
            apply_rules(Phase.MOTION, task.follow(name), loaded, diagnostics)
    apply_rules(Phase.RUN, task, loaded, diagnostics)
    return True
