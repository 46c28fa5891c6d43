"""The expression language: parse, check names and dimensions, evaluate with any kind of number."""

from taskspec.expression.checker import check, infer
from taskspec.expression.evaluate import Algebra, FloatAlgebra, evaluate
from taskspec.expression.expression import Expression
from taskspec.expression.parse import parse
from taskspec.expression.problem import ExpressionError, Problem
from taskspec.expression.scope import Meaning, Scope, ScopeKind, resolve

__all__ = [
    "Algebra",
    "Expression",
    "ExpressionError",
    "FloatAlgebra",
    "Meaning",
    "Problem",
    "Scope",
    "ScopeKind",
    "check",
    "evaluate",
    "infer",
    "parse",
    "resolve",
]
