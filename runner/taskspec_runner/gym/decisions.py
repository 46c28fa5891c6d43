"""Expectations that are decided while a run goes on: what no tick more can change.

A bound that every tick has to keep is broken by the first that does not, and so is one of a largest
or a smallest value. These are watched at every tick, and the run so far is judged where one seems
to be broken: what is said of it is the judge's.
"""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.expression import resolve, tree
from taskspec.spec import Task
from taskspec_runner.record.named import scope_of
from taskspec_runner.record.truth import Formulas

#: Names that a tick alone has no value of.
_OF_A_RUN = ("visits", "energy")


def breaking(task: Task) -> Formulas:
    """What is 1 at a tick that breaks an expectation, by a name of it, and for each stage.

    The name is the expectation's number in the file, with that of one of its conditions: `0.1`.
    """
    found: dict[str, dict[str, tree.Node]] = {}
    for number, expectation in enumerate(task.expect):
        whole = expectation.expression.tree
        items = whole.items if isinstance(whole, tree.Logic) and whole.op == "and" else (whole,)
        for i, item in enumerate(items):
            broken = _broken(item)
            stages = () if broken is None else tuple(_stages(task, broken))
            if broken is not None and stages:
                found[f"{number}.{i}"] = dict.fromkeys(stages, broken)
    return found


def _broken(item: tree.Node) -> tree.Node | None:
    """A condition on one tick that decides an item; None where no tick does."""
    reduced = [node for node in tree.walk(item) if isinstance(node, tree.Reduce)]
    if any(isinstance(node, tree.Held) for node in tree.walk(item)):
        return None
    if not reduced:
        return tree.Not(item)
    if len(reduced) > 1 or reduced[0].reducer not in ("max", "min"):
        return None
    (one,) = reduced
    least = one.reducer == "min"
    match item:
        case tree.WithinNode(x, low, high) if x is one:
            bound = tree.Compare(">=", one.arg, low) if least else tree.Compare("<=", one.arg, high)
            return tree.Not(bound)
        case tree.Compare(op, left, right) if left is one:
            return tree.Not(tree.Compare(op, one.arg, right)) if (op[0] == ">") is least else None
        case tree.Compare(op, left, right) if right is one:
            return tree.Not(tree.Compare(op, left, one.arg)) if (op[0] == "<") is least else None
        case _:
            return None


def _stages(task: Task, node: tree.Node) -> Iterator[str]:
    """The stages whose ticks a condition is on; none where a tick alone does not have its value."""
    named, scope = set(), scope_of(task)
    for each in tree.walk(node):
        if not isinstance(each, tree.Name):
            continue
        meaning = resolve(each.path, scope)
        if each.frame is not None or meaning is None or meaning.kind in _OF_A_RUN:
            return
        if meaning.stage is not None:
            named.add(meaning.stage)
    if len(named) <= 1:
        yield from named or task.stages
