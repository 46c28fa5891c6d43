"""The forms in which commands print."""

from __future__ import annotations

from enum import StrEnum


class RunFormat(StrEnum):
    """How a run reports its outcome."""

    TEXT = "text"
    JSON = "json"


class OutcomeFormat(StrEnum):
    """How runs of task files report whether they are as the files expect."""

    TEXT = "text"
    JSON = "json"
    JUNIT = "junit"
    GITHUB = "github"


class DiagnosticFormat(StrEnum):
    """How diagnostics of task files are reported."""

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
