"""The examination of a task: its plan, and what all rules find before anything moves.

Text, names, units and modes are checked while the file is read; here the robot, its start, its
axes and its contacts come in.
"""

from __future__ import annotations

from dataclasses import dataclass

import taskspec.rules.all  # noqa: F401  (it registers the rules)
from taskspec.foresight.nominal import plan_task
from taskspec.program.plan import TaskPlan
from taskspec.rules import Phase, ask
from taskspec.spec import LoadedTask
from taskspec.text.diagnostic import Diagnostic, Diagnostics, SpecError


@dataclass(frozen=True, slots=True)
class Examination:
    """What is known of a task before anything moves.

    Attributes:
        loaded: the task.
        plan: of its stages; None where robot, start or frames are not as the file says.
        findings: all that was found, the warnings of its reading included, sorted by place.
    """

    loaded: LoadedTask
    plan: TaskPlan | None
    findings: tuple[Diagnostic, ...]


def examine(loaded: LoadedTask, *, stability: bool = True) -> Examination:
    """Examines a loaded task.

    Args:
        loaded: the task.
        stability: whether to analyse the sampled loops of its stages too, unless there are errors
            already.
    """
    found = Diagnostics(loaded.source.name)
    found.extend(loaded.warnings)
    task = None
    try:
        task = plan_task(loaded)
    except SpecError as error:
        found.extend(error.diagnostics)
    else:
        found.extend(check_stages(task))
        if stability and not found.has_errors:
            ask(Phase.STABILITY, task, loaded, found)
    return Examination(loaded, task, found.sorted())


def check_task(loaded: LoadedTask) -> tuple[Diagnostic, ...]:
    """All findings about a loaded task, the warnings of its reading included."""
    return examine(loaded).findings


def check_stages(task: TaskPlan) -> tuple[Diagnostic, ...]:
    """Findings about the stages of a task whose robot and start are sound."""
    loaded = task.context.loaded
    found = Diagnostics(loaded.source.name)
    if not ask(Phase.VARIATIONS, task, loaded, found):
        task = task.unvaried()
    ask(Phase.TASK, task, loaded, found)
    for name, plan in task.stages.items():
        if not ask(Phase.FRAME, plan, loaded, found):
            continue
        task.framed[name] = plan
        if not ask(Phase.AXES, plan, loaded, found) or not ask(Phase.PATH, plan, loaded, found):
            continue
        ask(Phase.MOTION, task.follow(name), loaded, found)
    ask(Phase.RUN, task, loaded, found)
    return found.sorted()
