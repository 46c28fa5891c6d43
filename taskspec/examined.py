"""An examined task: what the gate asks for, without the rules that found it."""

from __future__ import annotations

from taskspec.deferred_methods import dataclass
from taskspec.program.plan import TaskPlan
from taskspec.spec import LoadedTask
from taskspec.text.diagnostic import Diagnostic


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
