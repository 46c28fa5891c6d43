"""Types and dimensions of an expression, and the names in it."""

from __future__ import annotations

from dataclasses import dataclass

from taskspec.text.expression import tree
from taskspec.text.expression.checker import Checker
from taskspec.text.expression.problem import Problem
from taskspec.text.expression.scope import Scope
from taskspec.text.expression.types import Type
from taskspec.text.expression.vectors import written_out
from taskspec.text.units import NUMBER, Dimension


@dataclass(frozen=True, slots=True)
class Checked:
    """The outcome of a check: the tree with vectors written out, its dimension, the problems."""

    tree: tree.Node
    dimension: Dimension
    problems: tuple[Problem, ...]


def check(node: tree.Node, scope: Scope, expected: Dimension | None) -> Checked:
    """Checks names, types and dimensions, all of them.

    Args:
        node: a parsed expression.
        scope: the names it may use.
        expected: the dimension that its place asks for; None if the place asks for a condition.

    Returns:
        The tree in which `norm(force)` is written out as `norm(force.x, force.y, force.z)`, and
        every problem found. The dimension is the expected one, plain for conditions.
    """
    checker = Checker(scope)
    found = checker.type_of(node)
    if expected is None:
        checker.want_condition(node, found)
    else:
        checker.want(node, found, expected)
    problems = tuple(checker.problems)
    return Checked(node if problems else written_out(node), expected or NUMBER, problems)


def infer(node: tree.Node, scope: Scope) -> tuple[Type, tuple[Problem, ...]]:
    """The type of an expression whose place asks for none, and every problem found."""
    checker = Checker(scope)
    found = checker.type_of(node)
    if found.kind == "vector":
        checker.number(node, found)
    return found, tuple(checker.problems)
