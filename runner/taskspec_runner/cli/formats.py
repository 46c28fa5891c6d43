"""The forms in which commands print."""

from __future__ import annotations

from enum import StrEnum


class RunFormat(StrEnum):
    """Forms in which a run reports its outcome."""

    TEXT = "text"
    JSON = "json"


class OutcomeFormat(StrEnum):
    """Forms in which runs report whether the expectations are met."""

    TEXT = "text"
    JSON = "json"
    JUNIT = "junit"
    GITHUB = "github"


class DiagnosticFormat(StrEnum):
    """Forms in which diagnostics of task files are reported."""

    FULL = "full"
    CONCISE = "concise"
    JSON = "json"
    GITHUB = "github"
    SARIF = "sarif"
    JUNIT = "junit"


class LoopName(StrEnum):
    """What runs the ticks of a run; the numbers are the same."""

    AUTO = "auto"
    NATIVE = "native"
    PYTHON = "python"


class Equal(StrEnum):
    """What the laws of a comparison have in common beside the task."""

    BANDWIDTH = "bandwidth"
