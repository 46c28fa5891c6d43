"""The graph of stages, as the checks of a compiled task see it."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec.spec import Stage, Task


def good_end(stages: Mapping[str, Stage], name: str) -> str | None:
    """The stage that follows one that ends as planned; None where the run ends.

    Of several branches it is the one that is taken where no condition holds.
    """
    to = stages[name].ways(_following(stages, name))[-1]
    return to if to in stages else None


def good_ends(stages: Mapping[str, Stage], name: str) -> set[str]:
    """All stages that may follow one that ends as planned; itself, where it is repeated."""
    found = {*stages[name].ways(_following(stages, name))}
    if stages[name].repeat > 1:
        found.add(name)
    return found & stages.keys()


def leading_to(stages: Mapping[str, Stage], name: str) -> list[str]:
    """The stages that may lead to one when they end as planned, in order."""
    return [each for each in stages if name in good_ends(stages, each)]


def _following(stages: Mapping[str, Stage], name: str) -> str:
    names = list(stages)
    number = names.index(name) + 1
    return names[number] if number < len(names) else "end"


def followers(task: Task, name: str) -> set[str]:
    """All stages that a stage may lead to."""
    stage = task.stages[name]
    found = {*good_ends(task.stages, name), stage.on_fail, *task.limits_of(stage).targets()}
    return {to for to in found if to is not None and to in task.stages}


def reached(task: Task, start: set[str], without: str | None = None) -> set[str]:
    """The stages that a run in one of `start` may come to, `start` included.

    Args:
        task: the task.
        start: where to begin.
        without: a stage that may be entered, but not left.
    """
    found, waiting = set(start), list(start)
    while waiting:
        name = waiting.pop()
        new = set() if name == without else followers(task, name) - found
        found |= new
        waiting.extend(new)
    return found
