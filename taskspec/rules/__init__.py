"""Rules: registered functions that find what is wrong with a plan before anything moves."""

from taskspec.rules.finding import Finding, Place, error, info, warning
from taskspec.rules.registry import RULES, Phase, Rule, apply_rules, predicted, rule, rule_of

__all__ = [
    "RULES",
    "Finding",
    "Phase",
    "Place",
    "Rule",
    "apply_rules",
    "error",
    "info",
    "predicted",
    "rule",
    "rule_of",
    "warning",
]
