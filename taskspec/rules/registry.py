"""The registry of rules: what can be found in a plan before anything moves.

A rule is a function that looks at one stage, or at the whole task, and yields findings. Its codes
and their titles stand beside it, and everything else that needs them asks the registry:

    @rule("TS214", "a limit that nothing keeps")
    def unkept_limits(stage: StagePlan) -> Iterator[Finding]:
        \"\"\"A limit on the torques' rate under a law whose torques are a closed form's.\"\"\"
        if stage.law.solve != "qp" and stage.limits.torque_rate is not None:
            yield error(
                "TS214",
                f"nothing keeps 'torque_rate' in stage {stage.name!r}",
                key_of(FILE.stages[stage.name].limits.torque_rate),
                "solve the law by a program that keeps it",
            )

A rule with several codes gives a mapping of them to their titles. A code that is registered
elsewhere, and that a rule reports as well, stands in `also`. Each code has a page,
`docs/diagnostics/CODE.md`, and a file in `tests/corpus` that shows it; tests ask for both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import IntEnum
from typing import Any, TypeVar

from taskspec.deferred_methods import dataclass
from taskspec.rules.finding import Finding
from taskspec.spec import LoadedTask
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, SpecError

Check = TypeVar("Check", bound=Callable[[Any], Iterable[Finding]])


class Phase(IntEnum):
    """When a rule is asked, which is what has to be known of its subject.

    Attributes:
        VARIATIONS: of the task, before anything else; one that cannot vary as its file says is
            looked at as if it did not vary.
        TASK: of the task, before its stages.
        FRAME: of a stage, when nothing is known yet but its frame.
        AXES: of a stage whose axes are known.
        PATH: of a stage whose path is known as well.
        MOTION: of a stage whose motion lasts a time that can be simulated: where the tool is can
            be told.
        RUN: of the task, after its stages.
        STABILITY: of a task without an error so far.
    """

    VARIATIONS = 0
    TASK = 1
    FRAME = 2
    AXES = 3
    PATH = 4
    MOTION = 5
    RUN = 6
    STABILITY = 7


@dataclass(frozen=True, slots=True)
class Rule:
    """A function that finds something, and what it may report.

    Attributes:
        check: the function; it takes the plan of a stage or of a task and yields findings.
        titles: code to title, of those that belong to this rule.
        also: further codes that it reports.
        phase: when it is asked.
        bars: behind an error of its own no plant can be built, so that `force` does not lift it.
        predicts: those of its codes that say how the run of the file's own world ends: a
            warning by one of them is a remark where a trial of that world ends well.
    """

    check: Callable[[Any], Iterable[Finding]]
    titles: Mapping[str, str]
    also: tuple[str, ...]
    phase: Phase
    bars: bool = False
    predicts: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The name of the function."""
        return self.check.__name__

    @property
    def module(self) -> str:
        """The module that the rule stands in."""
        return self.check.__module__

    @property
    def codes(self) -> tuple[str, ...]:
        """All codes that the rule may report."""
        return (*self.titles, *self.also)

    @property
    def pages(self) -> tuple[str, ...]:
        """The pages of its codes, from the root of the repository."""
        return tuple(f"docs/diagnostics/{code}.md" for code in self.codes)

    def findings(self, plan: object) -> Iterator[Finding]:
        """What the rule finds in a plan.

        Raises:
            AssertionError: it reports a code that is not one of its own.
        """
        for finding in self.check(plan):
            assert finding.code in self.codes, f"{self.name} does not declare {finding.code}"
            yield finding


RULES: list[Rule] = []
"""All rules, in the order in which they are asked within their phase."""


def rule(
    codes: str | Mapping[str, str],
    title: str = "",
    *,
    also: tuple[str, ...] = (),
    phase: Phase = Phase.MOTION,
    bars: bool = False,
    predicts: tuple[str, ...] = (),
) -> Callable[[Check], Check]:
    """Registers a function as a rule.

    Args:
        codes: the code that it reports, or several with their titles; none where all are `also`.
        title: of the one code.
        also: codes that it reports and that are registered elsewhere.
        phase: when it is asked.
        bars: behind an error of its own no plant can be built, so that `force` does not lift it.
        predicts: those of its codes that a trial confirms or refutes, as `Rule` has them.

    Raises:
        ValueError: a code is registered already.
    """
    titles = {codes: title} if isinstance(codes, str) else dict(codes)
    register(titles)

    def enter(check: Check) -> Check:
        RULES.append(Rule(check, titles, also, phase, bars, predicts))
        return check

    return enter


def rule_of(code: str) -> Rule | None:
    """The rule to which a code belongs; None where it is reported while a file is read."""
    return next((each for each in RULES if code in each.titles), None)


def predicted(code: str) -> bool:
    """Whether a warning by a code says how the run of the file's own world ends."""
    return any(code in each.predicts for each in RULES)


def apply_rules(phase: Phase, plan: object, loaded: LoadedTask, diagnostics: Diagnostics) -> bool:
    """Asks all rules of a phase about a plan, and reports what they find.

    Where a rule needs something of the plan that raises a `SpecError`, that is what is reported,
    and no further rule is asked.

    Args:
        phase: whose rules are asked.
        plan: of a stage or of the task.
        loaded: the task that places refer to.
        diagnostics: where findings go.

    Returns:
        Whether rules of the next phase may be asked about the same plan.
    """
    for each in RULES:
        if each.phase is not phase:
            continue
        stops = False
        try:
            for finding in each.findings(plan):
                finding.report(loaded, diagnostics)
                stops |= finding.stops
        except SpecError as error:
            diagnostics.extend(error.diagnostics)
            stops = True
        if stops:
            return False
    return True
