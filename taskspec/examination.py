"""The examination of a task: its plan, and what all rules find before anything moves.

Text, names, units and modes are checked while the file is read; here the robot, its start, its
axes and its contacts come in.
"""

from __future__ import annotations

from dataclasses import dataclass

import taskspec.rules.all  # noqa: F401  (it registers the rules)
from taskspec.check.contact.bodies import check_bodies
from taskspec.check.contact.equations import check_constraints, check_equations
from taskspec.check.contact.forces import check_forces
from taskspec.check.contact.leaving import check_leaving
from taskspec.check.contact.set_points import check_set_points
from taskspec.check.reach.feasibility import check_feasibility
from taskspec.check.reach.sensor import check_sensor
from taskspec.check.reach.singular import check_singular
from taskspec.check.stability.predicted import check_stability
from taskspec.check.stages.entering import check_entering, check_ramps
from taskspec.check.stages.guards import check_guards
from taskspec.check.stages.noise import check_noise
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
            check_stability(task, found)
    return Examination(loaded, task, found.sorted())


def check_task(loaded: LoadedTask) -> tuple[Diagnostic, ...]:
    """All findings about a loaded task, the warnings of its reading included."""
    return examine(loaded).findings


def check_stages(task: TaskPlan) -> tuple[Diagnostic, ...]:
    """Findings about the stages of a task whose robot and start are sound."""
    context, loaded = task.context, task.context.loaded
    found = Diagnostics(loaded.source.name)
    if not ask(Phase.VARIATIONS, task, loaded, found):
        task = task.unvaried()
        context = task.context
    ask(Phase.TASK, task, loaded, found)
    check_bodies(context, found)
    check_equations(context, found)
    check_sensor(context, found)
    for name, plan in task.stages.items():
        if not ask(Phase.FRAME, plan, loaded, found):
            continue
        rotation, axes = plan.rotation, plan.axes
        task.framed[name] = plan
        check_set_points(context, name, axes, rotation, found)
        check_ramps(context, name, axes, found)
        check_constraints(context, name, axes, rotation, found)
        if not ask(Phase.AXES, plan, loaded, found):
            continue
        if not ask(Phase.PATH, plan, loaded, found):
            continue
        path = plan.path
        check_forces(context, name, axes, rotation, path, found)
        nominal = task.follow(name).nominal
        check_feasibility(context, name, axes, nominal.places, found)
        check_singular(context, name, axes, nominal.places, found)
        check_leaving(context, name, axes, path, nominal, found)
        check_guards(context, name, axes, rotation, nominal.gap, found)
        check_noise(context, name, rotation, nominal.gap, found)
        check_entering(context, name, axes, rotation, nominal.gap, found)
        ask(Phase.MOTION, plan, loaded, found)
    ask(Phase.RUN, task, loaded, found)
    return found.sorted()
