"""The expression language: parse, check names and dimensions, evaluate with any kind of number."""

from taskspec.text.expression.checker import check, infer
from taskspec.text.expression.evaluate import Algebra, FloatAlgebra, evaluate
from taskspec.text.expression.expression import Expression
from taskspec.text.expression.parse import parse
from taskspec.text.expression.problem import ExpressionError, Problem
from taskspec.text.expression.scope import Meaning, Scope, ScopeKind, resolve

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
