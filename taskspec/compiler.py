"""From a loaded task to a program: robot, frames, stages as functions, and their machine.

What refuses a task on this way is `admit`; `validate` shows the same findings. The rules that
find them are imported where something has to be found.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.examined import Examination
from taskspec.planning import plan_task
from taskspec.program.program import Program, compiled, refusals
from taskspec.spec import LoadedTask
from taskspec.text.diagnostic import SpecError

Vector = NDArray[np.float64]


#: The code of a stage that is predicted to be unstable in the world of its file.
UNSTABLE = "TS501"


def compile_task(loaded: LoadedTask, *, force: bool = False) -> Program:
    """Compiles a task that nothing speaks against.

    Args:
        loaded: the task.
        force: whether findings are lifted behind which a program still compiles.

    Raises:
        SpecError: the task is refused; it carries everything that was found.
    """
    from taskspec.examination import examine

    return admit(examine(loaded), force=force)


def admit(examined: Examination, *, force: bool = False) -> Program:
    """Compiles an examined task: the one gate that a task passes on its way to a run.

    Args:
        examined: the task with what was found about it.
        force: whether findings are lifted behind which a program still compiles.

    Raises:
        SpecError: the task is refused; it carries everything that was found.
    """
    findings, plan = examined.findings, examined.plan
    sources = examined.loaded.sources
    against = refusals(findings)
    lifted = force and not any(_bars(d.code) for d in against)
    if plan is None or (against and not lifted):
        raise SpecError(findings, sources)
    try:
        return Program(plan, compiled(plan), findings)
    except Exception as error:
        if against:
            # Behind an error that was lifted nothing is promised to the compiler.
            raise SpecError(findings, sources) from error
        if isinstance(error, SpecError):
            raise SpecError((*findings, *error.diagnostics), sources) from error
        raise


def _bars(code: str) -> bool:
    """Whether no plant can be built behind a code, though the stages compile."""
    import taskspec.rules.all  # noqa: F401  (it registers the rules)
    from taskspec.rules import rule_of

    owner = rule_of(code)
    return owner is not None and owner.bars


def compile_unchecked(loaded: LoadedTask) -> Program:
    """Compiles a task without a look at whether it should run, such as that of an earlier run.

    Raises:
        SpecError: the robot, its start, a frame or an axis is not as the file says.
    """
    plan = plan_task(loaded)
    return Program(plan, compiled(plan))
