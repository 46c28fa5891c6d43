"""Identification: values of a task's world and arm from logs of its runs."""

from taskspec_runner.identify.estimate import Estimate
from taskspec_runner.identify.identification import (
    Combination,
    Group,
    Identification,
    identify,
)

__all__ = ["Combination", "Estimate", "Group", "Identification", "identify"]
