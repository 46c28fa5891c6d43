"""The graph of stages, as the checks of a compiled task see it."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec.spec import Stage


def good_end(stages: Mapping[str, Stage], name: str) -> str | None:
    """The stage that follows one that ends as planned; None where the run ends."""
    names = list(stages)
    number = names.index(name) + 1
    to = stages[name].next or (names[number] if number < len(names) else "end")
    return to if to in stages else None


def followers(stages: Mapping[str, Stage], name: str) -> set[str]:
    """All stages that a stage may lead to."""
    found = {good_end(stages, name), stages[name].on_fail}
    return {to for to in found if to is not None and to in stages}


def reached(stages: Mapping[str, Stage], start: set[str], without: str | None = None) -> set[str]:
    """The stages that a run in one of `start` may come to, `start` included.

    Args:
        stages: of the task, in order.
        start: where to begin.
        without: a stage that may be entered, but not left.
    """
    found, waiting = set(start), list(start)
    while waiting:
        name = waiting.pop()
        new = set() if name == without else followers(stages, name) - found
        found |= new
        waiting.extend(new)
    return found
