"""Identification: values of a task's world and arm from logs of its runs."""

from taskspec_runner.identify.identification import (
    Combination,
    Estimate,
    Group,
    Identification,
    identify,
)

__all__ = ["Combination", "Estimate", "Group", "Identification", "identify"]
