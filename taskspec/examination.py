"""The examination of a task: its plan, and what all rules find before anything moves.

Text, names, units and modes are checked while the file is read; here the robot, its start, its
axes and its contacts come in.
"""

from __future__ import annotations

import taskspec.rules.all  # noqa: F401  (it registers the rules)
from taskspec.examined import Examination
from taskspec.planning import plan_task
from taskspec.program.plan import TaskPlan
from taskspec.rules import Phase, apply_rules
from taskspec.spec import LoadedTask
from taskspec.text.diagnostic import Diagnostic, Diagnostics, SpecError


def examine(loaded: LoadedTask, *, stability: bool = True) -> Examination:
    """The examination of a loaded task.

    Args:
        loaded: the task.
        stability: whether to analyse the sampled loops of its stages too, unless there are errors
            already.
    """
    diagnostics = Diagnostics(loaded.source.name)
    diagnostics.extend(loaded.warnings)
    task = None
    try:
        task = plan_task(loaded)
    except SpecError as error:
        diagnostics.extend(error.diagnostics)
    else:
        _examine_stages(task, diagnostics)
        if stability and not diagnostics.has_errors:
            apply_rules(Phase.STABILITY, task, loaded, diagnostics)
    return Examination(loaded, task, diagnostics.sorted())


def check_task(loaded: LoadedTask) -> tuple[Diagnostic, ...]:
    """All findings about a loaded task, the warnings of its reading included."""
    return examine(loaded).findings


def _examine_stages(task: TaskPlan, diagnostics: Diagnostics) -> None:
    """Asks the rules of all phases but the last about a task whose robot and start are sound."""
    loaded = task.context.loaded
    if not apply_rules(Phase.VARIATIONS, task, loaded, diagnostics):
        task = task.unvaried()
    apply_rules(Phase.TASK, task, loaded, diagnostics)
    for name, stage in task.stages.items():
        if not apply_rules(Phase.FRAME, stage, loaded, diagnostics):
            continue
        task.framed[name] = stage
        if all(
            apply_rules(phase, stage, loaded, diagnostics) for phase in (Phase.AXES, Phase.PATH)
        ):
            apply_rules(Phase.MOTION, task.follow(name), loaded, diagnostics)
    apply_rules(Phase.RUN, task, loaded, diagnostics)
